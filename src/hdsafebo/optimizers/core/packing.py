"""Tables of whole numbers in few bytes: each row as its difference from the earlier row that is nearest.

Points of a search are steps from earlier points. In tens of thousands of dimensions the differences have a
few bits each where the points have sixteen, and entropy coding (zstd) finds them. Nothing is lost.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hdsafebo.typing import FloatArray

_SAMPLED = 512
"""Columns in which rows are compared to find the nearest."""
_LEVEL = 3
_MOST = np.iinfo(np.int16).max

Packed = dict[str, NDArray[Any]]
Steps = NDArray[np.int16]


def steps_of(x: FloatArray, resolution: FloatArray) -> Steps | None:
    """(n, d) whole multiples of the (d,) resolution that the (n, d) numbers are; None where they are not."""
    steps = np.empty(x.shape, np.int16)
    for i, row in enumerate(x):
        multiples = row / resolution
        if (np.abs(multiples) > _MOST).any() or not np.array_equal(multiples, np.rint(multiples)):
            return None
        steps[i] = multiples
    return steps


def pack(steps: Steps) -> Packed:
    """The (n, d) table as `bytes`, the `lengths` of its rows, and the row that each is the difference to.

    A row without an earlier one is the difference to 0, and has the reference -1.
    """
    codec, some = _codec(), _sample(steps)
    references, blobs = np.full(len(steps), -1), []
    for i, row in enumerate(steps):
        if i:
            references[i] = np.abs(some[:i] - some[i]).sum(axis=1).argmin()
        difference = row - steps[references[i]] if i else row  # modulo 2^16: undone by the sum
        blobs.append(codec.compress(_planes(difference), asbytes=True))
    return {
        "bytes": np.frombuffer(b"".join(blobs), np.uint8),
        "lengths": np.array([len(blob) for blob in blobs], np.int64),
        "references": references,
    }


def unpack(packed: Mapping[str, NDArray[Any]], d: int) -> Steps:
    """The (n, d) table that was packed.

    Raises:
        KeyError: a part is missing.
        ValueError: the parts contradict each other, or are no packed table.
    """
    content, lengths, references = packed["bytes"], packed["lengths"], packed["references"]
    n = len(lengths)
    if (lengths < 0).any() or lengths.sum() != len(content) or references.shape != (n,):
        raise ValueError(f"{len(content)} bytes of {n} packed rows; expected {lengths.sum()}")
    if ((references < -1) | (references >= np.arange(n))).any():
        raise ValueError("packed rows refer to rows that do not come before them")
    codec, ends = _codec(), np.cumsum(lengths)
    steps = np.empty((n, d), np.int16)
    for i, (end, length) in enumerate(zip(ends, lengths, strict=True)):
        try:
            planes = codec.decompress(content[end - length : end].tobytes(), 2 * d, asbytes=True)
        except OSError as error:  # of pyarrow
            raise ValueError(f"packed row {i}: {error}") from None
        difference = _from_planes(np.frombuffer(planes, np.uint8))
        steps[i] = difference if references[i] < 0 else difference + steps[references[i]]
    return steps


def _codec() -> Any:
    from pyarrow import Codec

    return Codec("zstd", compression_level=_LEVEL)


def _sample(steps: Steps) -> NDArray[np.int32]:
    stride = max(1, steps.shape[1] // _SAMPLED)
    return steps[:, ::stride].astype(np.int32)


def _planes(difference: Steps) -> bytes:
    """Zigzag, so that small differences of either sign have a high byte of 0; low bytes, then high ones."""
    wide = difference.astype(np.int32)
    zigzag = ((wide << 1) ^ (wide >> 31)).astype(np.uint16)
    return zigzag.view(np.uint8).reshape(-1, 2).T.tobytes()


def _from_planes(planes: NDArray[np.uint8]) -> Steps:
    zigzag = np.ascontiguousarray(planes.reshape(2, -1).T).view(np.uint16)[:, 0].astype(np.int32)
    return ((zigzag >> 1) ^ -(zigzag & 1)).astype(np.int16)
