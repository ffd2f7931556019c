"""The state of a session: what the entries of its log add up to, in order.

The state is a fold over the log and nothing else, so whoever reads the same log sees the same state.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any, Literal

from hdsafebo.session.errors import AuditError
from hdsafebo.session.log.chain import Entry

Point = dict[str, Any]
"""Inputs of a trial as plain JSON; the kind of session says which keys it has."""

Origin = Literal["initial", "suggested", "modified", "manual"]
Outcome = Literal["running", "completed", "failed"]
Decision = Literal["open", "approved", "modified", "refused", "expired"]


@dataclass(frozen=True)
class LoggedTrial:
    """One trial, delivered or about to be.

    Attributes:
        number: from 1; the initial trials come first.
        origin: who chose the inputs: the optimiser, the optimiser and a person, or a person.
        point: the inputs.
        target: objective that was optimised then; None for initial trials.
        status: `running` until something was recorded.
        outcomes: every objective's value, when completed.
        safety: every safety value, when asked for.
        details: raw values behind them (mu, scores, the recording's SHA-256).
        belief: what the model believed of the point; None without a model.
        suggestion: number of the suggestion it came from.
        decided_by, reason: who approved, modified or planned it, and why.
        failure: why there is no result.
        delivered: False when nothing was delivered.
        started, recorded: times.
        day: number of pauses before it, from 0; the initial trials have one of their own, -1.
    """

    number: int
    origin: Origin
    point: Point
    target: str | None = None
    status: Outcome = "running"
    outcomes: dict[str, float] | None = None
    safety: dict[str, float] | None = None
    details: dict[str, Any] = field(default_factory=dict)
    belief: dict[str, Any] | None = None
    suggestion: int | None = None
    decided_by: str = ""
    reason: str = ""
    failure: str | None = None
    delivered: bool = True
    started: str = ""
    recorded: str = ""
    day: int = 0


@dataclass(frozen=True)
class LoggedSuggestion:
    """One suggestion of the optimiser.

    Attributes:
        number: from 1.
        point: the inputs.
        target: objective it is meant for.
        belief: what the model believed when it was computed.
        based_on: number of the log entry up to which it knew the log.
        decision: what became of it.
    """

    number: int
    point: Point
    target: str
    belief: dict[str, Any]
    based_on: int
    decision: Decision = "open"


@dataclass
class State:
    """A session's state; `apply` brings it forward by one entry.

    Attributes:
        session: identity of the session, drawn when it was made.
        definition: the session file's content, with the limits that are in force.
        first_definition: the same as the session was made with.
        source: path of the session file; empty when the session is older than this entry of the log.
        rows_only: in a session of a list only its rows may be delivered; sessions of the former format
            allowed others until they were converted.
        target: objective that is optimised now.
        stopped: why no trial may start now; None when the session runs.
        trials: all trials in order.
        suggestions: all suggestions in order.
        last_point: inputs delivered last, from which steps are limited; None at a start or after a pause.
        target_since: number of the entry that set the target.
        head: the last entry.
        stops: tokens of the stops that were obeyed before they came into the log.
        pauses: how often the session was resumed.
        initial: number of initial trials.
        recordings: number of the trial of each recording, by the SHA-256 of its file and of its samples.
    """

    session: str = ""
    definition: dict[str, Any] = field(default_factory=dict)
    first_definition: dict[str, Any] = field(default_factory=dict)
    source: str = ""
    rows_only: bool = False
    files: dict[str, dict[str, str]] = field(default_factory=dict)
    target: str = ""
    stopped: str | None = None
    trials: list[LoggedTrial] = field(default_factory=list)
    suggestions: list[LoggedSuggestion] = field(default_factory=list)
    last_point: Point | None = None
    target_since: int = 0
    head: Entry | None = None
    stops: set[str] = field(default_factory=set)
    pauses: int = 0
    initial: int = 0
    recordings: dict[str, int] = field(default_factory=dict)

    @property
    def open_suggestion(self) -> LoggedSuggestion | None:
        """The suggestion that waits for a decision."""
        last = self.suggestions[-1] if self.suggestions else None
        return last if last is not None and last.decision == "open" else None

    @property
    def at_once(self) -> int:
        """How many trials may run at the same time."""
        return int(self.definition.get("at_once", 1))

    @property
    def running_trials(self) -> list[LoggedTrial]:
        """The trials that wait for their records; of a session of one at a time only the last one may."""
        among = self.trials[-1:] if self.at_once == 1 else self.trials[self.initial :]
        return [t for t in among if t.status == "running"]

    @property
    def running(self) -> LoggedTrial | None:
        """The first trial that waits for its record."""
        return next(iter(self.running_trials), None)

    def paused_since(self, trial: LoggedTrial) -> bool:
        """Whether a pause lies between the start of a trial and now."""
        return self.stopped is not None or self.pauses != trial.day

    def apply(self, entry: Entry) -> None:
        """Take in the next entry; AuditError when its payload does not fit what came before."""
        try:
            getattr(self, f"_{entry.kind}")(entry, entry.payload)
        except (AttributeError, KeyError, IndexError, TypeError) as error:
            raise AuditError(f"log entry {entry.seq} ({entry.kind}) makes no sense: {error!r}") from None
        self.head = entry

    def _created(self, entry: Entry, p: dict[str, Any]) -> None:
        self.session, self.definition, self.files = p["session"], p["definition"], p["files"]
        self.first_definition = p["definition"]
        self.source, self.rows_only = p.get("source", ""), "source" in p
        self.target, self.target_since = p["definition"]["target"], entry.seq
        self.initial = len(p["initial"])
        for number, row in enumerate(p["initial"], start=1):
            status: Outcome = "completed" if row["outcomes"] is not None else "failed"
            self.trials.append(
                LoggedTrial(
                    number,
                    "initial",
                    day=-1,
                    status=status,
                    recorded=row.get("time") or entry.time,
                    **_results(row),
                    point=row["point"],
                )
            )

    def _suggested(self, entry: Entry, p: dict[str, Any]) -> None:
        self._expire()
        number = len(self.suggestions) + 1
        self.suggestions.append(LoggedSuggestion(number, p["point"], p["target"], p["belief"], p["based_on"]))

    def _abstained(self, entry: Entry, p: dict[str, Any]) -> None:
        """The optimiser had nothing to suggest; the log keeps why."""

    def _approved(self, entry: Entry, p: dict[str, Any]) -> None:
        suggestion = self._decide("approved")
        self._start("suggested", entry, suggestion.point, suggestion.belief, suggestion.number)

    def _modified(self, entry: Entry, p: dict[str, Any]) -> None:
        suggestion = self._decide("modified")
        self._start("modified", entry, p["point"], None, suggestion.number)

    def _refused(self, entry: Entry, p: dict[str, Any]) -> None:
        self._decide("refused")

    def _manual(self, entry: Entry, p: dict[str, Any]) -> None:
        self._expire()
        self._start("manual", entry, p["point"], None, None)

    def _recorded(self, entry: Entry, p: dict[str, Any]) -> None:
        self._expire()  # what was suggested meanwhile, for another robot, did not know this result
        trial = self.trials[p["trial"] - 1]
        self.trials[p["trial"] - 1] = replace(
            trial,
            status="completed" if p["failure"] is None else "failed",
            failure=p["failure"],
            delivered=p["delivered"],
            recorded=entry.time,
            **_results(p),
        )
        recording = p["details"].get("recording") or {}
        for key in ("sha256", "samples_sha256"):
            if recording.get(key):
                self.recordings[recording[key]] = trial.number
        if p["delivered"] and not self.paused_since(trial):
            self.last_point = trial.point

    def _target_switched(self, entry: Entry, p: dict[str, Any]) -> None:
        self._expire()
        self.target, self.target_since = p["target"], entry.seq

    def _stopped(self, entry: Entry, p: dict[str, Any]) -> None:
        self._expire()
        self.stopped, self.last_point = p["reason"], None
        self.stops.add(p.get("pressed", ""))

    def _resumed(self, entry: Entry, p: dict[str, Any]) -> None:
        self.stopped = None
        self.pauses += 1

    def _tightened(self, entry: Entry, p: dict[str, Any]) -> None:
        """Other limits hold: steps are limited from the start values again, as after a pause."""
        self._expire()
        self.definition, self.last_point = p["definition"], None

    def _converted(self, entry: Entry, p: dict[str, Any]) -> None:
        self.rows_only = True

    def _repaired(self, entry: Entry, p: dict[str, Any]) -> None:
        """A damaged copy was restored from the other one; it changes nothing."""

    def _noted(self, entry: Entry, p: dict[str, Any]) -> None:
        """A remark; it changes nothing."""

    def _decide(self, decision: Decision) -> LoggedSuggestion:
        suggestion = self.suggestions[-1]
        self.suggestions[-1] = replace(suggestion, decision=decision)
        return suggestion

    def _expire(self) -> None:
        if self.open_suggestion is not None:
            self._decide("expired")

    def _start(
        self,
        origin: Origin,
        entry: Entry,
        point: Point,
        belief: dict[str, Any] | None,
        suggestion: int | None,
    ) -> None:
        self.trials.append(
            LoggedTrial(
                len(self.trials) + 1,
                origin,
                point,
                target=self.target,
                belief=belief,
                suggestion=suggestion,
                decided_by=entry.who,
                reason=entry.payload.get("reason", ""),
                started=entry.time,
                day=self.pauses,
            )
        )


def _results(p: dict[str, Any]) -> dict[str, Any]:
    return {"outcomes": p["outcomes"], "safety": p["safety"], "details": p["details"]}
