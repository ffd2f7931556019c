"""CMA-ES with pycma's own handling of constraints."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from hdsafebo.errors import NoSafePointError
from hdsafebo.optimizers.base import Optimizer, Proposal
from hdsafebo.optimizers.settings import CentreSettings
from hdsafebo.trials import Status, Trials
from hdsafebo.typing import FloatArray

_SEEDS = 2**32
_SMALLEST_BATCH = 5
"""From here on a batch is a generation; pycma's weights need some points to rank."""
_DIAGONAL_FROM = 500
"""Above this dimension the covariance is diagonal (sep-CMA-ES, Ros and Hansen 2008): a full one learns at a
rate of about 1/d^2 per trial and costs d^3."""


class CmaEsSettings(CentreSettings):
    """Settings of `cmaes`.

    Attributes:
        start: mean of the first generation, "best_safe" (best safe initial trial) or "centre" of the box.
        step: first standard deviation, in widths of the box; a quarter is what pycma recommends.
        population: trials per generation; None takes the size of the first batch, or pycma's 4 + 3 log d
            when that is below 5.
    """

    start: Literal["best_safe", "centre"] = "best_safe"
    step: float = Field(default=0.25, gt=0)
    population: int | None = Field(default=None, ge=_SMALLEST_BATCH)

    @model_validator(mode="after")
    def _start_that_can_be_missing(self) -> CmaEsSettings:
        if self.start == "centre" and "empty_safe_set" in self.model_fields_set:
            raise ValueError(
                f"empty_safe_set ({self.empty_safe_set!r}) has no meaning with start 'centre', which needs "
                "no safe trial; give one of them"
            )
        return self


class CmaEs(Optimizer[CmaEsSettings]):
    """pycma (Hansen, 2006 and later) with bounds and an adaptive augmented Lagrangian for the constraints.

    Every safety function that is modelled or reported is a constraint h - g <= 0; the Lagrangian's
    coefficients adapt as in Atamna, Auger and Hansen, FOGA 2017, as pycma implements it in `tell2`. Initial
    data decide the start. A failed trial ranks as the worst of its generation. Trials are collected until a
    generation is complete, so any batch size goes.

    The state of pycma is an object graph that would need pickle. Saved instead is the sequence of calls;
    loading repeats them with the same random numbers, which gives the same state to the bit.
    """

    name = "cmaes"
    Settings = CmaEsSettings
    uses = frozenset({"latent_space", "safety"})  # of the safety functions, the values

    def prepare(self) -> None:
        """Draw the seed of pycma."""
        self._seed = int(self.rng.integers(_SEEDS))
        self._start: Any
        self._mean: FloatArray | None = None
        self._calls: list[list[int]] = []
        self._forget()

    def propose(self, n: int) -> Proposal:
        """n samples of the current distribution."""
        if self._mean is None:
            self._mean = self._first_mean()
        return Proposal(points=self._ask(n, first=len(self.trials)))

    def finish_round(self, trials: Trials) -> None:
        """Queue the results; whenever a generation is complete, update the distribution."""
        self._tell(trials.id.tolist())

    def method_state(self) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
        """Seed, first mean and sequence of calls."""
        arrays = {} if self._mean is None else {"mean": self._mean}
        return {"seed": self._seed, "calls": self._calls}, arrays

    def restore_method_state(self, state: dict[str, Any], arrays: dict[str, NDArray[Any]]) -> None:
        """Repeat the calls."""
        self._seed, self._mean = state["seed"], arrays.get("mean")
        self._calls = []
        self._forget()
        for call in state["calls"]:
            if call[0]:
                self._ask(call[0], first=call[1])
            else:
                self._tell(call[1:])

    # --- what is repeated when a state is loaded

    def _forget(self) -> None:
        """Back to before the first call."""
        self._strategy: Any = None
        self._sampled: dict[int, FloatArray] = {}
        self._queue: list[int] = []

    def _ask(self, n: int, *, first: int) -> FloatArray:
        """Sample n points, for the trials `first`, `first` + 1, ..."""
        self._calls.append([n, first])
        with _quiet_pycma():
            if self._strategy is None:
                self._strategy = self._make_strategy(n)
            points = self._strategy.ask(n)
        self._sampled |= {first + i: point for i, point in enumerate(points)}
        return np.stack(points)[:, : self.space.dimension]

    def _tell(self, ids: list[int]) -> None:
        """Queue trials, and hand over the generations that are complete."""
        self._calls.append([0, *ids])
        self._queue += ids
        size = self._strategy.popsize
        while len(self._queue) >= size:
            generation, self._queue = self._queue[:size], self._queue[size:]
            self._update(generation)

    def _update(self, generation: list[int]) -> None:
        """One update of mean, step size and covariance."""
        points = [self._sampled.pop(i) for i in generation]
        trials = self.trials[generation]
        done = trials.status == Status.COMPLETED
        if not done.any():
            return
        loss = -trials.objective
        binding = np.array([s.modelled or s.reported for s in self.problem.safety])
        thresholds = np.array([s.threshold for s in self.problem.safety])
        excess = (thresholds - trials.safety)[:, binding]
        loss[~done], excess[~done] = loss[done].max(), excess[done].max(axis=0)
        with _quiet_pycma():
            self._strategy.tell2(points, loss.tolist(), excess.tolist())

    def _make_strategy(self, batch: int) -> Any:
        import cma
        from cma import constraints_handler
        from cma.logger import LoggerDummy

        constraints_handler._Logger = LoggerDummy  # pycma's own switch; else it leaves a folder behind
        assert self._mean is not None
        generator = np.random.default_rng(self._seed)
        options = {
            "bounds": [0.0, 1.0],
            "randn": lambda *shape: generator.standard_normal(shape),
            "seed": np.nan,
            "verbose": -9,
            "CMA_diagonal": self.space.dimension > _DIAGONAL_FROM,
        }
        population = self.settings.population or (batch if batch >= _SMALLEST_BATCH else None)
        if population is not None:
            options["popsize"] = population
        mean = np.resize(self._mean, max(len(self._mean), 2))  # pycma needs two; the second then does nothing
        return cma.CMAEvolutionStrategy(mean, self.settings.step, options)

    def _first_mean(self) -> FloatArray:
        """(d,) where the search starts."""
        if self.settings.start == "centre":
            return np.full(self.space.dimension, 0.5)
        try:
            code = self.trials.z[self.centre_row()]
        except NoSafePointError:
            if self.settings.empty_safe_set == "abstain" or self.trials.completed.any():
                raise
            return np.full(self.space.dimension, 0.5)
        return np.clip(self.space.to_unit(code[None])[0], 0.0, 1.0)


@contextmanager
def _quiet_pycma() -> Iterator[None]:
    """pycma warns of optional packages and of its own heuristics; neither concerns the caller."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield
