"""How an optimiser sees a system: a problem over a box, or over the rows of a list."""

from __future__ import annotations

import json
from hashlib import sha256

import numpy as np

from hdsafebo.errors import ProblemError
from hdsafebo.problem import Problem
from hdsafebo.system.codec import BoxCodec
from hdsafebo.system.description import System
from hdsafebo.system.errors import DescriptionError
from hdsafebo.trials import Evaluation, Trials
from hdsafebo.typing import FloatArray, IntArray


class SystemProblem(Problem):
    """The problem of a system; the user evaluates it.

    Attributes:
        codec: between the user's values and the box.
        description: SHA-256 of the system. The box has no names, units or ranges, so that nothing else would
            tell a state of this system from one of another.
    """

    def __init__(self, system: System) -> None:
        self.name = system.name
        self.codec = BoxCodec(system)
        self.description = _digest(system)
        self.bounds = self.codec.bounds
        self.contexts = self.codec.contexts
        self.lands = self.codec.lands and system.settings is None
        self.failures_teach = system.failures == "unsafe"
        self.safety = tuple(s for limit in system.limits for s in limit.safety())
        limits = [limit.noise for limit in system.limits for _ in limit.sides]
        self.noise = np.array([system.objective.noise, *limits], float)  # None becomes NaN
        if system.settings is not None:
            self.candidates = SettingsList(system, self.codec)

    def land(self, x: FloatArray) -> FloatArray:
        """(n, D) nearest points that can be run."""
        return self.codec.land(x)

    def neighbours(self, x: FloatArray) -> FloatArray:
        """(k, D) inputs that can be run and differ from the (D,) one in one step of one parameter."""
        return self.codec.neighbours(x)

    def evaluate(self, trials: Trials) -> Evaluation:
        """Not possible: ProblemError."""
        raise ProblemError(f"{self.name!r} is evaluated by its user, who tells the results")


def _digest(system: System) -> str:
    """SHA-256 of a description; 1 and 1.0 are the same, as one becomes the other in files."""
    plain = json.loads(json.dumps(system.to_dict(), default=str), parse_int=float)
    return sha256(json.dumps(plain, sort_keys=True).encode()).hexdigest()


class SettingsList:
    """The rows of a list as the only settings that can be tried, under the context of the day.

    Attributes:
        settings: (N, D - c) columns of the parameters.
        context: (c,) columns of the contexts, as last held.
    """

    def __init__(self, system: System, codec: BoxCodec) -> None:
        assert system.settings is not None
        values = codec.check(system.settings, system.parameters, exact=True)
        self.settings = codec.encode(values, system.parameters)
        _, first = np.unique(self.settings, axis=0, return_index=True)
        twice = np.setdiff1d(np.arange(len(self.settings)), first)
        if len(twice):
            same = np.flatnonzero((self.settings == self.settings[twice[0]]).all(axis=1))
            raise DescriptionError(f"settings: rows {same.tolist()[:10]} are the same; expected each once")
        self.context = np.zeros(len(codec.contexts))

    def __len__(self) -> int:
        """N."""
        return len(self.settings)

    @property
    def identifying(self) -> FloatArray:
        """(N, D - c) what tells this list from others: the settings, whatever context is held."""
        return self.settings

    @property
    def features(self) -> FloatArray:
        """(N, D) inputs under the held context."""
        return self.inputs(np.arange(len(self.settings)))

    def inputs(self, rows: IntArray) -> FloatArray:
        """(k, D) inputs of rows under the held context."""
        return np.hstack([self.settings[rows], np.tile(self.context, (len(rows), 1))])

    def nearest(self, x: FloatArray, taken: IntArray) -> IntArray:
        """(n,) nearest rows that are not taken, all different."""
        free = np.setdiff1d(np.arange(len(self.settings)), taken)
        rows = []
        for point in x[:, : self.settings.shape[1]]:
            rows.append(free[np.argmin(((self.settings[free] - point) ** 2).sum(axis=1))])
            free = free[free != rows[-1]]
        return np.array(rows, np.int64)

    def hold(self, context: FloatArray) -> None:
        """Take the (c,) columns of the contexts as known."""
        self.context = np.asarray(context, float)

    def features_of(self, x: FloatArray) -> FloatArray:
        """(n, D) kernel inputs of any inputs."""
        return x

    def rows_of(self, x: FloatArray) -> IntArray:
        """(n,) rows with the settings of inputs; -1 where the list has none."""
        rows = np.full(len(x), -1)
        for i, point in enumerate(x[:, : self.settings.shape[1]]):
            same = np.flatnonzero((np.abs(self.settings - point) <= 1e-9).all(axis=1))
            rows[i] = same[0] if len(same) else -1
        return rows
