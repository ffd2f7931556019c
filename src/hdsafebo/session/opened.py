"""An opened session, as far as it is looked at: what its log adds up to, and what the model believes.

Nothing here decides about a trial; the steps are in `session`.
"""

from __future__ import annotations

import threading
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Self

from hdsafebo.session.advice.advisor import Advisor
from hdsafebo.session.advice.advisor_cache import restored_advisor
from hdsafebo.session.advice.search import Search
from hdsafebo.session.advice.setup import make_search, make_space
from hdsafebo.session.definition import parse_definition
from hdsafebo.session.errors import AuditError, SessionError
from hdsafebo.session.files import stored_files
from hdsafebo.session.log.cache import Cache
from hdsafebo.session.log.chain import Entry
from hdsafebo.session.log.state import LoggedTrial, Point, State
from hdsafebo.session.log.stops import Stop
from hdsafebo.session.log.store import Clock, Store, utc_now
from hdsafebo.session.rules import Rules
from hdsafebo.session.turns import one_at_a_time

_DISCLAIMER = "Research software, not a medical device: a qualified person decides about every trial."
_DISCLAIMER_GENERIC = "Research software, not a safety system: a qualified person decides about every trial."


class OpenedSession:
    """What is in a session's log, and what follows from it.

    Several threads may use one object: its steps wait for each other. After an interrupt the log is read
    anew.

    Attributes:
        definition: the session file as the session was made; limits tightened since are in `space`.
        space: inputs, limits and results.
        store: the durable store.
        cache: optimiser states beside the log.
        state: what the log adds up to.
    """

    def __init__(self, store: Store) -> None:
        self._turn = threading.Lock()
        self._undone = False  # a step was begun and has not ended: what is in memory may be half of it
        self._follow(store)

    def _follow(self, store: Store) -> None:
        """Take in a whole log."""
        self.store = store
        self.cache = Cache(store.root)
        self.state = State()
        self._entries: list[Entry] = []
        self._waiting: list[Stop] = []
        entries = store.read()
        if not entries:
            raise SessionError(
                f"{store.directory}: making this session was interrupted; make it again with `new`"
            )
        created = entries[0].payload
        self.definition = parse_definition(created.get("definition", {}), source=str(store.directory))
        self._files = created.get("files", {})
        self.space = make_space(self.definition, stored_files(store, self._files))
        self._rules = Rules(self.space, make_space(self.definition))
        self._advisor: Advisor | None = None
        self._take(entries)
        self._refresh()

    def begin_anew(self) -> None:
        """Read the log from its beginning: an interrupt may have come between any two assignments.

        Raises:
            AuditError: it is not the log that was read before, or longer.
        """
        known = self._entries
        try:
            self._follow(self.store.opened_anew())
            if [e.hash for e in self._entries[: len(known)]] != [e.hash for e in known]:
                raise AuditError(
                    f"{self.store.directory}: the log was cut or replaced: it does not begin with the "
                    f"{len(known)} entries that were read before"
                )
        except BaseException:
            self._entries = known
            raise

    @classmethod
    def open(cls, directory: Path, *, clock: Clock = utc_now, read_only: bool = False) -> Self:
        """Open a session; the whole log is checked.

        Args:
            directory: of the session.
            clock: gives the time of entries.
            read_only: write nothing, not even to mend what is damaged.

        Raises:
            SessionError: there is no session.
            AuditError: its log was changed.
        """
        return cls(Store(directory, clock, read_only=read_only))

    def close(self) -> None:
        """Nothing is held open between steps; the session may be used again."""

    @property
    def stopped(self) -> str | None:
        """Why no trial may start now; None when the session runs. A stop counts before it is in the log."""
        return self._waiting[-1].reason if self._waiting else self.state.stopped

    @property
    def disclaimer(self) -> str:
        """What everybody who looks at the session is told first."""
        return _DISCLAIMER if self.definition.kind == "stimulation" else _DISCLAIMER_GENERIC

    @property
    def entries(self) -> Sequence[Entry]:
        """The log as far as it was read."""
        return self._entries

    @one_at_a_time
    def refresh(self) -> None:
        """Take in what others have appended to the log, and stops that wait for their place in it."""
        self._refresh()

    def _refresh(self) -> None:
        self._take(self.store.read())
        self._waiting = self.store.adopt_stops()
        self._take(self.store.read())

    def best(self, target: str | None = None, *, origin: str = "") -> LoggedTrial | None:
        """The safe trial with the highest outcome of a target.

        Args:
            target: default: the present one.
            origin: only trials of that origin count; empty counts all.
        """
        name = target or self.state.target
        safe = [
            t
            for t in self.state.trials
            if t.outcomes is not None and t.safety is not None and self.space.safe(t.safety)
        ]
        among = [t for t in safe if not origin or t.origin == origin]
        return max(among, key=lambda t: (t.outcomes or {})[name], default=None)

    def believe(self, point: Point) -> dict[str, Any] | None:
        """What the model believes of any point now; None while it knows nothing."""
        return next(iter(self.believe_all([point])), None)

    @one_at_a_time
    def believe_all(self, points: Sequence[Point]) -> list[dict[str, Any]]:
        """What the model believes of points now; nothing while it knows nothing."""
        self._refresh()
        return self._followed().believe([self.space.point(point) for point in points])

    @one_at_a_time
    def advisor(self) -> Advisor:
        """The optimiser, brought forward to the end of the log."""
        return self._followed()

    def _followed(self) -> Advisor:
        if self._advisor is None:
            restored = restored_advisor(self.definition, self._new_search, self.cache, self._entries)
            self._advisor = restored or self.new_advisor()
        known = self._advisor.state.head.seq if self._advisor.state.head else 0
        self._advisor.follow(self._entries[known:])
        return self._advisor

    def new_advisor(self) -> Advisor:
        """An optimiser that has not followed any of the log yet."""
        return Advisor(self.definition, self._new_search())

    def search(self) -> Search:
        """The permitted inputs as an optimiser sees them."""
        return self._new_search() if self._advisor is None else self._advisor.search

    def _new_search(self) -> Search:
        return make_search(self.definition, stored_files(self.store, self._files))

    def _take(self, entries: Sequence[Entry]) -> None:
        """Bring the state forward by entries of the log."""
        for entry in entries:
            self._rules.apply(self.state, entry)
            self._entries.append(entry)
