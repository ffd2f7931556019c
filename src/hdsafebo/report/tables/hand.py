"""Whether runs on the hand do the task: bottles held, and trials until the best safe policy ends upright."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd

from hdsafebo.report.data.methods import style, task_label
from hdsafebo.report.formatting import number, with_error
from hdsafebo.report.stats.statistics import Estimate, estimate
from hdsafebo.report.tables.results import Cell, Table
from hdsafebo.runs.best_trial import SAFE_ENOUGH


@dataclass(frozen=True)
class Upright:
    """One method.

    Attributes:
        method: its name.
        objective: best safe return of a run.
        safety: share of safe ones among the optimised trials of a run.
        held: share of them in which the bottle was not dropped.
        trials: trials, initial ones included, until the best safe policy of the run ends upright; all
            trials of a run that does not get there.
        ended: runs whose best safe policy ends upright.
        runs: all runs.
    """

    method: str
    objective: Estimate
    safety: Estimate
    held: Estimate
    trials: Estimate
    ended: int
    runs: int

    @property
    def safe_enough(self) -> bool:
        """Safety is at least 0.95 in the mean."""
        return self.safety.mean >= SAFE_ENOUGH


def upright(method: str, outcomes: pd.DataFrame) -> Upright:
    """Summary of a method's trials (columns as in `hand_inputs.HandInputs.outcomes`)."""
    runs = [run.sort_values("trial") for _, run in outcomes.groupby("seed")]
    trials, ended = zip(*(_until_upright(run) for run in runs), strict=True)
    chosen = [run[~run["initial"] & (run["status"] == "completed")] for run in runs]
    best = [run.loc[_safe(run), "objective"].max() for run in runs]
    return Upright(
        method=method,
        objective=estimate(np.array(best, float)),
        safety=estimate(np.array([run["safe"].mean() for run in chosen], float)),
        held=estimate(np.array([(run["safety_no_drop"] >= 0).mean() for run in chosen], float)),
        trials=estimate(np.array(trials, float)),
        ended=sum(ended),
        runs=len(runs),
    )


def _safe(run: pd.DataFrame) -> pd.Series:
    return run["safe"] & (run["status"] == "completed")


def _until_upright(run: pd.DataFrame) -> tuple[int, bool]:
    """Trials after which the best safe policy first ends upright, and whether the last best one does.

    A best policy among the initial ones counts from the last initial trial on: they come as one.
    """
    value = run["objective"].where(_safe(run), -np.inf)
    leads = (value > value.cummax().shift(fill_value=-np.inf)).to_numpy()
    does = (run["safety_upright"] >= 0).to_numpy()
    incumbent = np.maximum.accumulate(np.where(leads, np.arange(len(run)), -1))
    done = (incumbent >= 0) & does[incumbent]
    first_choice = int(run["initial"].sum())
    considered = np.flatnonzero(done[max(first_choice - 1, 0) :])
    count = len(run) if len(considered) == 0 else int(considered[0]) + max(first_choice, 1)
    return count, bool(done[-1])


def upright_table(task: str, found: list[Upright]) -> Table:
    """The summaries as a table."""
    rows, records = [], []
    for row in found:
        estimates = {
            "objective": row.objective,
            "safety": row.safety,
            "held": row.held,
            "trials": row.trials,
        }
        cells = [Cell(style(row.method).label), Cell(f"{row.ended} of {row.runs}")]
        record: dict[str, object] = {"method": row.method, "runs": row.runs, "ended_upright": row.ended}
        for name, value in estimates.items():
            cells.append(Cell(with_error(value)))
            record |= {name: value.mean, f"{name}_se": value.se}
        rows.append(cells)
        records.append(record)
    caption = (
        "Does the best safe policy do the task? Upright: the mean tilt of its last 20 steps is at most "
        "0.35 rad and the hand holds the bottle. Trials until the best safe policy so far ends upright "
        "include the initial ones, so their number means that the best of them already does; a run that "
        "does not get there counts with all its trials. "
        "Held: share of the optimised trials in which the bottle was not dropped."
    )
    columns = ["Method", "Ends upright", "Return ↑", "Safety ↑", "Held ↑", "Trials until upright ↓"]
    return Table(f"upright_{task}", f"{task_label(task)}. {caption}", columns, rows, pd.DataFrame(records))


def upright_finding(found: list[Upright]) -> str:
    """Who returns most, and who is upright first, among the methods that are safe enough."""
    safe = [row for row in found if row.safe_enough]
    if not safe:
        return f"No method has a mean Safety of {SAFE_ENOUGH}."
    best = max(safe, key=lambda row: row.objective.mean)
    fewest = min(row.trials.mean for row in safe)
    first = [row for row in safe if row.trials.mean == fewest]
    soonest = " and ".join(style(row.method).label for row in first)
    names = ", ".join(f"{style(row.method).label} {number(row.safety.mean)}" for row in safe)
    return (
        f"Safety of at least {SAFE_ENOUGH}: {names}. Among these {style(best.method).label} has the highest "
        f"mean return ({with_error(best.objective)}). Fewest trials until upright: {soonest} "
        f"({with_error(first[0].trials)})."
    )
