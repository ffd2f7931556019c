"""Embeddings by name; the module of each is imported when it is asked for."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import Any

from hdsafebo.embeddings.base import Embedding
from hdsafebo.embeddings.storage import card_of, read_card
from hdsafebo.errors import EmbeddingFileError, UnknownNameError

_CLASSES = {
    "identity": ("identity", "Identity"),
    "irvae": ("autoencoder", "IRVAE"),
    "pca": ("linear", "PCA"),
    "random": ("linear", "RandomProjection"),
    "residual": ("residual", "Residual"),
    "vae": ("autoencoder", "VAE"),
}


def embedding_names() -> tuple[str, ...]:
    """Names that `make_embedding` knows."""
    return tuple(sorted(_CLASSES))


def embedding_modules() -> list[str]:
    """The modules that define the embeddings, each once."""
    return sorted({f"hdsafebo.embeddings.{module}" for module, _ in _CLASSES.values()})


def embedding_class(name: str) -> type[Embedding]:
    """Class of an embedding; UnknownNameError lists the valid names."""
    if name not in _CLASSES:
        raise UnknownNameError("embedding", name, embedding_names())
    module, attribute = _CLASSES[name]
    found: type[Embedding] = getattr(import_module(f"hdsafebo.embeddings.{module}"), attribute)
    return found


def make_embedding(name: str, **settings: Any) -> Embedding:
    """A new embedding, to be fitted.

    Raises:
        UnknownNameError: no embedding has that name.
        ParamsError: a setting is unknown, of the wrong type or out of range.
    """
    cls = embedding_class(name)
    return cls(cls.check_settings(settings))


def load_embedding(path: Path, *, input_dim: int | None = None, latent_dim: int | None = None) -> Embedding:
    """Read an embedding of any kind.

    Args:
        path: the `.safetensors` file; its card lies beside it.
        input_dim: what its use needs, if known.
        latent_dim: what its use needs, if known.

    Raises:
        EmbeddingFileError: a file is missing, too large, damaged, of an unknown kind or of another shape.
    """
    card = read_card(path)
    needs = {"input_dim": (input_dim, card.input_dim), "latent_dim": (latent_dim, card.latent_dim)}
    for name, (wanted, found) in needs.items():
        if wanted is not None and wanted != found:
            raise EmbeddingFileError(f"{path}: {name} is {found}, expected {wanted}")
    try:
        cls = embedding_class(card.kind)
    except UnknownNameError as error:
        raise EmbeddingFileError(f"{card_of(path)}: {error}") from None
    return cls.load(path)
