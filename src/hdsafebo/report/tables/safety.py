"""Table of predicted, guaranteed and observed safety."""

from __future__ import annotations

import pandas as pd

from hdsafebo.report.data.methods import style
from hdsafebo.report.data.results import Results
from hdsafebo.report.formatting import number, with_error
from hdsafebo.report.stats.calibration import Calibration
from hdsafebo.report.tables.results import Cell, Table
from hdsafebo.runs.schema import Counts


def calibration_table(
    task: str,
    calibrations: dict[str, Calibration],
    results: Results,
    guarantees: dict[str, tuple[float | None, float | None]],
) -> Table:
    """Predicted and observed safety of each method that predicts, its guarantee, and its violation bounds.

    Args:
        task: the task.
        calibrations: by method.
        results: for violation and bounds.
        guarantees: (beta, guaranteed alpha) by method.
    """
    rows, records = [], []
    for method, c in calibrations.items():
        bound, violation = (
            results.estimate(task, method, "violation_bound"),
            results.estimate(task, method, "violation"),
        )
        beta, alpha = guarantees[method]
        counts = results.counts(task, method)
        rows.append(
            [
                Cell(style(method).label),
                Cell(str(c.trials)),
                Cell(number(c.predicted)),
                Cell(number(c.observed), f"{number(c.interval[0])} to {number(c.interval[1])}"),
                Cell(number(c.brier), f"constant {number(c.brier_constant)}"),
                Cell("–" if beta is None else number(beta)),
                Cell(
                    "none" if alpha is None else number(alpha),
                    "vacuous" if alpha is not None and alpha < 0.5 else "",
                ),
                Cell(with_error(bound)),
                Cell(with_error(violation)),
                *_count_cells(counts),
            ]
        )
        records.append(
            {
                "task": task,
                "method": method,
                "trials": c.trials,
                "predicted": c.predicted,
                "observed": c.observed,
                "observed_low": c.interval[0],
                "observed_high": c.interval[1],
                "brier": c.brier,
                "brier_constant": c.brier_constant,
                "beta": beta,
                "guaranteed_alpha": alpha,
                "violation_bound": bound.mean,
                "violation_bound_se": bound.se,
                "violation": violation.mean,
                "violation_se": violation.se,
                **counts.model_dump(),
            }
        )
    columns = [
        "Method",
        "Trials",
        "Predicted",
        "Observed",
        "Brier ↓",
        "β",
        "Guaranteed α",
        "Sum of bounds",
        "Violation",
        "Marked",
        "Fits repaired",
    ]
    caption = (
        "Mean predicted safe probability, observed safe share with its exact binomial interval, Brier "
        "score beside that of always predicting the observed share, "
        "the safe probability that β guarantees, and the mean sum of one-step violation bounds beside the "
        "mean observed violation. Of all runs together: trials not believed safe and marked as such, "
        "and fits that needed jitter or fell back on earlier hyper-parameters."
    )
    return Table(f"safety_{task}", caption, columns, rows, pd.DataFrame(records))


def _count_cells(counts: Counts) -> tuple[Cell, Cell]:
    return (
        Cell(str(counts.marked), f"{counts.missing} trials not made" if counts.missing else ""),
        Cell(str(counts.jitters + counts.fallbacks), f"of {counts.fits}"),
    )


def bin_table(task: str, calibrations: dict[str, Calibration]) -> Table:
    """Predicted and observed safety by bin of the prediction."""
    rows, frames = [], []
    for method, calibration in calibrations.items():
        frames.append(calibration.bins.assign(task=task, method=method))
        for b in calibration.bins.to_dict("records"):
            limits = f"{number(b['observed_low'])} to {number(b['observed_high'])}"
            rows.append(
                [
                    Cell(style(method).label),
                    Cell(f"{b['low']:.2g} to {b['high']:.2g}"),
                    Cell(str(b["trials"])),
                    Cell(number(b["predicted"])),
                    Cell(number(b["observed"]), limits),
                ]
            )
    caption = (
        "Mean prediction and observed safe share of the trials in each bin, with exact binomial intervals."
    )
    columns = ["Method", "Bin", "Trials", "Predicted", "Observed"]
    return Table(f"calibration_{task}", caption, columns, rows, pd.concat(frames))
