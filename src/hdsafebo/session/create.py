"""Making a session."""

from __future__ import annotations

import uuid
from importlib.metadata import version
from pathlib import Path
from typing import Any

from hdsafebo.session.advice.advisor import Advisor
from hdsafebo.session.advice.setup import make_search, make_space
from hdsafebo.session.definition import load_definition, parse_definition
from hdsafebo.session.files import INITIAL, NamedFile, digest, read_files
from hdsafebo.session.log.chain import START, seal
from hdsafebo.session.log.store import Clock, Store, utc_now
from hdsafebo.session.measuring.tables import read_table
from hdsafebo.session.session import Session
from hdsafebo.session.words import checked_name

_NO_TIME = "1970-01-01T00:00:00+00:00"


def create_session(
    directory: Path,
    definition_path: Path,
    *,
    who: str,
    initial: Path | None = None,
    embedding: Path | None = None,
    clock: Clock = utc_now,
) -> Session:
    """Make a session and open it.

    Args:
        directory: a new directory.
        definition_path: the session file (YAML).
        who: the person who makes it.
        initial: initial trials, CSV or parquet; None starts without data.
        embedding: `.safetensors` file of an embedding, its card beside it.
        clock: gives the time of log entries.

    Raises:
        SessionError: the definition or a file is malformed, or the directory holds a session already.
        HdSafeBOError: the method, its settings or the embedding do not fit the problem.
    """
    person = checked_name(who)
    definition = load_definition(definition_path)
    files = read_files(definition_path, definition, initial, embedding)
    rows: list[dict[str, Any]] = []
    if initial is not None:
        rows = make_space(definition).initial_trials(read_table(files[INITIAL].content, files[INITIAL].name))
    payload = {
        "session": uuid.uuid4().hex,
        "definition": definition.model_dump(mode="json"),
        "files": {role: {"name": f.name, "sha256": digest(f.content)} for role, f in files.items()},
        "initial": rows,
        "version": version("hdsafebo"),
        "source": str(definition_path.absolute()),
    }
    _rehearse(payload, files)
    store = Store.create(directory, clock)
    store.append(None, person, "created", payload, [f.content for f in files.values()])
    return Session(store)


def _rehearse(payload: dict[str, Any], files: dict[str, NamedFile]) -> None:
    """Set the optimiser up once in memory, so that no session is made whose method cannot work."""
    entry = seal(1, _NO_TIME, "nobody", "created", payload, START)
    definition = parse_definition(entry.payload["definition"])
    Advisor(definition, make_search(definition, files)).follow([entry])
