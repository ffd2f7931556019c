"""What every embedding offers: fit, encode, decode, and files that hold numbers only."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike
from pydantic import BaseModel, ConfigDict, ValidationError

from hdsafebo.embeddings.storage import Tensor, TensorSpec, card_of, read_card, read_tensors, write_files
from hdsafebo.errors import DatasetError, EmbeddingFileError, EmbeddingTrainingError, ParamsError
from hdsafebo.typing import FloatArray

Source = Callable[[FloatArray, np.random.Generator], FloatArray]
"""Draws one training set (n, D) from n given points: a fresh variation of the data per epoch."""

Tensors = Mapping[str, Tensor]


class EmbeddingSettings(BaseModel):
    """Constructor settings of an embedding: immutable, no unknown keys, no silent conversions."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)


class Embedding(ABC):
    """A map from R^D to a latent space R^d and back (Pi and its inverse in the paper, section 4.1).

    Attributes:
        name: registry name.
        Settings: model of the settings.
        settings: how this one was made.
        training: how the fit went (plain numbers and lists), and under `code_box` the limits of the codes of
            the points that it was fitted to.
    """

    name: ClassVar[str]
    Settings: ClassVar[type[EmbeddingSettings]]

    def __init__(self, settings: EmbeddingSettings) -> None:
        self.settings = settings
        self.training: dict[str, object] = {}
        self._input_dim: int | None = None

    @property
    def input_dim(self) -> int:
        """D; known once fitted."""
        return self._require_fitted()

    @property
    @abstractmethod
    def latent_dim(self) -> int:
        """d."""

    def fit(self, x: ArrayLike, *, rng: np.random.Generator, source: Source | None = None) -> Self:
        """Fit to data.

        Args:
            x: points, shape (n, D), finite.
            rng: the only source of randomness.
            source: varies the points: called with (n, D) points and `rng`, once for embeddings in
                closed form and once per epoch for learned ones. None takes the points as they are.

        Returns:
            Itself.

        Raises:
            DatasetError: wrong shape, too few points for the latent space, or values not finite.
            EmbeddingTrainingError: a learned embedding collapsed or diverged.
        """
        points = _finite_table(x, "x")
        if self._needed_points > min(points.shape):
            raise DatasetError(
                f"x has shape {points.shape}: embedding {self.name!r} needs at least {self._needed_points} "
                "points and as many columns, one per latent dimension"
            )
        self._input_dim = points.shape[1]
        varied = source if source is not None else as_given
        self._fit(points, rng, varied)
        codes = self._encode(varied(points, rng))
        self.training["code_box"] = [codes.min(axis=0).tolist(), codes.max(axis=0).tolist()]
        return self

    @property
    def code_box(self) -> FloatArray:
        """(2, d) lower and upper limits of the codes of the points that it was fitted to.

        Raises:
            EmbeddingFileError: it was read from a card without them, or with something else in their place.
        """
        self._require_fitted()
        try:
            box = np.asarray(self.training["code_box"], float)
        except (KeyError, TypeError, ValueError):
            box = np.empty(0)
        if box.shape != (2, self.latent_dim) or not np.isfinite(box).all() or (box[0] > box[1]).any():
            raise EmbeddingFileError(
                f"embedding {self.name!r}: training.code_box of its card is no box of {self.latent_dim} "
                "codes; train it again"
            )
        return box

    def encode(self, x: ArrayLike) -> FloatArray:
        """Latent codes (n, d) of points (n, D); DatasetError on another shape or values not finite."""
        return self._encode(_finite_table(x, "x", self.input_dim))

    def decode(self, z: ArrayLike) -> FloatArray:
        """Points (n, D) of latent codes (n, d); DatasetError on another shape or values not finite."""
        self._require_fitted()
        return self._decode(_finite_table(z, "z", self.latent_dim))

    def _require_fitted(self) -> int:
        if self._input_dim is None:
            raise EmbeddingTrainingError(f"embedding {self.name!r} is not fitted: call fit or load it first")
        return self._input_dim

    def save(self, path: Path) -> None:
        """Write the tensors to `path` (`.safetensors`) and a card (`.json`) beside it."""
        write_files(
            path,
            self.tensors(),
            kind=self.name,
            input_dim=self.input_dim,
            latent_dim=self.latent_dim,
            settings=self.settings.model_dump(mode="json"),
            training=self.training,
        )

    @classmethod
    def load(cls, path: Path) -> Self:
        """Read an embedding of this kind; `load_embedding` reads any.

        Raises:
            EmbeddingFileError: a file is missing, too large, damaged, of another kind or of another shape.
        """
        card = read_card(path)
        if card.kind != cls.name:
            raise EmbeddingFileError(f"{card_of(path)}: kind is {card.kind!r}, expected {cls.name!r}")
        try:
            embedding = cls(cls.check_settings(card.settings))
        except ParamsError as error:
            raise EmbeddingFileError(f"{card_of(path)}: {error}") from None
        embedding._input_dim = card.input_dim
        if embedding.latent_dim != card.latent_dim:
            raise EmbeddingFileError(
                f"{card_of(path)}: latent_dim is {card.latent_dim}, the settings give {embedding.latent_dim}"
            )
        specs = cls.tensor_specs(embedding.settings, card.input_dim)
        embedding._restore(read_tensors(path, specs, card.sha256))
        embedding.training = dict(card.training)
        return embedding

    @classmethod
    def check_settings(cls, settings: Mapping[str, Any]) -> EmbeddingSettings:
        """Settings of this class; ParamsError names what is unknown, of the wrong type or out of range."""
        try:
            return cls.Settings.model_validate(dict(settings))
        except ValidationError as error:
            raise ParamsError("; ".join(cls._explain(item) for item in error.errors())) from None

    @classmethod
    def _explain(cls, error: Any) -> str:
        key = ".".join(str(part) for part in error["loc"])
        if error["type"] == "extra_forbidden":
            valid = ", ".join(sorted(cls.Settings.model_fields)) or "none"
            return f"embedding {cls.name!r}: unknown setting {key!r}; valid settings: {valid}"
        message = error["msg"].removeprefix("Value error, ")
        return f"embedding {cls.name!r}: setting {key!r}: {message}, got {error['input']!r}"

    @property
    def _needed_points(self) -> int:
        """Least number of points and of columns that `fit` can work with."""
        return self.latent_dim

    @abstractmethod
    def _fit(self, x: FloatArray, rng: np.random.Generator, source: Source) -> None: ...

    @abstractmethod
    def _encode(self, x: FloatArray) -> FloatArray: ...

    @abstractmethod
    def _decode(self, z: FloatArray) -> FloatArray: ...

    @classmethod
    @abstractmethod
    def tensor_specs(cls, settings: EmbeddingSettings, input_dim: int) -> dict[str, TensorSpec]:
        """Tensors that a fitted embedding of these settings consists of."""

    @abstractmethod
    def tensors(self) -> Tensors:
        """The fitted state, as `tensor_specs` describes it."""

    @abstractmethod
    def _restore(self, tensors: Tensors) -> None: ...


def as_given(x: FloatArray, rng: np.random.Generator) -> FloatArray:
    """The source that does not vary the points."""
    return x


def _finite_table(values: ArrayLike, name: str, columns: int | None = None) -> FloatArray:
    table = np.asarray(values, dtype=float)
    if table.ndim != 2 or (columns is not None and table.shape[1] != columns):
        raise DatasetError(f"{name} has shape {table.shape}, expected (n, {columns or 'D'})")
    if not np.isfinite(table).all():
        raise DatasetError(f"{name} holds NaN or infinite values, expected finite numbers")
    return table
