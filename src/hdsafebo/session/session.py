"""A session: trials with a person in the loop, one at a time.

    suggest -> approve | modify | refuse -> record          the optimiser's trials
               manual -> record                             the therapist's own
    stop, resume, switch_target, note, tighten              at any time

Every step is on the disk before the call returns, and a suggestion is in the log before anyone sees it. A
suggestion expires when the state it was computed from is gone (a manual trial, another target, a stop).
This is research software, not a medical device.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from hdsafebo.errors import NoSafePointError
from hdsafebo.session.definition import load_definition, parse_definition
from hdsafebo.session.errors import ProtocolError, StoppedError
from hdsafebo.session.log.state import LoggedSuggestion, LoggedTrial, Point
from hdsafebo.session.log.stops import pending, press
from hdsafebo.session.log.store import STARTING, MovedOnError, Store, utc_now
from hdsafebo.session.opened import OpenedSession
from hdsafebo.session.rules import open_suggestion, recordable, require_idle, same_recording
from hdsafebo.session.session_file import require_no_more_care
from hdsafebo.session.spaces.space import Report
from hdsafebo.session.tightening import Change, require_tighter
from hdsafebo.session.turns import in_turn, one_at_a_time
from hdsafebo.session.words import checked_name, checked_number, checked_text

_ATTEMPTS = 3
_DELIVERING = ("approved", "modified", "manual")


class Session(OpenedSession):
    """An open session; see the module. Make one with `create.create_session`, or open it.

    Its attributes are those of `OpenedSession`.
    """

    def __init__(self, store: Store) -> None:
        super().__init__(store)
        self._seen: str | None = None  # see `seen_at`

    # --- the protocol

    @one_at_a_time
    def suggest(self, who: str) -> LoggedSuggestion:
        """The next suggestion; the open one again while it waits for its decision.

        Raises:
            ProtocolError: the session is stopped, a trial waits for its record, or the optimiser abstains.
        """
        person = checked_name(who)
        for _ in range(_ATTEMPTS):
            self._refresh()
            self._require_as_seen()
            require_no_more_care(self.state, self.space)
            require_idle(self.state, "suggest")
            if self.state.open_suggestion is not None:
                return self.state.open_suggestion
            try:
                return self._suggest_once(person)
            except MovedOnError:
                continue
        raise MovedOnError("others keep changing the session: look at its status and try again")

    @one_at_a_time
    def approve(self, who: str, suggestion: int) -> LoggedTrial:
        """Accept the open suggestion: its trial may be delivered now.

        Args:
            who: the person.
            suggestion: number of the suggestion that this person has seen.

        Raises:
            ExpiredError: the suggestion has expired.
            StoppedError: the session was stopped meanwhile.
            ProtocolError: there is none of that number, or it was decided before.
            LimitError: the hard limits do not permit it.
            DefinitionError: the session file was tightened and not applied yet.
        """
        person, number = checked_name(who), checked_number(suggestion, "suggestion")
        self._refresh_to_start()
        self._append(person, "approved", {"suggestion": number})
        return self._running()

    @one_at_a_time
    def modify(self, who: str, point: Point, reason: str, suggestion: int) -> LoggedTrial:
        """Replace the open suggestion's inputs by a person's, within the hard limits; see `approve`."""
        person, why = checked_name(who), checked_text(reason, "reason")
        number = checked_number(suggestion, "suggestion")
        self._refresh_to_start()
        open_suggestion(self.state, number)
        checked = self.space.point(point)
        self._append(person, "modified", {"suggestion": number, "point": checked, "reason": why})
        return self._running()

    @one_at_a_time
    def refuse(self, who: str, reason: str, suggestion: int) -> LoggedSuggestion:
        """Turn the open suggestion down; it will not be made again. See `approve`."""
        person, why = checked_name(who), checked_text(reason, "reason")
        number = checked_number(suggestion, "suggestion")
        self._refresh()
        self._append(person, "refused", {"suggestion": number, "reason": why})
        return self.state.suggestions[number - 1]

    @one_at_a_time
    def manual(self, who: str, point: Point, reason: str = "") -> LoggedTrial:
        """Start a trial of one's own within the hard limits; an open suggestion expires.

        Raises:
            StoppedError: the session was stopped meanwhile.
            ProtocolError: the session is stopped, or a trial waits for its record.
            LimitError: malformed inputs, or outside the hard limits.
            DefinitionError: the session file was tightened and not applied yet.
        """
        person, why = checked_name(who), checked_text(reason, "reason", needed=False)
        self._refresh_to_start()
        require_idle(self.state, "start a manual trial")
        self._append(person, "manual", {"point": self.space.point(point), "reason": why})
        return self._running()

    @one_at_a_time
    def record(self, who: str, report: Report, trial: int | None = None, *, remark: str = "") -> LoggedTrial:
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
        wanted = None if trial is None else checked_number(trial, "trial")
        self._refresh()
        number = recordable(self.state, wanted).number
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

    @one_at_a_time
    def not_delivered(self, who: str, reason: str, trial: int | None = None) -> LoggedTrial:
        """Close the running trial without a result: it was not delivered."""
        person, why = checked_name(who), checked_text(reason, "reason")
        wanted = None if trial is None else checked_number(trial, "trial")
        self._refresh()
        number = recordable(self.state, wanted).number
        empty: dict[str, Any] = {"outcomes": None, "safety": None, "details": {}}
        return self._record(person, {"trial": number, "failure": why, "delivered": False} | empty, [])

    def stop(self, who: str, reason: str) -> bool:
        """Let no trial start until `resume`; what runs can still be recorded.

        Obeyed when this returns, whatever others are doing: no text is refused, and nobody's lock is waited
        for. Words are cut to what can be kept.

        Returns:
            True when the stop is in the log already; otherwise whoever can write the log next adds it.

        Raises:
            SessionError: the session's directory cannot be written, so nothing can start from it either.
        """
        press(self.store.directory, who, reason, utc_now())
        self._waiting = pending(self.store.directory)
        if not self._turn.acquire(blocking=False):  # another thread is at a step, which finds the stop
            return False
        try:
            in_turn(self, OpenedSession._refresh)
        finally:
            self._turn.release()
        return not self._waiting

    def resume(self, who: str) -> None:
        """Go on after a stop; steps are limited from the start values again.

        Raises:
            MovedOnError: somebody stopped the session since it was looked at here: nobody goes on over a stop
                that he has not seen.
        """
        person = checked_name(who)
        with self._turn:
            in_turn(self, Session._resume, person, self._stops())

    def _resume(self, person: str, seen: set[str]) -> None:
        self._refresh()
        if self._stops() != seen:
            raise MovedOnError(f"the session was stopped again meanwhile ({self.stopped}): look, then resume")
        self._append(person, "resumed", {})

    @one_at_a_time
    def switch_target(self, who: str, target: str) -> None:
        """Optimise another objective from now on; all history is reused."""
        person = checked_name(who)
        self._refresh()
        self._append(person, "target_switched", {"target": target})

    @one_at_a_time
    def note(self, who: str, text: str) -> None:
        """Keep a remark in the log."""
        person, words = checked_name(who), checked_text(text, "note")
        self._refresh()
        self._append(person, "noted", {"text": words})

    @one_at_a_time
    def tighten(self, who: str, path: Path, reason: str = "") -> list[Change]:
        """Let the tighter hard limits of a session file hold from now on; what they are.

        An open suggestion expires, and steps are limited from the start values again.

        Raises:
            DefinitionError: the file is malformed, or changes something else, or nothing.
            ProtocolError: a trial waits for its record.
        """
        person, why = checked_name(who), checked_text(reason, "reason", needed=False)
        self._refresh()
        wanted = load_definition(path)
        made = require_tighter(parse_definition(self.state.definition), wanted)
        self._append(person, "tightened", {"definition": wanted.model_dump(mode="json"), "reason": why})
        return made

    @contextmanager
    def seen_at(self, head: str) -> Iterator[None]:
        """Steps within are refused when the log has moved on from what the person saw.

        Args:
            head: hash of the entry that was the last one.
        """
        before, self._seen = self._seen, head
        try:
            yield
        finally:
            self._seen = before

    # --- internals

    def _refresh_to_start(self) -> None:
        """As `refresh`, before a step that may start a trial."""
        self._refresh()
        require_no_more_care(self.state, self.space)

    def _suggest_once(self, person: str) -> LoggedSuggestion:
        advisor = self._followed()
        head = self.state.head
        assert head is not None
        computed = {"based_on": head.seq, "target": self.state.target}
        try:
            advice = advisor.advise()
        except NoSafePointError as error:
            self._append(person, "abstained", {**computed, "reason": str(error)})
            raise ProtocolError(f"no suggestion: {error}") from None
        try:
            self._append(person, "suggested", {**computed, "point": advice.point, "belief": advice.belief})
        except BaseException:
            advisor.withdraw()
            raise
        suggestion = self.state.open_suggestion
        if suggestion is None:
            raise MovedOnError("the session was stopped while the suggestion was computed")
        entry = next(e for e in reversed(self._entries) if e.kind == "suggested")
        self.cache.write(entry, advice.before, advice.after)
        return suggestion

    def _append(self, person: str, kind: str, payload: dict[str, Any], files: Sequence[bytes] = ()) -> None:
        """Take a step: the rules first, then the disk, then the state.

        Raises:
            StoppedError: the session was stopped while a trial was being started.
            MovedOnError: the log is not where the person saw it.
        """
        self._require_as_seen()
        if kind in STARTING and self._waiting:
            left = ", ".join(stop.token for stop in self._waiting)
            raise StoppedError(
                f"the session is stopped ({self.stopped}); it can be resumed when the log can be written and "
                f"{left} removed from {self.store.directory}"
            )
        self._rules.check(self.state, kind, payload)
        self.store.append(self.state.head, person, kind, payload, files)
        waiting = kind in _DELIVERING and bool(pending(self.store.directory))
        self._take(self.store.read())  # after the look: a stop that waits no more is in the log
        if kind in _DELIVERING and (waiting or self.state.stopped is not None):
            self._refresh()
            raise StoppedError(
                f"STOP was pressed meanwhile: do not deliver trial {len(self.state.trials)}; "
                "close it as not delivered"
            )

    def _require_as_seen(self) -> None:
        """MovedOnError when somebody appended behind what the person saw; see `seen_at`."""
        if self._seen is not None and (self.state.head is None or self.state.head.hash != self._seen):
            raise MovedOnError("the session has moved on: look again, then decide")

    def _stops(self) -> set[str]:
        """Tokens of all stops that are known here."""
        return self.state.stops | {stop.token for stop in self._waiting}

    def _record(self, person: str, payload: dict[str, Any], files: Sequence[bytes]) -> LoggedTrial:
        trial = self.state.trials[payload["trial"] - 1]
        if trial.status != "running" and _same_result(trial, payload):
            return trial
        self._append(person, "recorded", payload, files)
        return self.state.trials[trial.number - 1]

    def _running(self) -> LoggedTrial:
        """The trial that was just started."""
        return self.state.trials[-1]


def _same_result(trial: LoggedTrial, payload: dict[str, Any]) -> bool:
    """Whether a record says what a trial's record says already; a recording's file may be another one."""
    one, other = trial.details, payload["details"]
    if "recording" in one and same_recording(one["recording"], other.get("recording")):
        one, other = one | {"recording": None}, other | {"recording": None}
    same = all(getattr(trial, key) == payload[key] for key in ("outcomes", "safety", "failure", "delivered"))
    return same and one == other
