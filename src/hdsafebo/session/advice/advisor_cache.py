"""Optimiser states kept beside the log, so that opening a session does not repeat every fit of its past."""

from __future__ import annotations

from hdsafebo.errors import StateFileError
from hdsafebo.session.advice.advisor import Advisor
from hdsafebo.session.advice.setup import make_search
from hdsafebo.session.definition import Definition
from hdsafebo.session.files import stored_files
from hdsafebo.session.log.chain import Entry
from hdsafebo.session.log.store import Store

CACHE_BEFORE, CACHE_AFTER = "optimiser before", "optimiser after"


def restored_advisor(definition: Definition, store: Store, entries: list[Entry]) -> Advisor | None:
    """The advisor as it was at the last suggestion; None when the kept states are missing or of no use."""
    before, after = store.cached(CACHE_BEFORE), store.cached(CACHE_AFTER)
    if before is None or after is None or before[0] != after[0] or not 0 < after[0] <= len(entries):
        return None
    known = entries[: after[0]]
    search = make_search(definition, stored_files(store, known[0].payload["files"]))
    try:
        return Advisor.restore(definition, search, known, before[1], after[1])
    except StateFileError:
        return None
