"""The session file as it lies on the disk now, after the session was made.

Whoever edits the file believes that it holds. A running session takes no change from it by itself, so no
trial starts while the file asks for more care than is in force, in whatever way; wider limits in it have no
effect.
"""

from __future__ import annotations

from pathlib import Path

from hdsafebo.files.bounded import require_regular
from hdsafebo.files.yaml import read_mapping
from hdsafebo.session.advice.setup import make_space
from hdsafebo.session.definition import Definition, ListDefinition, parse_definition
from hdsafebo.session.errors import DefinitionError, RecordingError
from hdsafebo.session.files import CANDIDATES, candidates_file, digest
from hdsafebo.session.log.state import State
from hdsafebo.session.spaces.generic import GenericSpace
from hdsafebo.session.spaces.space import Space
from hdsafebo.session.tightening import changes, describe, more_care


def require_no_more_care(state: State, space: Space) -> None:
    """Nothing, unless the session file asks for more care than is in force.

    A file that is gone, that may not be read, or that is of another session (another name or kind) says
    nothing.

    Args:
        state: of the session.
        space: of the session.

    Raises:
        DefinitionError: the file draws a limit tighter, which must be applied first; or it cannot be read as
            a session file, or differs in what may be delivered or counts as safe, other than by being wider.
    """
    if not state.source:
        return
    source, held = Path(state.source), parse_definition(state.definition)
    wanted = _wanted(source, held)
    if wanted is None:
        return
    if others := more_care(held, wanted):
        raise DefinitionError(
            f"{source} was changed after the session was made: {describe(others)}. A running session takes "
            "tighter hard limits alone: take the change back, or begin another session"
        )
    tighter, _ = changes(held, wanted)
    if tighter:
        raise DefinitionError(
            f"{source} was tightened after the session was made: {describe(tighter)}. Apply it with "
            "`hdsafebo session tighten`, or take the change back"
        )
    if isinstance(wanted, ListDefinition) and isinstance(space, GenericSpace):
        _require_all_rows(source, wanted, state, space)


def _wanted(source: Path, held: Definition) -> Definition | None:
    """What the session file says now; None where it says nothing about this session."""
    try:
        require_regular(source)
    except OSError:
        return None
    try:
        data = read_mapping(source, DefinitionError)
        if (data.get("name", held.name), data.get("kind", held.kind)) != (held.name, held.kind):
            return None
        return parse_definition(data, source=str(source))
    except DefinitionError as error:
        raise DefinitionError(
            f"{error}\nThe session file was changed after the session was made, and nobody knows what it "
            "means to limit: correct it, or move it away"
        ) from None


def _require_all_rows(source: Path, wanted: ListDefinition, state: State, space: GenericSpace) -> None:
    """DefinitionError when rows of the list that may be delivered were taken out of its file."""
    path = source.parent / wanted.candidates
    try:
        require_regular(path)
    except OSError:
        return
    file = candidates_file(source, wanted)
    if space.rows is None or digest(file.content) == state.files[CANDIDATES]["sha256"]:
        return
    try:
        now = make_space(wanted, {CANDIDATES: file})
    except RecordingError as error:
        raise DefinitionError(
            f"{error}\nThe list was changed after the session was made: correct the file, or move it away"
        ) from None
    assert isinstance(now, GenericSpace)
    gone = sorted(set(space.rows) - set(now.rows or ()))
    if gone:
        first = space.describe({"values": list(gone[0])})
        raise DefinitionError(
            f"{path}: {len(gone)} rows were taken out after the session was made, the first of them {first}. "
            "A running session goes on with the list that it was made with: put them back, or begin another "
            "session"
        )
