"""Images of handwritten digits: MNIST from files or OpenML, or the 8 x 8 set that scikit-learn brings."""

from __future__ import annotations

import gzip
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from hdsafebo.errors import DatasetError
from hdsafebo.files.bounded import open_regular
from hdsafebo.typing import FloatArray

Source = Literal["mnist", "sklearn", "idx", "openml"]
_IDX_MAX_BYTES = 200_000_000  # MNIST's training images take 47 MB; anything far larger is not MNIST
_UNSIGNED_BYTE = 0x08


@dataclass(frozen=True)
class DigitImages:
    """Images and what they show.

    Attributes:
        pixels: (n, side * side) intensities in [0, 1], row by row.
        labels: (n,) digits 0 to 9.
    """

    pixels: FloatArray
    labels: NDArray[np.int64]

    @property
    def side(self) -> int:
        """Pixels along one edge."""
        return round(self.pixels.shape[1] ** 0.5)


def load_digit_images(source: Source, folder: Path | None = None) -> DigitImages:
    """Load the images of a source.

    Args:
        source: `mnist` or `idx` (files in MNIST's own format in `folder`), `sklearn` (1,797 images of 8 x 8,
            bundled), or `openml` (MNIST by scikit-learn's `fetch_openml`, which downloads).
        folder: where the IDX files lie.

    Raises:
        DatasetError: files are missing, damaged or of other shapes.
    """
    if source == "sklearn":
        from sklearn.datasets import load_digits

        data = load_digits()
        return DigitImages(data.data / 16.0, data.target.astype(np.int64))
    if source == "openml":
        from sklearn.datasets import fetch_openml

        pixels, labels = fetch_openml("mnist_784", version=1, return_X_y=True, as_frame=False)
        return DigitImages(np.asarray(pixels, float) / 255.0, labels.astype(np.int64))
    if folder is None:
        raise DatasetError(f"digit images: source {source!r} needs a folder with IDX files, got none")
    return _load_idx(folder)


def _load_idx(folder: Path) -> DigitImages:
    """All pairs of images and labels in a folder, plain or gzipped."""
    images = sorted(folder.glob("*images*idx3*"))
    if not images:
        raise DatasetError(f"{folder}: no IDX image files (*images-idx3-ubyte, plain or .gz)")
    pixels, labels = [], []
    for path in images:
        partner = path.with_name(path.name.replace("images", "labels").replace("idx3", "idx1"))
        values, digits = read_idx(path, 3), read_idx(partner, 1)
        if len(values) != len(digits):
            raise DatasetError(f"{path}: {len(values)} images but {len(digits)} labels in {partner.name}")
        pixels.append(values.reshape(len(values), -1) / 255.0)
        labels.append(digits.astype(np.int64))
    shapes = {table.shape[1] for table in pixels}
    if len(shapes) > 1:
        raise DatasetError(f"{folder}: images of different sizes {sorted(shapes)} pixels")
    return DigitImages(np.concatenate(pixels), np.concatenate(labels))


def read_idx(path: Path, dimensions: int) -> NDArray[np.uint8]:
    """Read an IDX file of unsigned bytes (format: LeCun et al., the MNIST database).

    Args:
        path: the file, gzipped when its name ends in `.gz`.
        dimensions: number of dimensions it must have.

    Raises:
        DatasetError: the file is missing, truncated, too large, or of another type or dimension.
    """
    try:
        with open_regular(path) as raw, gzip.open(raw) if path.suffix == ".gz" else raw as file:
            data = file.read(_IDX_MAX_BYTES + 1)
    except (OSError, EOFError) as error:
        raise DatasetError(f"{path}: cannot be read: {error}") from error
    if len(data) > _IDX_MAX_BYTES:
        raise DatasetError(f"{path}: more than {_IDX_MAX_BYTES} bytes, expected an MNIST-sized file")
    header = 4 + 4 * dimensions
    if len(data) < header or data[:4] != bytes((0, 0, _UNSIGNED_BYTE, dimensions)):
        raise DatasetError(f"{path}: not an IDX file of unsigned bytes with {dimensions} dimensions")
    shape = struct.unpack(f">{dimensions}I", data[4:header])
    size = int(np.prod([int(n) for n in shape], dtype=object))
    if len(data) - header != size:
        raise DatasetError(f"{path}: holds {len(data) - header} values, its header {shape} promises {size}")
    return np.frombuffer(data, np.uint8, offset=header).reshape(shape)
