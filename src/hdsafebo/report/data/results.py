"""All run files together: metrics, curves and paired comparisons by task and method."""

from __future__ import annotations

import zlib
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import pandas as pd

from hdsafebo.params import Space
from hdsafebo.report.data.methods import INFORMED, is_informed, order
from hdsafebo.report.data.metrics import HIGHER_IS_BETTER, per_seed
from hdsafebo.report.stats.statistics import Comparison, Estimate, compare, estimate
from hdsafebo.runs.read import RunFile
from hdsafebo.runs.schema import Counts, RunMetadata
from hdsafebo.runs.series import Series, per_round, pool

DIGITS = "digits"
POOLS = (DIGITS, DIGITS + INFORMED)
"""Tasks of this table alone: all digits of a setting, a digit being a unit."""
PAPER_ORDER = ("synthetic", "hand", "body", "scs_st", "scs_ga")


@dataclass(frozen=True)
class Uncertainty:
    """How uncertainty is stated.

    Attributes:
        confidence: of bootstrap and binomial intervals.
        bootstrap_samples: per interval.
        calibration_bins: bins of predicted safe probability.
        seed: of the bootstrap.
    """

    confidence: float = 0.95
    bootstrap_samples: int = 4_000
    calibration_bins: int = 10
    seed: int = 0


@dataclass(frozen=True)
class Results:
    """What was run. Besides its own tasks it has the tasks of `POOLS`, whose units are the digits.

    Nothing here compares across tasks, and the two settings of a task are two tasks.

    Attributes:
        runs: run files by (task, method).
        settings: how uncertainty is stated.
    """

    runs: dict[tuple[str, str], RunFile]
    settings: Uncertainty = field(default_factory=Uncertainty)

    @cached_property
    def tasks(self) -> list[str]:
        """Tasks that have a run file, in the paper's order."""
        first = {task: k for k, task in enumerate(PAPER_ORDER)}

        def key(task: str) -> tuple[int, str, bool]:
            plain = task.removesuffix(INFORMED)
            return first.get(plain, len(first)), plain, is_informed(task)

        return sorted({task for task, _ in self.runs}, key=key)

    @cached_property
    def digit_tasks(self) -> list[str]:
        """The digit tasks that have a run file."""
        return [task for task in self.tasks if task.startswith(f"{DIGITS}_")]

    def pooled(self, task: str) -> list[str]:
        """The digit tasks of the setting of a pool."""
        return [name for name in self.digit_tasks if is_informed(name) == is_informed(task)]

    def parts(self, task: str, method: str) -> dict[str, RunFile]:
        """Run files behind a task: one, or one per digit."""
        names = self.pooled(task) if task in POOLS else [task]
        return {name: self.runs[name, method] for name in names if (name, method) in self.runs}

    def methods(self, task: str) -> list[str]:
        """Methods that were run on a task (for `digits` on every digit), in the order of tables."""
        names = self.pooled(task) if task in POOLS else [task]
        found = {m for t, m in self.runs if t in names}
        return order([m for m in found if len(self.parts(task, m)) == len(names)])

    def methods_with(self, task: str, algorithm: str, space: Space | None = None) -> list[str]:
        """Methods that were run on a task and have an algorithm, in a space or in any."""
        metas = {method: self.meta(task, method) for method in self.methods(task)}
        return [m for m, meta in metas.items() if meta.algorithm == algorithm and space in (None, meta.space)]

    @cached_property
    def experiments(self) -> list[str]:
        """Tasks, the digits as one."""
        single = [task for task in self.tasks if task not in self.digit_tasks]
        return [*single, *(pool for pool in POOLS if self.pooled(pool))]

    def counts(self, task: str, method: str) -> Counts:
        """Sums over all runs of a method on a task."""
        return Counts.total(c for run in self.parts(task, method).values() for c in run.meta.counts)

    def meta(self, task: str, method: str) -> RunMetadata:
        """What a run file says about itself (for `digits` the first digit's)."""
        return next(iter(self.parts(task, method).values())).meta

    @cached_property
    def _metrics(self) -> dict[tuple[str, str], pd.DataFrame]:
        return {key: per_seed(run) for key, run in self.runs.items()}

    @cached_property
    def _comparisons(self) -> dict[str, Comparison]:
        return {}

    @cached_property
    def _series(self) -> dict[tuple[str, str], Series]:
        return {key: per_round(run.trials) for key, run in self.runs.items()}

    def metrics(self, task: str, method: str) -> pd.DataFrame:
        """Final metrics, one row per unit."""
        if task in POOLS:
            rows = {
                name: self._metrics[name, method].mean(numeric_only=True) for name in self.parts(task, method)
            }
            return pd.DataFrame(rows).T
        return self._metrics[task, method]

    def series(self, task: str, method: str) -> Series:
        """Curves per round."""
        if task in POOLS:
            return pool({name: self._series[name, method] for name in self.parts(task, method)})
        return self._series[task, method]

    def estimate(self, task: str, method: str, metric: str) -> Estimate:
        """Mean and standard error of a final metric."""
        return estimate(self.metrics(task, method)[metric].to_numpy(float))

    def optimum(self, task: str) -> float | None:
        """Best safe objective of a task, where its run files know it."""
        known = {run.meta.optimum for (name, _), run in self.runs.items() if name == task} - {None}
        return max(v for v in known if v is not None) if known else None

    def same_trials(self, task: str, methods: list[str]) -> list[list[str]]:
        """The methods in groups whose runs have the same outcomes trial by trial."""
        groups: dict[bytes, list[str]] = {}
        for method in methods:
            parts = self.parts(task, method).values()
            outcomes = [run.trials[["seed", "trial", "objective"]].to_numpy(float).tobytes() for run in parts]
            groups.setdefault(b"".join(outcomes), []).append(method)
        return list(groups.values())

    def compare(self, task: str, a: str, b: str, metric: str) -> Comparison:
        """Is method a better than method b? Paired over common units.

        A run that found nothing safe has no objective; it is worse than any that has one.
        """
        if a > b:  # one bootstrap serves both directions
            return self.compare(task, b, a, metric).reversed()
        key = f"{task}/{a}/{b}/{metric}"
        if key not in self._comparisons:
            columns = [self.metrics(task, m)[metric] for m in (a, b)]
            if metric == "objective":
                columns = [column.fillna(-np.inf) for column in columns]
            self._comparisons[key] = self.compare_values(
                key, *columns, higher_is_better=HIGHER_IS_BETTER[metric]
            )
        return self._comparisons[key]

    def compare_values(self, key: str, a: pd.Series, b: pd.Series, *, higher_is_better: bool) -> Comparison:
        """Paired comparison of any two columns; `key` seeds its bootstrap, whatever the order of calls."""
        return compare(
            a,
            b,
            np.random.default_rng([self.settings.seed, zlib.crc32(key.encode())]),
            higher_is_better=higher_is_better,
            samples=self.settings.bootstrap_samples,
            confidence=self.settings.confidence,
        )

    def leader(self, task: str, metric: str, methods: list[str] | None = None) -> Leader | None:
        """The method with the best mean, and against whom that is significant; None with no value at all."""
        names = self.methods(task) if methods is None else methods
        means = {m: self.estimate(task, m, metric).mean for m in names}
        known = {m: v if HIGHER_IS_BETTER[metric] else -v for m, v in means.items() if np.isfinite(v)}
        if not known:
            return None
        best = max(known, key=lambda m: known[m])
        rivals = {m: self.compare(task, best, m, metric) for m in known if m != best}
        runner_up = max(rivals, key=lambda m: known[m]) if rivals else None
        return Leader(best, runner_up, rivals)


@dataclass(frozen=True)
class Leader:
    """The best mean of a task and metric.

    Attributes:
        method: whose it is.
        runner_up: the second best mean; None without rivals.
        rivals: comparison of the leader with each other method.
    """

    method: str
    runner_up: str | None
    rivals: dict[str, Comparison]

    @property
    def significant(self) -> bool:
        """Significantly better than every other method that was run."""
        return bool(self.rivals) and all(c.better for c in self.rivals.values())

    @property
    def not_beaten(self) -> list[str]:
        """Rivals that the leader is not significantly better than."""
        return [m for m, c in self.rivals.items() if not c.better]
