"""The optimiser behind a session. It follows the log, so every suggestion is a function of the log alone.

Per target there is one optimiser. It starts from everything that is known when the target is set ("all the
history data were reused", paper, clinical experiment), with a seed drawn from the session's seed and the
entry that set the target, and then follows the log entry by entry:

    suggested               its `ask`; taken back when the suggestion expires undecided
    approved, recorded      `tell`
    modified or manual,
    recorded                `observe` of what was really delivered
    not delivered           taken back, so that it can be suggested again
    refused, modified       the proposal stays without a result, so it is never made again
    tightened               of a box without steps, a new optimiser of the smaller box

Its saved states are cached beside the log. Following the log from the start must give the same suggestions,
to the bit; `mismatches` says where it did not.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from hdsafebo.errors import NoSafePointError
from hdsafebo.files.bounded import read_bytes
from hdsafebo.optimizers.base import Optimizer
from hdsafebo.session.advice.informed import informed_optimizer, results_of
from hdsafebo.session.advice.methods import load_method
from hdsafebo.session.advice.search import Search
from hdsafebo.session.definition import Definition, parse_definition
from hdsafebo.session.log.chain import Entry
from hdsafebo.session.log.state import LoggedTrial, Point, State
from hdsafebo.threads import one_thread
from hdsafebo.trials import Status, Trials
from hdsafebo.typing import FloatArray, IntArray

_DECISIONS = ("approved", "modified", "refused")
_EXPIRING = ("suggested", "manual", "recorded", "target_switched", "stopped", "tightened")
_NOTHING_KNOWN = (
    "no trial with a result is known yet; begin with a trial of your own (manual) and record it, or make the "
    "session with initial trials"
)


@dataclass(frozen=True)
class Advice:
    """A suggestion as computed.

    Attributes:
        point: the inputs.
        belief: what the model believed; plain JSON.
        before, after: saved states of the optimiser before and after it was asked.
    """

    point: Point
    belief: dict[str, Any]
    before: bytes
    after: bytes


@dataclass(frozen=True)
class Mismatch:
    """A suggestion of the log that following the log does not reproduce."""

    suggestion: int
    logged: dict[str, Any]
    recomputed: dict[str, Any]


class Advisor:
    """See the module.

    Attributes:
        search: the permitted inputs.
        state: of the session, as far as this has followed the log.
        mismatches: suggestions that were not reproduced.
    """

    def __init__(self, definition: Definition, search: Search) -> None:
        self._definition = definition
        self.search = search
        self._optimizer: Optimizer | None = None
        self._asked: Advice | None = None
        self._undelivered = b""  # state before the suggestion that is being delivered
        self.state = State()
        self.mismatches: list[Mismatch] = []
        self._foreign: set[int] = set()

    @classmethod
    def restore(
        cls, definition: Definition, search: Search, entries: list[Entry], before: bytes, after: bytes
    ) -> Advisor:
        """The advisor that had followed `entries`, the last of them `suggested`, from its cached states.

        Raises:
            StateFileError: a cached state is damaged or belongs to something else.
        """
        advisor = cls(definition, search)
        for entry in entries:
            advisor._take(entry)
        for trial in advisor.state.trials:
            if trial.status != "running" and trial.delivered:
                search.input_of(trial.point)
        payload = entries[-1].payload
        advisor._asked = Advice(payload["point"], payload["belief"], before, after)
        advisor._undelivered = before
        advisor._optimizer = advisor._load(after)
        return advisor

    @one_thread()
    def follow(self, entries: Iterable[Entry]) -> None:
        """Bring the optimiser forward by the next entries of the log."""
        for entry in entries:
            if entry.kind in _EXPIRING and self.state.open_suggestion is not None:
                self.withdraw()
            if entry.kind == "suggested":
                self._reproduce(entry)
            self._take(entry)
            anew = entry.kind == "tightened" and self.search.begins_anew
            if anew or entry.kind in ("created", "target_switched"):
                self._begin()
            elif entry.kind == "resumed":
                self._begin_day()
            elif entry.kind in _DECISIONS:
                self._asked = None
            elif entry.kind == "recorded":
                self._learn(self.state.trials[entry.payload["trial"] - 1])

    @one_thread()
    def advise(self) -> Advice:
        """Ask the optimiser for the next trial; `follow` its `suggested` entry next, or `withdraw` it.

        Raises:
            NoSafePointError: nothing that is permitted now is believed safe.
        """
        if self._asked is not None:
            return self._asked
        optimizer = self._require()
        if not optimizer.trials.completed.any():
            raise NoSafePointError(_NOTHING_KNOWN)
        before = _save(optimizer)
        try:
            trials = self._ask(optimizer)
        except NoSafePointError:
            self._optimizer = self._load(before)
            raise
        point = self.search.point_of(trials.x[0], int(trials.candidate[0]))
        belief = self._beliefs(optimizer.kernel_inputs(trials))[0] | {
            "violation_bound": _plain(trials.violation_bound[0]),
            "trust_region_length": _plain(trials.trust_region_length[0]),
            "marked_unsafe": bool(trials.marked_unsafe[0]),
        }
        self._asked = Advice(point, belief, before, _save(optimizer))
        self._undelivered = before
        return self._asked

    def _ask(self, optimizer: Optimizer) -> Trials:
        """A proposal that is believed safe where it will be evaluated: decoded, clipped and snapped."""
        forbidden = np.concatenate([self.search.restrict(self.state.last_point), self._declined()])
        self._require_rows_left(optimizer, forbidden)
        nothing = np.empty((len(forbidden), 0))
        elsewhere = Trials.pending(nothing, nothing, 1, candidate=forbidden)
        return optimizer.ask(1, pending=elsewhere)

    def _require_rows_left(self, optimizer: Optimizer, forbidden: IntArray) -> None:
        """NoSafePointError when a finite set has no row left to suggest."""
        size = self.search.size
        if size is None:
            return
        left = np.ones(size, bool)
        for rows in (optimizer.trials.candidate, forbidden):
            left[rows[(rows >= 0) & (rows < size)]] = False
        if not left.any():
            raise NoSafePointError(
                f"each of the {size} candidates was tried, declined, or is outside the limits now"
            )

    def withdraw(self) -> None:
        """Take the last `advise` back."""
        if self._asked is not None:
            self._optimizer = self._load(self._asked.before)
            self._asked = None

    @one_thread()
    def believe(self, points: Sequence[Point]) -> list[dict[str, Any]]:
        """What the model believes of any points; nothing while there is nothing to believe from."""
        optimizer = self._require()
        if not optimizer.trials.completed.any() or not points:
            return []
        return self._beliefs(np.vstack([self._glance(optimizer, point) for point in points]))

    def _glance(self, optimizer: Optimizer, point: Point) -> FloatArray:
        """(1, p) kernel inputs of a point that is only looked at."""
        x, row = self.search.glance(point)
        z = x if optimizer.embedding is None else optimizer.embedding.encode(x)
        count = len(self.search.space.safety)
        return optimizer.kernel_inputs(Trials.pending(x, z, count, candidate=np.array([row])))

    def _take(self, entry: Entry) -> None:
        """Bring state and limits forward by an entry."""
        self.state.apply(entry)
        if entry.kind == "tightened":
            self.search.space.tighten(parse_definition(self.state.definition))

    def _begin(self) -> None:
        """A new optimiser for the target, told all that is known."""
        entropy = np.random.SeedSequence([self._definition.seed, self.state.target_since])
        self._optimizer = informed_optimizer(
            self._definition,
            self.search,
            self.state.target,
            int(entropy.generate_state(1)[0]),
            self.state.trials,
            before=self._optimizer,
            today=self.state.pauses,
        )

    def _begin_day(self) -> None:
        """Trials from now on are of the present day."""
        if self._optimizer is not None:
            self._optimizer.begin_day(self.state.pauses)

    def _learn(self, trial: LoggedTrial) -> None:
        optimizer = self._require()
        if not trial.delivered:
            if trial.origin == "suggested" and trial.suggestion not in self._foreign:
                self._take_back(trial)
            return
        objective, safety, status = results_of(trial, self.state.target, self.search, self.state.trials)
        if trial.origin == "suggested" and trial.suggestion not in self._foreign:
            optimizer.tell([self._asked_as(trial)], [objective], [safety], status=[status])
        else:
            x, row = self.search.input_of(trial.point)
            optimizer.observe(x, [objective], [safety], status=[status], candidate=[row])

    def _take_back(self, trial: LoggedTrial) -> None:
        """An asked trial was not delivered: it can be asked again, unless others were asked or told since."""
        if self.state.at_once == 1:
            self._optimizer = self._load(self._undelivered)
            self._begin_day()
        else:
            nothing = [np.full(len(self.search.space.safety), np.nan)]
            self._require().tell([self._asked_as(trial)], [np.nan], nothing, status=[Status.FAILED])

    def _asked_as(self, trial: LoggedTrial) -> int:
        """The optimiser's id of a suggested trial that is running."""
        trials = self._require().trials
        x, _ = self.search.input_of(trial.point)
        same = (trials.status == Status.PENDING) & (trials.x == x).all(axis=1)
        return int(trials.id[same][-1])

    def _declined(self) -> IntArray:
        """Candidate rows that run, that a person turned down, or that an unsafe trial rules out."""
        if self.search.size is None:
            return np.empty(0, np.int64)
        points = [s.point for s in self.state.suggestions if s.decision in ("refused", "modified")]
        points += [t.point for t in self.state.running_trials]
        rows = [self.search.input_of(p)[1] for p in points]
        refused = np.array([row for row in rows if row >= 0], np.int64)
        safe = self.search.space.safe
        unsafe = [t.point for t in self.state.trials if t.safety is not None and not safe(t.safety)]
        return np.concatenate([refused, *(self.search.beyond(p) for p in unsafe)])

    def _beliefs(self, inputs: FloatArray) -> list[dict[str, Any]]:
        """Of (n, p) kernel inputs."""
        optimizer = self._require()
        surrogate = optimizer.surrogate
        mean, deviation = optimizer.in_units(*surrogate.objective.predict(inputs))
        safety_mean, safety_deviation = surrogate.predict_safety(inputs)
        probability = surrogate.safe_probability(inputs)
        names = [s.name for s in self.search.space.safety]
        return [
            {
                "objective": {"mean": float(mean[i]), "sd": float(deviation[i])},
                "safety": {
                    name: self._shown(name, float(safety_mean[i, j]), float(safety_deviation[i, j]))
                    for j, name in enumerate(names)
                },
                "safe_probability": float(probability[i]),
            }
            for i in range(len(inputs))
        ]

    def _shown(self, name: str, mean: float, deviation: float) -> dict[str, float]:
        """A safety function's prediction in its own units: the mean, two standard deviations around it."""
        shown = self.search.space.shown_safety
        low, high = sorted(shown(name, mean + k * deviation) for k in (-2.0, 2.0))
        return {"mean": shown(name, mean), "low": low, "high": high}

    def _reproduce(self, entry: Entry) -> None:
        """Compute a suggestion of the log again, unless it was just computed here.

        One that does not come out again (another version, another computer) counts as a person's from here
        on: the optimiser observes what was delivered.
        """
        logged = {key: entry.payload[key] for key in ("point", "belief")}
        try:
            advice = self.advise()
            recomputed: dict[str, Any] = {"point": advice.point, "belief": advice.belief}
        except NoSafePointError as error:
            recomputed = {"abstained": str(error)}
        if logged != recomputed:
            number = len(self.state.suggestions) + 1
            self.mismatches.append(Mismatch(number, logged, recomputed))
            self._foreign.add(number)
            self.withdraw()

    def _load(self, content: bytes) -> Optimizer:
        problem = self.search.problem(self.state.target)
        with TemporaryDirectory() as folder:
            path = Path(folder) / "optimiser.safetensors"
            path.write_bytes(content)
            return load_method(self._definition.method.name, path, problem, self.search.embedding)

    def _require(self) -> Optimizer:
        assert self._optimizer is not None, "follow the entry `created` first"
        return self._optimizer


def _save(optimizer: Optimizer) -> bytes:
    with TemporaryDirectory() as folder:
        path = Path(folder) / "optimiser.safetensors"
        optimizer.save(path)
        return read_bytes(path)


def _plain(value: Any) -> float | None:
    """A float for JSON; None for NaN."""
    number = float(value)
    return number if np.isfinite(number) else None
