"""The report from result files: page, figures, tables, curves and the metrics file."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path
from typing import Any

import pandas as pd

from hdsafebo.report.claims.base import STATUS_LABELS, Claim
from hdsafebo.report.claims.own import own_claims
from hdsafebo.report.claims.paper import paper_claims
from hdsafebo.report.data.inputs import Inputs, read_inputs
from hdsafebo.report.data.methods import style, task_label
from hdsafebo.report.data.metrics import METRIC_LABELS
from hdsafebo.report.data.outside import OUTSIDE
from hdsafebo.report.data.planned import read_planned
from hdsafebo.report.data.results import Results, Uncertainty
from hdsafebo.report.figures.workflow import workflow_figure
from hdsafebo.report.formatting import with_error
from hdsafebo.report.outputs import curve_table, summary, write_summary
from hdsafebo.report.page import Overview, render
from hdsafebo.report.sections.assessment import (
    clinical_section,
    embedding_section,
    method_section,
    runtime_section,
    safety_section,
)
from hdsafebo.report.sections.base import Details, Section
from hdsafebo.report.sections.body import body_section
from hdsafebo.report.sections.departures import departures_section
from hdsafebo.report.sections.experiments import (
    ablation_section,
    compared,
    digits_section,
    stimulation_section,
    synthetic_section,
)
from hdsafebo.report.sections.hand import hand_section
from hdsafebo.report.sections.outside import outside_section
from hdsafebo.report.tables.results import Cell, Table
from hdsafebo.runs.series import METRICS

RUNS = "data/runs"


def build_report(
    root: Path,
    *,
    profile: str,
    git_revision: str | None,
    planned: Collection[tuple[str, str]] | None = None,
    isometry_points: int | None = None,
    settings: Uncertainty | None = None,
    runs: Path | None = None,
    outside: Path | None = None,
    output: Path | None = None,
) -> dict[str, Any]:
    """Read the result files below `root` and write the report.

    Args:
        root: the project's directory.
        profile: sizes of the run.
        git_revision: of the code; None outside a repository.
        planned: tasks and methods whose runs are reported; None takes every run file.
        isometry_points: field maps that the isometry check measured distances between.
        settings: how uncertainty is stated.
        runs: folder of the run files; None takes `root/data/runs`.
        outside: table of the problems that others wrote; None takes the project's.
        output: folder of the report; None takes `root/reports`.

    Returns:
        The content of `summary.json`.

    Raises:
        DatasetError: a result file is malformed.
    """
    folder_of_runs = root / RUNS if runs is None else runs
    files, left_out = read_planned(folder_of_runs, planned)
    results = Results(files, settings or Uncertainty())
    inputs = read_inputs(root, folder_of_runs)
    claims = paper_claims(results, inputs.isometry, inputs.stimulation)
    own = own_claims(results, planned)
    leaders = _leaders(results)
    sections = _sections(results, inputs, isometry_points, root / OUTSIDE if outside is None else outside)
    folder = root / "reports" if output is None else output
    for name in ("figures", "tables", "curves"):
        (folder / name).mkdir(parents=True, exist_ok=True)
    overview = Overview(profile, git_revision, claims, own, leaders, left_out)
    page = render(overview, sections, folder / "figures")
    (folder / "index.html").write_text(page, encoding="utf-8")
    for table in [leaders, _claim_table([*own, *claims]), *_tables(sections)]:
        table.write(folder / "tables")
    for task in results.experiments:
        curves = curve_table(results, task)
        curves.to_csv(
            folder / "curves" / f"{task}.csv", index=False, lineterminator="\n", float_format="%.8g"
        )
    content = summary(results, inputs, profile=profile, git_revision=git_revision)
    write_summary(folder / "summary.json", content)
    return content


def _sections(results: Results, inputs: Inputs, isometry_points: int | None, outside: Path) -> list[Section]:
    return [
        Section("workflow", "The algorithm", "Figure 1", [workflow_figure()]),
        synthetic_section(results),
        hand_section(results, inputs),
        body_section(results, inputs.body),
        ablation_section(results),
        stimulation_section(results, inputs),
        embedding_section(inputs, isometry_points),
        digits_section(results),
        outside_section(outside),
        safety_section(results),
        runtime_section(results),
        clinical_section(),
        departures_section(),
        method_section(results),
    ]


def _tables(sections: list[Section]) -> list[Table]:
    blocks = [block for section in sections for block in section.blocks]
    return [b for b in blocks if isinstance(b, Table)] + [b.table for b in blocks if isinstance(b, Details)]


def _leaders(results: Results) -> Table:
    """The best method per task and metric."""
    rows, records = [], []
    for task in results.experiments:
        methods = compared(results, task)
        cells = [Cell(task_label(task), f"{len(methods)} methods")]
        record: dict[str, object] = {"task": task, "methods": len(methods)}
        for metric in METRICS:
            leader = results.leader(task, metric, methods)
            if leader is None:
                cells.append(Cell("–"))
                continue
            e = results.estimate(task, leader.method, metric)
            note = "significantly best" if leader.significant else "not ahead of all"
            cells.append(Cell(style(leader.method).label, f"{with_error(e)}, {note}", leader.significant))
            record |= {
                metric: leader.method,
                f"{metric}_mean": e.mean,
                f"{metric}_significant": leader.significant,
            }
        rows.append(cells)
        records.append(record)
    caption = (
        "Best mean per task. Bold: significantly better than every other method that was run on the task."
    )
    columns = ["Task", *(f"{METRIC_LABELS[m]} {'↓' if m == 'violation' else '↑'}" for m in METRICS)]
    return Table("leaders", caption, columns, rows, pd.DataFrame(records))


def _claim_table(claims: list[Claim]) -> Table:
    records = [
        {
            "claim": claim.name,
            "method": method,
            "statement": claim.statement,
            "source": claim.source,
            "status": STATUS_LABELS[verdict.status],
            "numbers": verdict.text,
            "rule": claim.rule,
        }
        for claim in claims
        for method, verdict in claim.verdicts.items()
    ]
    frame = pd.DataFrame(records)
    return Table("claims", "Claims of the paper.", list(map(str, frame.columns)), [], frame)
