"""From a definition and the files it came with to the space and the search of a session."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

from hdsafebo.session.definition import BoxDefinition, Definition, ListDefinition, StimulationDefinition
from hdsafebo.session.errors import DefinitionError
from hdsafebo.session.generic_space import GenericSpace
from hdsafebo.session.list_set import ListSet, candidate_values
from hdsafebo.session.search import BoxSearch, Codec, FiniteSearch, Search
from hdsafebo.session.space import Space
from hdsafebo.session.stimulation_set import StimulationSet
from hdsafebo.session.stimulation_space import StimulationSpace
from hdsafebo.session.store import Store
from hdsafebo.session.tables import read_table

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


def make_space(definition: Definition) -> Space:
    """The space of a definition."""
    return (
        StimulationSpace(definition)
        if isinstance(definition, StimulationDefinition)
        else GenericSpace(definition)
    )


def stored_files(store: Store, files: Mapping[str, Mapping[str, str]]) -> dict[str, NamedFile]:
    """The files that a session was made with, from its store; AuditError when one was changed."""
    return {role: NamedFile(entry["name"], store.file(entry["sha256"])) for role, entry in files.items()}


def make_search(definition: Definition, files: Mapping[str, NamedFile]) -> Search:
    """A new search of a definition, with the files that the session was made with."""
    space = make_space(definition)
    embedding = _embedding(files)
    if isinstance(definition, StimulationDefinition):
        assert isinstance(space, StimulationSpace)
        candidates = StimulationSet(definition.priors, space.envelope, as_maps=embedding is not None)
        return FiniteSearch(space, candidates, embedding)
    assert isinstance(space, GenericSpace)
    if isinstance(definition, BoxDefinition):
        return BoxSearch(space, embedding)
    table = files[CANDIDATES]
    return FiniteSearch(
        space, ListSet(space, candidate_values(read_table(table.content, table.name), space)), embedding
    )


def _embedding(files: Mapping[str, NamedFile]) -> Codec | None:
    from hdsafebo.embeddings.registry import load_embedding

    tensors, card = files.get(EMBEDDING), files.get(EMBEDDING_CARD)
    if tensors is None or card is None:
        return None
    with TemporaryDirectory() as folder:
        path = Path(folder) / "embedding.safetensors"
        path.write_bytes(tensors.content)
        path.with_suffix(".json").write_bytes(card.content)
        return load_embedding(path)
