"""From a definition and its files to the space and the search of a session."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory

from hdsafebo.problem import Codec
from hdsafebo.session.advice.search import BoxSearch, FiniteSearch, Search
from hdsafebo.session.candidates.list_set import ListSet, candidate_values
from hdsafebo.session.candidates.stimulation_set import StimulationSet
from hdsafebo.session.definition import BoxDefinition, Definition, StimulationDefinition
from hdsafebo.session.files import CANDIDATES, EMBEDDING, EMBEDDING_CARD, NamedFile
from hdsafebo.session.measuring.tables import read_table
from hdsafebo.session.spaces.generic import GenericSpace
from hdsafebo.session.spaces.space import Space
from hdsafebo.session.spaces.stimulation import StimulationSpace


def make_space(definition: Definition) -> Space:
    """The space of a definition."""
    return (
        StimulationSpace(definition)
        if isinstance(definition, StimulationDefinition)
        else GenericSpace(definition)
    )


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
