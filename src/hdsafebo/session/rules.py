"""The rules of the protocol: which step may follow what has happened, and within which limits.

The same rules stand before every step that is taken, and are applied again to every entry of a log when it is
verified: a log whose chain is right need not be of steps that were permitted.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from hdsafebo.session.definition import parse_definition
from hdsafebo.session.errors import AuditError, ExpiredError, ProtocolError, RecordingError, SessionError
from hdsafebo.session.log.chain import Entry
from hdsafebo.session.log.state import LoggedSuggestion, LoggedTrial, Point, State
from hdsafebo.session.spaces.space import Space
from hdsafebo.session.tightening import require_tighter

Payload = dict[str, Any]


class Rules:
    """See the module.

    Args:
        space: of the session; tightened limits are applied to it by `apply`.
        beyond_list: the same without the list of a session's only rows, for entries that were made when other
            rows were allowed; None when there never was such a time.
    """

    def __init__(self, space: Space, beyond_list: Space | None = None) -> None:
        self._space = space
        self._beyond_list = beyond_list or space

    def check(self, state: State, kind: str, payload: Payload) -> None:
        """Whether a step may follow.

        Args:
            state: before the step.
            kind: of the step.
            payload: of its entry.

        Raises:
            ProtocolError: the step does not fit what has happened.
            LimitError: inputs outside the hard limits.
            RecordingError: results that do not follow from what was measured.
            DefinitionError: limits that are not tighter.
        """
        if not state.session:
            if kind != "created":
                raise ProtocolError("the first entry of a log makes the session")
            return self._check_initial(payload)
        check = getattr(self, f"_{kind}", None)
        if check is not None:
            check(state, payload)
        return None

    def apply(self, state: State, entry: Entry) -> None:
        """Bring a state forward by an entry of the log, and the limits with it; see `State.apply`.

        Raises:
            AuditError: the entry's inputs, names or definition are not of this kind of session.
        """
        try:
            self._check_form(entry.kind, entry.payload)
        except SessionError as error:
            raise AuditError(f"log entry {entry.seq} ({entry.kind}): {error}") from None
        state.apply(entry)
        if entry.kind == "tightened":
            self.tighten(state)

    def tighten(self, state: State) -> None:
        """Let the limits that are in force in a state hold."""
        definition = parse_definition(state.definition)
        for space in (self._space, self._beyond_list):
            space.tighten(definition)

    def _check_form(self, kind: str, p: Payload) -> None:
        """Whether names and inputs are of this kind of session at all."""
        if "point" in p and self._space.point(_without_nothing(p["point"])) != p["point"]:
            raise ProtocolError("the inputs are not written as this kind of session writes them")
        if kind != "created" and "target" in p and p["target"] not in self._space.targets:
            raise ProtocolError(f"target {str(p['target'])[:80]!r} is unknown")
        if kind == "created":
            for row in p["initial"]:
                self._check_form("", {"point": row["point"], **_results(row)})
        if "belief" in p and set(p["belief"]["safety"]) != {s.name for s in self._space.safety}:
            raise ProtocolError("a belief of other safety functions")
        if p.get("outcomes") is not None and set(p["outcomes"]) != set(self._space.targets):
            raise ProtocolError("outcomes of other names")
        if p.get("safety") is not None and set(p["safety"]) != {s.name for s in self._space.safety}:
            raise ProtocolError("safety values of other names")

    # --- one rule per kind of entry

    def _created(self, state: State, p: Payload) -> None:
        raise ProtocolError("the session is made already")

    def _suggested(self, state: State, p: Payload) -> None:
        require_idle(state, "suggest")
        if state.open_suggestion is not None:
            raise ProtocolError(f"suggestion {state.open_suggestion.number} waits for a decision")
        self._require_present(state, p)
        self._require_permitted(state, p["point"])

    def _abstained(self, state: State, p: Payload) -> None:
        require_idle(state, "suggest")
        self._require_present(state, p)

    def _approved(self, state: State, p: Payload) -> None:
        self._require_permitted(state, open_suggestion(state, p["suggestion"]).point)

    def _modified(self, state: State, p: Payload) -> None:
        open_suggestion(state, p["suggestion"])
        self._require_permitted(state, p["point"])

    def _refused(self, state: State, p: Payload) -> None:
        open_suggestion(state, p["suggestion"])

    def _manual(self, state: State, p: Payload) -> None:
        require_idle(state, "start a manual trial")
        self._require_permitted(state, p["point"])

    def _recorded(self, state: State, p: Payload) -> None:
        trial = recordable(state, p["trial"])
        if trial.status != "running":
            raise ProtocolError(f"trial {trial.number} has another record already, which stays")
        if not p["delivered"]:
            if p["outcomes"] is not None or p["safety"] is not None or not p["failure"]:
                raise RecordingError("results of a trial that was not delivered, or no reason why")
            return
        if p["safety"] is None or (p["failure"] is None) == (p["outcomes"] is None):
            raise RecordingError("a delivered trial without safety values, or a failure with outcomes")
        self._space.check_result(p)
        recording = p["details"].get("recording")
        if recording is not None:
            self._require_new(state, recording)

    def _target_switched(self, state: State, p: Payload) -> None:
        if p["target"] not in self._space.targets:
            raise ProtocolError(
                f"target {p['target']!r} is unknown; the session has {', '.join(self._space.targets)}"
            )
        if p["target"] == state.target:
            raise ProtocolError(f"{p['target']} is the target already")
        require_recorded(state, "switch the target")

    def _resumed(self, state: State, p: Payload) -> None:
        if state.stopped is None:
            raise ProtocolError("the session is not stopped")

    def _tightened(self, state: State, p: Payload) -> None:
        require_recorded(state, "tighten limits")
        require_tighter(parse_definition(state.definition), parse_definition(p["definition"]))

    # --- what several need

    def _check_initial(self, p: Payload) -> None:
        if p["definition"]["target"] not in self._space.targets:
            raise ProtocolError(f"target {p['definition']['target']!r} is unknown")
        for number, row in enumerate(p["initial"], start=1):
            if row["safety"] is None:
                raise RecordingError(f"initial trial {number} has no safety values")
            self._space.check_result(row)

    def _require_present(self, state: State, p: Payload) -> None:
        """What was computed belongs to the present state."""
        assert state.head is not None
        if p["based_on"] != state.head.seq or p["target"] != state.target:
            raise ProtocolError(
                f"computed for {p['target']} from entry {p['based_on']}, but the log is at entry "
                f"{state.head.seq} with the target {state.target}"
            )

    def _require_permitted(self, state: State, point: Point) -> None:
        space = self._space if state.rows_only else self._beyond_list
        space.require_permitted(point, state.last_point)

    @staticmethod
    def _require_new(state: State, recording: Payload) -> None:
        """The same samples are no second trial's, whatever their file is called or says besides."""
        for key in ("sha256", "samples_sha256"):
            if recording.get(key) in state.recordings:
                trial = state.recordings[recording[key]]
                raise RecordingError(f"{recording['name']}: this recording belongs to trial {trial} already")


def same_recording(one: Payload | None, other: Payload | None) -> bool:
    """Whether two recordings hold the same samples; neither being there is no such case."""
    if one is None or other is None:
        return False
    return any(
        one.get(key) is not None and one.get(key) == other.get(key) for key in ("sha256", "samples_sha256")
    )


def open_suggestion(state: State, number: int) -> LoggedSuggestion:
    """The suggestion of a number, if it waits for its decision.

    Raises:
        ExpiredError: it has expired.
        ProtocolError: the session is stopped, there is no such suggestion, or it was decided before.
    """
    require_not_stopped(state, "decide")
    if not state.suggestions:
        raise ProtocolError("no suggestion waits for a decision: ask for one first")
    if not 1 <= number <= len(state.suggestions):
        raise ProtocolError(f"there is no suggestion {number}; the last is {len(state.suggestions)}")
    suggestion = state.suggestions[number - 1]
    if suggestion.decision == "expired":
        raise ExpiredError(
            f"suggestion {number} has expired: the state it was computed from is gone; ask for a new one"
        )
    if suggestion.decision != "open":
        raise ProtocolError(f"suggestion {number} was {suggestion.decision} before")
    return suggestion


def recordable(state: State, number: int | None) -> LoggedTrial:
    """The trial of a number, or the running one; ProtocolError when there is none of this session."""
    if number is None:
        waiting = state.running_trials
        if not waiting:
            raise ProtocolError(
                "no trial waits for a record: approve a suggestion or start a manual trial first"
            )
        if len(waiting) > 1:
            raise ProtocolError(f"trials {_numbers(waiting)} wait for their records: say which one")
        return waiting[0]
    first = state.initial + 1
    if not first <= number <= len(state.trials):
        raise ProtocolError(
            f"there is no trial {number} of this session; it has {first} to {len(state.trials)}"
        )
    return state.trials[number - 1]


def require_idle(state: State, what: str) -> None:
    """ProtocolError while the session is stopped, or as many trials run as may at the same time."""
    require_not_stopped(state, what)
    if len(state.running_trials) >= state.at_once:
        require_recorded(state, what)


def require_not_stopped(state: State, what: str) -> None:
    """ProtocolError while the session is stopped."""
    if state.stopped is not None:
        raise ProtocolError(f"cannot {what}: the session is stopped ({state.stopped}); resume it first")


def require_recorded(state: State, what: str) -> None:
    """ProtocolError while a trial waits for its record."""
    waiting = state.running_trials
    if len(waiting) == 1:
        raise ProtocolError(f"cannot {what}: trial {waiting[0].number} waits for its record")
    if waiting:
        raise ProtocolError(f"cannot {what}: trials {_numbers(waiting)} wait for their records")


def _numbers(trials: Sequence[LoggedTrial]) -> str:
    return ", ".join(str(t.number) for t in trials)


def _results(row: Payload) -> Payload:
    return {"outcomes": row["outcomes"], "safety": row["safety"]}


def _without_nothing(point: Payload) -> Payload:
    return {key: value for key, value in point.items() if value is not None}
