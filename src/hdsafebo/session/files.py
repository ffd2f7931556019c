"""The files that a session was made with."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from hdsafebo.files.bounded import read_bounded
from hdsafebo.session.definition import Definition, ListDefinition
from hdsafebo.session.errors import DefinitionError
from hdsafebo.session.log.store import Store
from hdsafebo.session.measuring.tables import MAX_BYTES as MAX_TABLE_BYTES

INITIAL, EMBEDDING, EMBEDDING_CARD, CANDIDATES = "initial", "embedding", "embedding_card", "candidates"
_LIMITS = {
    INITIAL: MAX_TABLE_BYTES,
    CANDIDATES: MAX_TABLE_BYTES,
    EMBEDDING: 2**30,
    EMBEDDING_CARD: 2**20,
}


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
    return {role: _read(role, path) for role, path in paths.items()}


def candidates_file(definition_path: Path, definition: ListDefinition) -> NamedFile:
    """The table beside a session file as it is now; DefinitionError when it cannot be read."""
    return _read(CANDIDATES, definition_path.parent / definition.candidates)


def _read(role: str, path: Path) -> NamedFile:
    return NamedFile(path.name, read_bounded(path, _LIMITS[role], DefinitionError))


def stored_files(store: Store, files: Mapping[str, Mapping[str, str]]) -> dict[str, NamedFile]:
    """The files that a session was made with, from its store; AuditError when one was changed."""
    return {
        role: NamedFile(entry["name"], store.attachments.content(entry["sha256"]))
        for role, entry in files.items()
    }
