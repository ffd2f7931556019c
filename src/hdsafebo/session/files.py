"""The files that a session was made with."""

from __future__ import annotations

import hashlib
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
    size = path.stat().st_size
    if size > MAX_BYTES:
        raise DefinitionError(f"{path}: {size} bytes, expected at most {MAX_BYTES}")
    return path.read_bytes()


def stored_files(store: Store, files: Mapping[str, Mapping[str, str]]) -> dict[str, NamedFile]:
    """The files that a session was made with, from its store; AuditError when one was changed."""
    return {role: NamedFile(entry["name"], store.file(entry["sha256"])) for role, entry in files.items()}
