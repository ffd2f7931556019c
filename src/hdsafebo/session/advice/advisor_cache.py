"""An advisor from cached states of its optimiser, so that opening a session does not repeat every fit."""

from __future__ import annotations

from collections.abc import Callable

from hdsafebo.errors import HdSafeBOError
from hdsafebo.session.advice.advisor import Advisor
from hdsafebo.session.advice.search import Search
from hdsafebo.session.definition import Definition
from hdsafebo.session.log.cache import Cache
from hdsafebo.session.log.chain import Entry


def restored_advisor(
    definition: Definition, make_search: Callable[[], Search], cache: Cache, entries: list[Entry]
) -> Advisor | None:
    """The advisor as it was at the last suggestion whose states are kept.

    Args:
        definition: of the session.
        make_search: gives a new search of it.
        cache: of the session.
        entries: the log.

    Returns:
        None when the kept states are missing, damaged, or of an entry that is not in the log.
    """
    kept = cache.read()
    if kept is None:
        return None
    digest, before, after = kept
    known = next((i for i, e in enumerate(entries, start=1) if e.hash == digest), 0)
    if known == 0 or entries[known - 1].kind != "suggested":
        return None
    try:
        return Advisor.restore(definition, make_search(), entries[:known], before, after)
    except HdSafeBOError:
        return None
