"""Tables of how fast methods are: in trials, and in seconds."""

from __future__ import annotations

import pandas as pd

from hdsafebo.report.data.methods import order, style, task_label
from hdsafebo.report.data.paper import paper_value
from hdsafebo.report.data.results import Results
from hdsafebo.report.formatting import number, paper_text, with_error
from hdsafebo.report.stats.regret import CHECKPOINTS
from hdsafebo.report.stats.statistics import estimate
from hdsafebo.report.tables.results import Cell, Table


def regret_table(task: str, shares: dict[str, pd.DataFrame], optimum: float, caption: str) -> Table:
    """Share of the optimum at checkpoints and trials to 95 % of it, by method."""
    rows, records = [], []
    for method, table in shares.items():
        cells = [Cell(style(method).label), Cell(str(len(table)))]
        record: dict[str, object] = {"task": task, "method": method, "runs": len(table), "optimum": optimum}
        for checkpoint in CHECKPOINTS:
            e = estimate(table[f"share_{checkpoint}"])
            cells.append(Cell(with_error(e)))
            record |= {f"share_{checkpoint}": e.mean, f"share_{checkpoint}_se": e.se}
        reached = table["trials_to_95"].dropna()
        cells.append(
            Cell(
                number(float(reached.median())) if len(reached) else "–",
                f"{len(reached)} of {len(table)} runs",
            )
        )
        record |= {
            "median_trials_to_95": float(reached.median()) if len(reached) else None,
            "runs_that_reached_95": len(reached),
        }
        rows.append(cells)
        records.append(record)
    columns = ["Method", "Runs", *(f"at {c} trials" for c in CHECKPOINTS), "Trials to 95 %"]
    return Table(f"regret_{task}", caption, columns, rows, pd.DataFrame(records))


def seconds_table(results: Results, tasks: list[str]) -> Table:
    """Seconds per round, methods by tasks."""
    methods = order(list({m for task in tasks for m in results.methods(task)}))
    rows, records = [], []
    for method in methods:
        cells = [Cell(style(method).label)]
        for task in tasks:
            if method not in results.methods(task):
                cells.append(Cell("not run"))
                continue
            e = results.estimate(task, method, "seconds_per_round")
            theirs = paper_value(task, method, "seconds_per_round")
            cells.append(Cell(with_error(e), paper_text(theirs)))
            records.append(
                {
                    "task": task,
                    "method": method,
                    "seconds_per_round": e.mean,
                    "se": e.se,
                    "runs": e.runs,
                    "paper": None if theirs is None else theirs.value,
                    "paper_std": None if theirs is None else theirs.spread,
                }
            )
        rows.append(cells)
    columns = ["Method", *(task_label(task) for task in tasks)]
    caption = (
        "CPU seconds per round: mean ± standard error over runs; the paper: seconds on its computer, "
        "± deviation over 80 rounds."
    )
    return Table("seconds_per_round", caption, columns, rows, pd.DataFrame(records))
