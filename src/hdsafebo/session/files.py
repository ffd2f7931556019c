"""The files that a session was made with."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from hdsafebo.session.definition import Definition, ListDefinition
from hdsafebo.session.errors import DefinitionError
from hdsafebo.session.log.store import Store

MAX_BYTES = 2**30  # of an embedding; tables have lower limits of their own
INITIAL, EMBEDDING, EMBEDDING_CARD, CANDIDATES = "initial", "embedding", "embedding_card", "candidates"


class NamedFile(NamedTuple):
    """A file that a session was made with."""

    name: str
    content: bytes


def digest(content: bytes) -> str:
    """SHA-256 in hexadecimal digits."""
    return hashlib.sha256(content).hexdigest()


def read_files(
    definition_path: Path, definition: Definition, initial: Path | None, embedding: Path | None
) -> dict[str, NamedFile]:
    """All files of a new session by their role; DefinitionError when one cannot be read."""
    paths = {} if initial is None else {INITIAL: initial}
    if embedding is not None:
        paths |= {EMBEDDING: embedding, EMBEDDING_CARD: embedding.with_suffix(".json")}
    if isinstance(definition, ListDefinition):
        paths[CANDIDATES] = definition_path.parent / definition.candidates
    try:
        return {role: NamedFile(path.name, _content(path)) for role, path in paths.items()}
    except OSError as error:
        raise DefinitionError(f"{error.filename}: {error.strerror or error}") from None


def _content(path: Path) -> bytes:
    content = read_bounded(path, MAX_BYTES)
    if content is None:
        raise DefinitionError(f"{path}: larger than the {MAX_BYTES} bytes that a file may have")
    return content


def read_bounded(path: Path, most: int) -> bytes | None:
    """Content of a file (or pipe); None when it is larger than `most` bytes, of which no more are read.

    Raises:
        OSError: it cannot be read.
    """
    with path.open("rb") as file:
        if os.fstat(file.fileno()).st_size > most:
            return None
        content = file.read(most + 1)
    return content if len(content) <= most else None


def stored_files(store: Store, files: Mapping[str, Mapping[str, str]]) -> dict[str, NamedFile]:
    """The files that a session was made with, from its store; AuditError when one was changed."""
    return {
        role: NamedFile(entry["name"], store.attachments.content(entry["sha256"]))
        for role, entry in files.items()
    }
