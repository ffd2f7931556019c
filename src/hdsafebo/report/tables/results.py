"""Tables: numbers for a CSV file, and the same numbers rounded for the page."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import pandas as pd

from hdsafebo.report.data.methods import style
from hdsafebo.report.data.metrics import METRIC_LABELS
from hdsafebo.report.data.paper import paper_value
from hdsafebo.report.data.results import Results
from hdsafebo.report.formatting import interval, paper_text, signed, with_error

ARROWS = {"objective": "↑", "safety": "↑", "violation": "↓", "seconds_per_round": "↓"}


@dataclass(frozen=True)
class Cell:
    """A cell of the page's table: text, a second line in small type, bold when significantly best.

    A wide cell holds sentences, which are broken into lines.
    """

    text: str
    small: str = ""
    bold: bool = False
    wide: bool = False


@dataclass(frozen=True)
class Table:
    """A table of the report.

    Attributes:
        name: file name of its CSV, without suffix.
        caption: what it shows.
        columns: headings on the page.
        rows: cells on the page.
        frame: the numbers, unrounded.
    """

    name: str
    caption: str
    columns: list[str]
    rows: list[list[Cell]]
    frame: pd.DataFrame = field(repr=False)

    def write(self, folder: Path) -> None:
        """Write `<name>.csv`."""
        self.frame.to_csv(folder / f"{self.name}.csv", index=False, lineterminator="\n")


def metrics_table(results: Results, task: str, methods: list[str], caption: str, name: str) -> Table:
    """Methods by final metrics, each with the paper's number below ours."""
    metrics = ("objective", "safety", "violation", "seconds_per_round")
    leaders = {metric: results.leader(task, metric, methods) for metric in metrics}
    rows, records = [], []
    for method in methods:
        runs = len(results.metrics(task, method))
        cells = [Cell(style(method).label), Cell(str(runs))]
        record: dict[str, object] = {"task": task, "method": method}
        for metric in metrics:
            ours, theirs, leader = (
                results.estimate(task, method, metric),
                paper_value(task, method, metric),
                leaders[metric],
            )
            best = leader is not None and leader.method == method and leader.significant
            notes = [paper_text(theirs)]
            if metric == "objective" and ours.runs < runs:
                notes.insert(0, f"nothing safe in {runs - ours.runs} runs")
            cells.append(Cell(with_error(ours), ", ".join(filter(None, notes)), best))
            record |= {
                metric: ours.mean,
                f"{metric}_se": ours.se,
                f"{metric}_runs": ours.runs,
                f"{metric}_significantly_best": best,
                f"paper_{metric}": None if theirs is None else theirs.value,
                f"paper_{metric}_spread": None if theirs is None else theirs.spread,
                f"paper_{metric}_source": None if theirs is None else theirs.source,
            }
        rows.append(cells)
        records.append(record)
    columns = ["Method", "Runs", *(f"{METRIC_LABELS[m]} {ARROWS[m]}" for m in metrics)]
    return Table(name, caption, columns, rows, pd.DataFrame(records))


def unconstrained_table(results: Results, task: str, methods: list[str], caption: str) -> Table:
    """Best value of each method with and without the constraint, the paper's number below."""
    rows, records = [], []
    for method in methods:
        theirs = paper_value(task, method, "objective")
        record: dict[str, object] = {"task": task, "method": method}
        cells = [Cell(style(method).label), Cell(str(len(results.metrics(task, method))))]
        for metric in ("unconstrained", "objective"):
            e = results.estimate(task, method, metric)
            cells.append(Cell(with_error(e), paper_text(theirs) if metric == "unconstrained" else ""))
            record |= {metric: e.mean, f"{metric}_se": e.se}
        record["paper_objective"] = None if theirs is None else theirs.value
        rows.append(cells)
        records.append(record)
    columns = ["Method", "Runs", "Best value, safe or not ↑", "Best safe value ↑"]
    return Table(f"random_embeddings_{task}", caption, columns, rows, pd.DataFrame(records))


def comparison_table(results: Results, task: str, methods: list[str]) -> Table:
    """Paired differences of this project's methods, in either space, against every other method."""
    rows, records = [], []
    ours = [m for m in methods if style(results.meta(task, m).algorithm).family == "ours"]
    for reference in ours:
        for other in (m for m in methods if m != reference):
            cells = [Cell(style(reference).label), Cell(style(other).label)]
            record: dict[str, object] = {"task": task, "method": reference, "against": other}
            for metric in ("objective", "safety", "violation"):
                c = results.compare(task, reference, other, metric)
                verdict = "better" if c.better else "worse" if c.worse else "undecided"
                cells.append(
                    Cell(
                        signed(c.difference) if c.pairs else "–",
                        f"{interval(c)}: {verdict}" if c.pairs else "no common seed",
                        c.better,
                    )
                )
                record |= {
                    f"{metric}_advantage": c.difference,
                    f"{metric}_low": c.interval[0],
                    f"{metric}_high": c.interval[1],
                    f"{metric}_p_value": c.p_value,
                    f"{metric}_pairs": c.pairs,
                    f"{metric}_verdict": verdict,
                }
            rows.append(cells)
            records.append(record)
    caption = (
        "Advantage of the first method over the second on the same seeds (positive is better, also for "
        "Violation), with bootstrap interval and signed-rank test. Bold: significantly better. To the test a "
        "run that found nothing safe is worse than any that did; the mean and interval leave it out."
    )
    columns = ["Method", "Against", "Objective", "Safety", "Violation"]
    return Table(f"comparisons_{task}", caption, columns, rows, pd.DataFrame(records))
