"""Sections on embeddings, safety, run time, the clinical experiment, and how numbers are made."""

from __future__ import annotations

import pandas as pd

from hdsafebo.report.data.inputs import Inputs, Isometry
from hdsafebo.report.data.methods import style, task_label
from hdsafebo.report.data.paper import ISOMETRY, ISOMETRY_POINTS, ISOMETRY_SOURCE
from hdsafebo.report.data.results import Results
from hdsafebo.report.figures.ablation import seconds_figure
from hdsafebo.report.figures.inputs import distance_figure
from hdsafebo.report.figures.safety import calibration_figure
from hdsafebo.report.formatting import number
from hdsafebo.report.sections.base import Block, Details, Section, Text, not_run
from hdsafebo.report.stats.calibration import Calibration, calibrate
from hdsafebo.report.stats.statistics import MIN_PAIRS
from hdsafebo.report.tables.results import Cell, Table
from hdsafebo.report.tables.safety import bin_table, calibration_table
from hdsafebo.report.tables.speed import seconds_table

_ISOMETRY_COLUMNS = {
    "distance_correlation": "Distance correlation ↑",
    "gp_mean_difference": "GP mean difference ↓",
    "gp_variance_difference": "GP variance difference ↓",
    "round_trip": "Same configuration after decode(encode) ↑",
    "round_trip_held_out": "The same, configurations held out ↑",
    "round_trip_held_out_currents": "The same, currents held out ↑",
    "reconstruction_mse": "Reconstruction error ↓",
    "condition_number": "Condition number ↓",
}


def embedding_section(inputs: Inputs, points: int | None) -> Section:
    """The distance table and the scatter of pairwise distances, between so many field maps."""
    blocks: list[Block] = []
    if inputs.isometry is None:
        blocks.append(not_run("Isometry check"))
    else:
        if points is not None:
            verdict = "below" if points < ISOMETRY_POINTS else "at least"
            size = f"Size: {points:,} field maps. Paper: {ISOMETRY_POINTS:,} ({ISOMETRY_SOURCE})."
            blocks.append(Text(f"{size} This is {verdict} the paper's size.", "size"))
        blocks.append(_isometry_table(inputs.isometry))
    if inputs.distances is None:
        blocks.append(not_run("Sample of pairwise distances"))
    else:
        correlations = {name: check.distance_correlation for name, check in (inputs.isometry or {}).items()}
        blocks.append(distance_figure(inputs.distances, correlations))
    return Section("embeddings", "Distance preservation", "Appendix C.3", blocks)


def _isometry_table(isometry: dict[str, Isometry]) -> Table:
    rows, records = [], []
    for name, check in isometry.items():
        values = check.model_dump()
        paper = ISOMETRY.get(name, {})
        cells = [Cell(name)]
        for column in _ISOMETRY_COLUMNS:
            value = values[column]
            cells.append(
                Cell(
                    "–" if value is None else number(value, 4),
                    f"paper {paper[column]:g}" if column in paper else "",
                )
            )
        rows.append(cells)
        records.append({"embedding": name} | values | {f"paper_{k}": v for k, v in paper.items()})
    caption = (
        "How well embeddings of the field maps keep distances and the predictions of a Gaussian process. "
        f"Paper: {ISOMETRY_SOURCE}."
    )
    return Table("isometry", caption, ["Embedding", *_ISOMETRY_COLUMNS.values()], rows, pd.DataFrame(records))


def safety_section(results: Results) -> Section:
    """Predicted against observed safety, guarantees and bounds."""
    blocks: list[Block] = [
        Text(
            "β guarantees that a trial is safe with probability at least α = 1 − Φ(β), if the model is "
            "right. For β = 2 that is 0.023: a guarantee that says almost nothing. What protects the trials "
            "in practice is the model's prediction, so it is held against what happened. The intervals take "
            "trials as independent, which trials of one run are not quite; true ones are wider."
        )
    ]
    found = False
    for task in results.experiments:
        calibrations = _calibrations(results, task)
        if not calibrations:
            continue
        found = True
        guarantees = {
            m: (results.meta(task, m).beta, results.meta(task, m).guaranteed_alpha) for m in calibrations
        }
        blocks.append(Text(task_label(task), "heading"))
        blocks += [
            _safety_finding(task, m, c, guarantees[m][1])
            for m, c in calibrations.items()
            if style(m).family == "ours"
        ]
        shown = {m: c for m, c in calibrations.items() if style(m).family != "ablation"}
        blocks += [calibration_figure(task, shown)] if shown else []
        blocks.append(calibration_table(task, calibrations, results, guarantees))
        blocks.append(Details("Bins of predicted safe probability", bin_table(task, calibrations)))
    if not found:
        blocks.append(not_run("Methods that predict safety"))
    return Section("safety", "Safety: predicted, guaranteed, observed", "Proposition 1, Theorem 1", blocks)


def _calibrations(results: Results, task: str) -> dict[str, Calibration]:
    found = {}
    for method in results.methods(task):
        runs = list(results.parts(task, method).values())
        calibration = calibrate(
            runs, bins=results.settings.calibration_bins, confidence=results.settings.confidence
        )
        if calibration is not None:
            found[method] = calibration
    return found


def _safety_finding(task: str, method: str, c: Calibration, alpha: float | None) -> Text:
    low, high = c.interval
    if low <= c.predicted <= high:
        verdict = "the predictions are right on average"
    elif c.predicted > high:
        verdict = "the model is overconfident: less was safe than it said"
    else:
        verdict = "the model is cautious: more was safe than it said"
    skill = "predicts better than" if c.brier < c.brier_constant else "predicts no better than"
    if alpha is None:
        guarantee = "It guarantees nothing"
    elif alpha < 0.5:
        guarantee = f"Its guarantee of {number(alpha)} is vacuous"
    else:
        held = "holds" if c.observed >= alpha else "is missed"
        guarantee = f"Its guarantee of {number(alpha)} {held}"
    return Text(
        f"{task_label(task)}, {style(method).label}: predicted {number(c.predicted)}, observed "
        f"{number(c.observed)} ({number(low)} to {number(high)}): {verdict}; trial by trial it {skill} "
        f"always saying the observed share. {guarantee}.",
        "caution" if c.predicted > high or (alpha is not None and alpha < 0.5) else "finding",
    )


def runtime_section(results: Results) -> Section:
    """Seconds per round of every method and task."""
    if not results.tasks:
        return Section("runtime", "Run time per round", "Appendix C.7", [not_run("Run times")])
    intro = (
        "CPU time to choose a batch on one thread, not to evaluate it: a mean over the rounds of a run, then "
        "over runs. Other work on the machine lengthens it little."
    )
    blocks: list[Block] = [Text(intro), seconds_figure(results, results.experiments)]
    blocks.append(
        seconds_table(results, [t for t in results.tasks if t.startswith("scs_")] or results.experiments)
    )
    return Section("runtime", "Run time per round", "Appendix C.7", blocks)


def clinical_section() -> Section:
    """Not run, and why."""
    text = Text(
        "Clinical experiment: not run. It needs a patient with an implanted stimulator; the paper's "
        "numbers (504 trials, 441 recommended, 3 unsafe) cannot be checked here.",
        "missing",
    )
    return Section("clinical", "Clinical experiment", "Section 5.3, appendix B.7", [text])


def method_section(results: Results) -> Section:
    """How the numbers of the page are made."""
    s = results.settings
    percent = f"{100 * s.confidence:g} %"
    texts = [
        "Objective: best objective among all safe trials of a run, the initial ones included (the paper's "
        "best feasible value).",
        "Safety: share of safe trials among those that the method chose. Violation: sum over the same "
        "trials of max(0, h − g). "
        "Initial trials count in neither; failed evaluations are left out and counted.",
        "± and bands are one standard error of the mean over runs. A run without a safe trial has no "
        "Objective and is left out of its mean.",
        f"Better than: on common seeds, a two-sided Wilcoxon signed-rank test (p < 0.05) and a {percent} "
        "bootstrap interval of the mean difference "
        f"({s.bootstrap_samples:,} samples) must both exclude equality. With fewer than {MIN_PAIRS} pairs "
        "no such test can, and nothing is called significant. "
        "A number is bold when its method is better than every other of its table in this sense; each "
        "comparison is tested on its own.",
        "Predicted safe probability: what the method's model said when it asked for the trial. Brier "
        "score: mean squared difference to the outcome (0 or 1).",
    ]
    return Section("methods", "How the numbers are made", "", [Text(text) for text in texts])
