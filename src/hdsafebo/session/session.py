"""A session: trials with a person in the loop, one at a time.

    suggest -> approve | modify | refuse -> record          the optimiser's trials
               manual -> record                             the therapist's own
    stop, resume, switch_target, note                       at any time

Every step is on the disk before the call returns, and a suggestion is in the log before anyone sees it. A
suggestion expires when the state it was computed from is gone (a manual trial, another target, a stop).
This is research software, not a medical device.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from hdsafebo.errors import NoSafePointError
from hdsafebo.session.advice.advisor import Advisor
from hdsafebo.session.advice.advisor_cache import CACHE_AFTER, CACHE_BEFORE, restored_advisor
from hdsafebo.session.advice.search import Search
from hdsafebo.session.advice.setup import make_search, make_space
from hdsafebo.session.definition import parse_definition
from hdsafebo.session.errors import ExpiredError, ProtocolError, RecordingError, SessionError
from hdsafebo.session.files import stored_files
from hdsafebo.session.log.chain import Entry
from hdsafebo.session.log.state import Point, State, Suggestion, Trial
from hdsafebo.session.log.store import Act, Clock, MovedOnError, Store, utc_now
from hdsafebo.session.spaces.space import Report
from hdsafebo.session.words import checked_name, checked_text

DISCLAIMER = "Research software, not a medical device: a qualified person decides about every trial."
_LONGEST_TEXT = 2000
_ATTEMPTS = 3


class Session:
    """An open session; see the module. Make one with `create.create_session`, or open it.

    Attributes:
        definition: the session file.
        space: inputs, limits and results.
        store: the durable store.
        state: what the log adds up to.
    """

    def __init__(self, store: Store) -> None:
        self.store = store
        self.state = State()
        self._entries: list[Entry] = []
        self.refresh()
        if not self._entries:
            store.close()
            raise SessionError(
                f"{store.path.parent}: making this session was interrupted; make it again with `new`"
            )
        self.definition = parse_definition(self.state.definition, source=str(store.path))
        self.space = make_space(self.definition)
        self._advisor: Advisor | None = None

    @classmethod
    def open(cls, directory: Path, *, clock: Clock = utc_now) -> Session:
        """Open a session; the whole log is checked.

        Raises:
            SessionError: there is no session.
            AuditError: its log was changed.
        """
        return cls(Store(directory, clock))

    def close(self) -> None:
        """Close the store."""
        self.store.close()

    # --- the protocol

    def suggest(self, who: str) -> Suggestion:
        """The next suggestion; the open one again while it waits for its decision.

        Raises:
            ProtocolError: the session is stopped, a trial waits for its record, or the optimiser abstains.
        """
        person = checked_name(who)
        for _ in range(_ATTEMPTS):
            self.refresh()
            self._require_idle("suggest")
            if self.state.open_suggestion is not None:
                return self.state.open_suggestion
            try:
                return self._suggest_once(person)
            except MovedOnError:
                continue
        raise MovedOnError("others keep changing the session: look at its status and try again")

    def approve(self, who: str, suggestion: int | None = None) -> Trial:
        """Accept the open suggestion: its trial may be delivered now.

        Raises:
            ExpiredError: the suggestion has expired.
            ProtocolError: there is none, or it was decided before.
            LimitError: the hard limits do not permit it.
        """
        person = checked_name(who)
        self.refresh()
        chosen = self._open(suggestion)
        self.space.require_permitted(chosen.point, self.state.last_point)
        self._append(person, "approved", {"suggestion": chosen.number})
        return self._running()

    def modify(self, who: str, point: Point, reason: str, suggestion: int | None = None) -> Trial:
        """Replace the open suggestion's inputs by a person's, within the hard limits; see `approve`."""
        person, why = checked_name(who), checked_text(reason, "reason")
        self.refresh()
        chosen = self._open(suggestion)
        checked = self.space.point(point)
        self.space.require_permitted(checked, self.state.last_point)
        self._append(person, "modified", {"suggestion": chosen.number, "point": checked, "reason": why})
        return self._running()

    def refuse(self, who: str, reason: str, suggestion: int | None = None) -> Suggestion:
        """Turn the open suggestion down; it will not be made again. See `approve`."""
        person, why = checked_name(who), checked_text(reason, "reason")
        self.refresh()
        chosen = self._open(suggestion)
        self._append(person, "refused", {"suggestion": chosen.number, "reason": why})
        return self.state.suggestions[chosen.number - 1]

    def manual(self, who: str, point: Point, reason: str = "") -> Trial:
        """Start a trial of one's own within the hard limits; an open suggestion expires.

        Raises:
            ProtocolError: the session is stopped, or a trial waits for its record.
            LimitError: malformed inputs, or outside the hard limits.
        """
        person, why = checked_name(who), checked_text(reason, "reason", needed=False)
        self.refresh()
        self._require_idle("start a manual trial")
        checked = self.space.point(point)
        self.space.require_permitted(checked, self.state.last_point)
        self._append(person, "manual", {"point": checked, "reason": why})
        return self._running()

    def record(self, who: str, report: Report, trial: int | None = None, *, remark: str = "") -> Trial:
        """Record what came back from the running trial. Recording the same again changes nothing.

        Args:
            who: the person.
            report: recording and values. Without outcomes (a missing recording) the trial counts as
                failed, and its safety values are kept.
            trial: its number; None takes the running one.
            remark: free text.

        Raises:
            RecordingError: a malformed recording, or a value missing or out of range; nothing is recorded.
            ProtocolError: no trial waits for a record, or another record exists, which stays.
        """
        person, kept = checked_name(who), checked_text(remark, "remark", needed=False)
        self.refresh()
        number = self._recordable(trial)
        labels = {"session": self.state.session, "trial": str(number)}
        measured = self.space.measure(report, labels)
        payload = {
            "trial": number,
            "outcomes": measured.outcomes,
            "safety": measured.safety,
            "details": measured.details | ({"remark": kept} if kept else {}),
            "failure": None if measured.outcomes is not None else "no outcome was measured",
            "delivered": True,
        }
        files = [] if report.recording is None else [report.recording[0]]
        return self._record(person, payload, files)

    def not_delivered(self, who: str, reason: str, trial: int | None = None) -> Trial:
        """Close the running trial without a result: it was not delivered."""
        person, why = checked_name(who), checked_text(reason, "reason")
        self.refresh()
        number = self._recordable(trial)
        empty: dict[str, Any] = {"outcomes": None, "safety": None, "details": {}}
        return self._record(person, {"trial": number, "failure": why, "delivered": False} | empty, [])

    def stop(self, who: str, reason: str) -> None:
        """Let no trial start until `resume`; what runs can still be recorded. Stopping twice is one stop."""
        person, why = checked_name(who), checked_text(reason, "reason")
        for _ in range(_ATTEMPTS):
            self.refresh()
            if self.state.stopped is not None:
                return None
            try:
                return self._append(person, "stopped", {"reason": why})
            except MovedOnError:
                continue
        raise MovedOnError("others keep changing the session: stop it again")

    def resume(self, who: str) -> None:
        """Go on after a stop; steps are limited from the start values again."""
        person = checked_name(who)
        self.refresh()
        if self.state.stopped is None:
            raise ProtocolError("the session is not stopped")
        self._append(person, "resumed", {})

    def switch_target(self, who: str, target: str) -> None:
        """Optimise another objective from now on; all history is reused."""
        person = checked_name(who)
        self.refresh()
        if target not in self.space.targets:
            raise ProtocolError(
                f"target {target!r} is unknown; the session has {', '.join(self.space.targets)}"
            )
        if target == self.state.target:
            raise ProtocolError(f"{target} is the target already")
        self._require_recorded("switch the target")
        self._append(person, "target_switched", {"target": target})

    def note(self, who: str, text: str) -> None:
        """Keep a remark in the log."""
        person, words = checked_name(who), checked_text(text, "note")
        self.refresh()
        self._append(person, "noted", {"text": words})

    # --- looking at it

    @property
    def entries(self) -> Sequence[Entry]:
        """The log as far as it was read."""
        return self._entries

    def refresh(self) -> None:
        """Take in what others have appended to the log."""
        for entry in self.store.entries(self.state.head):
            self.state.apply(entry)
            self._entries.append(entry)

    def best(self, target: str | None = None, *, origin: str = "") -> Trial | None:
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
        self.refresh()
        return self.advisor().believe(self.space.point(point))

    def advisor(self) -> Advisor:
        """The optimiser, brought forward to the end of the log."""
        if self._advisor is None:
            self._advisor = restored_advisor(self.definition, self.store, self._entries) or self.new_advisor()
        known = self._advisor.state.head.seq if self._advisor.state.head else 0
        self._advisor.follow(self._entries[known:])
        return self._advisor

    def new_advisor(self) -> Advisor:
        """An optimiser that has not followed any of the log yet."""
        return Advisor(self.definition, self._new_search())

    def search(self) -> Search:
        """The permitted inputs as an optimiser sees them."""
        return self._new_search() if self._advisor is None else self._advisor.search

    # --- internals

    def _new_search(self) -> Search:
        return make_search(self.definition, stored_files(self.store, self.state.files))

    def _suggest_once(self, person: str) -> Suggestion:
        advisor = self.advisor()
        head = self.state.head
        assert head is not None
        try:
            advice = advisor.advise()
        except NoSafePointError as error:
            self._append(
                person, "abstained", {"based_on": head.seq, "target": self.state.target, "reason": str(error)}
            )
            raise ProtocolError(f"no suggestion: {error}") from None
        self.space.require_permitted(advice.point, self.state.last_point)
        payload = {
            "based_on": head.seq,
            "target": self.state.target,
            "point": advice.point,
            "belief": advice.belief,
        }
        try:
            self._append(
                person,
                "suggested",
                payload,
                cache=[(CACHE_BEFORE, advice.before), (CACHE_AFTER, advice.after)],
            )
        except BaseException:
            advisor.withdraw()
            raise
        suggestion = self.state.open_suggestion
        assert suggestion is not None
        return suggestion

    def _append(
        self,
        person: str,
        kind: str,
        payload: dict[str, Any],
        *,
        files: Sequence[bytes] = (),
        cache: Sequence[tuple[str, bytes]] = (),
    ) -> None:
        acts: list[Act] = [(kind, payload)]
        for entry in self.store.append(self.state.head, person, acts, files, cache):
            self.state.apply(entry)
            self._entries.append(entry)

    def _record(self, person: str, payload: dict[str, Any], files: Sequence[bytes]) -> Trial:
        trial = self.state.trials[payload["trial"] - 1]
        if trial.status != "running":
            same = all(
                getattr(trial, key) == payload[key]
                for key in ("outcomes", "safety", "details", "failure", "delivered")
            )
            if same:
                return trial
            raise ProtocolError(f"trial {trial.number} has another record already, which stays")
        self._require_new_recording(payload)
        self._append(person, "recorded", payload, files=files)
        return self.state.trials[trial.number - 1]

    def _require_new_recording(self, payload: dict[str, Any]) -> None:
        recording = payload["details"].get("recording")
        if recording is None:
            return
        for trial in self.state.trials:
            if trial.details.get("recording", {}).get("sha256") == recording["sha256"]:
                raise RecordingError(
                    f"{recording['name']}: this recording belongs to trial {trial.number} already"
                )

    def _recordable(self, trial: int | None) -> int:
        running = self.state.running
        if trial is None:
            if running is None:
                raise ProtocolError(
                    "no trial waits for a record: approve a suggestion or start a manual trial first"
                )
            return running.number
        first = sum(t.origin == "initial" for t in self.state.trials) + 1
        if not first <= trial <= len(self.state.trials):
            raise ProtocolError(
                f"there is no trial {trial} of this session; it has {first} to {len(self.state.trials)}"
            )
        return trial

    def _open(self, number: int | None) -> Suggestion:
        """The open suggestion; with a number, exactly that one."""
        self._require_running_session("decide")
        open_one = self.state.open_suggestion
        if number is None:
            if open_one is None:
                raise ProtocolError("no suggestion waits for a decision: ask for one first")
            return open_one
        if not 1 <= number <= len(self.state.suggestions):
            raise ProtocolError(f"there is no suggestion {number}; the last is {len(self.state.suggestions)}")
        suggestion = self.state.suggestions[number - 1]
        if suggestion.decision == "expired":
            raise ExpiredError(
                f"suggestion {number} has expired: the state it was computed from is gone; ask for a new one"
            )
        if suggestion.decision != "open":
            raise ProtocolError(f"suggestion {number} was {suggestion.decision} before")
        return suggestion

    def _require_idle(self, what: str) -> None:
        self._require_running_session(what)
        self._require_recorded(what)

    def _require_running_session(self, what: str) -> None:
        if self.state.stopped is not None:
            raise ProtocolError(
                f"cannot {what}: the session is stopped ({self.state.stopped}); resume it first"
            )

    def _require_recorded(self, what: str) -> None:
        if self.state.running is not None:
            raise ProtocolError(f"cannot {what}: trial {self.state.running.number} waits for its record")

    def _running(self) -> Trial:
        trial = self.state.running
        assert trial is not None
        return trial
