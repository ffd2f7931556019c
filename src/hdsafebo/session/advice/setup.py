"""From a definition and its files to the space and the search of a session."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory

from hdsafebo.problem import Codec
from hdsafebo.session.advice.search import BoxSearch, FiniteSearch, Search
from hdsafebo.session.candidates.list_set import ListSet, candidate_values
from hdsafebo.session.candidates.stimulation_set import SessionStimulationSet
from hdsafebo.session.definition import BoxDefinition, Definition, ListDefinition, StimulationDefinition
from hdsafebo.session.files import CANDIDATES, EMBEDDING, EMBEDDING_CARD, NamedFile
from hdsafebo.session.measuring.tables import read_table
from hdsafebo.session.spaces.generic import GenericSpace
from hdsafebo.session.spaces.space import Space
from hdsafebo.session.spaces.stimulation import StimulationSpace
from hdsafebo.typing import FloatArray


def make_space(definition: Definition, files: Mapping[str, NamedFile] | None = None) -> Space:
    """The space of a definition.

    Args:
        definition: as the session was made.
        files: that the session was made with; without them a list's own rows are not known.
    """
    if isinstance(definition, StimulationDefinition):
        return StimulationSpace(definition)
    space = GenericSpace(definition)
    if isinstance(definition, ListDefinition) and files is not None:
        space.rows = frozenset(map(tuple, _listed(space, files).tolist()))
    return space


def make_search(definition: Definition, files: Mapping[str, NamedFile]) -> Search:
    """A new search of a definition, with the files that the session was made with."""
    space = make_space(definition)
    embedding = _embedding(files)
    if isinstance(definition, StimulationDefinition):
        assert isinstance(space, StimulationSpace)
        candidates = SessionStimulationSet(definition.priors, space.envelope, as_maps=embedding is not None)
        return FiniteSearch(space, candidates, embedding)
    assert isinstance(space, GenericSpace)
    if isinstance(definition, BoxDefinition):
        return BoxSearch(space, embedding)
    return FiniteSearch(space, ListSet(space, _listed(space, files)), embedding)


def _listed(space: GenericSpace, files: Mapping[str, NamedFile]) -> FloatArray:
    """(N, D) rows of a list's table."""
    table = files[CANDIDATES]
    return candidate_values(read_table(table.content, table.name), space)


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
