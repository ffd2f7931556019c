"""The results in README.md, written from the kept evidence between two marks."""

from __future__ import annotations

from pathlib import Path

from hdsafebo.errors import DatasetError
from hdsafebo.params import load_params
from hdsafebo.report.claims.base import OWN_LABELS, STATUS_LABELS
from hdsafebo.report.claims.own import own_claims
from hdsafebo.report.claims.paper import paper_claims
from hdsafebo.report.data.evidence import INPUTS, PARAMS, RUNS, read_provenance
from hdsafebo.report.data.inputs import Inputs, read_inputs
from hdsafebo.report.data.methods import style, task_label
from hdsafebo.report.data.planned import planned_runs, read_planned
from hdsafebo.report.data.results import Results, Uncertainty
from hdsafebo.report.formatting import number, with_error

BEGIN = "<!-- results: written by `hdsafebo keep-reference` from reports/reference -->"
END = "<!-- end of results -->"


def results_markdown(evidence: Path) -> str:
    """The results of the evidence: a table per task and setting, and the verdicts.

    Args:
        evidence: folder of `data.evidence`.

    Raises:
        DatasetError: a file of the evidence is missing or malformed.
    """
    params = load_params(evidence / PARAMS)
    runs, _ = read_planned(evidence / RUNS, planned_runs(params))
    results = Results(runs, Uncertainty(**params.report.model_dump()))
    inputs = read_inputs(evidence / INPUTS, evidence / RUNS)
    revision = read_provenance(evidence).get("revision") or "an unknown revision"
    lines = [
        f"Profile `{params.profile}`, revision {str(revision)[:10]}; mean ± one standard error over runs. "
        "Tasks marked",
        "informed give every method what a practitioner would know; the others give what the paper gives.",
        "",
    ]
    for task in results.experiments:
        lines += _table(results, task)
    lines += _verdicts(results, inputs)
    return "\n".join(lines)


def update_readme(path: Path, evidence: Path) -> None:
    """Write the results of the evidence between the marks of a README.

    Raises:
        DatasetError: the file has no marks.
    """
    text = path.read_text(encoding="utf-8")
    if text.count(BEGIN) != 1 or text.count(END) != 1 or text.index(BEGIN) > text.index(END):
        raise DatasetError(f"{path}: expected the mark {BEGIN!r} once, and {END!r} once after it")
    before, after = text[: text.index(BEGIN)], text[text.index(END) :]
    path.write_text(f"{before}{BEGIN}\n{results_markdown(evidence)}{after}", encoding="utf-8")


def _table(results: Results, task: str) -> list[str]:
    meta = results.meta(task, results.methods(task)[0])
    optimum = results.optimum(task)
    best = "" if optimum is None else f"; the best safe value of the whole set is {number(optimum)}"
    lines = [
        f"**{task_label(task)}**, {meta.n_initial} initial of {meta.n_trials} trials, {meta.batch} a "
        f"round{best}:",
        "",
        "| method | best safe objective | safety | violation | s per round | runs |",
        "|---|---|---|---|---|---|",
    ]
    for method in results.methods(task):
        cells = [
            with_error(results.estimate(task, method, metric))
            for metric in ("objective", "safety", "violation", "seconds_per_round")
        ]
        runs = len(results.metrics(task, method))
        found = results.estimate(task, method, "objective").runs
        cells[0] += f" (in {found} of {runs} runs)" if found < runs else ""
        lines.append(f"| {style(method).label} (`{method}`) | {' | '.join(cells)} | {runs} |")
    return [*lines, ""]


def _verdicts(results: Results, inputs: Inputs) -> list[str]:
    lines = ["What this project says of its own method:", ""]
    for claim in own_claims(results):
        verdict = claim.verdicts[""]
        lines.append(f"- {claim.statement} **{OWN_LABELS[verdict.status]}**: {verdict.text}.")
    counts: dict[str, int] = {}
    for claim in paper_claims(results, inputs.isometry, inputs.stimulation):
        label = STATUS_LABELS[next(iter(claim.verdicts.values())).status]
        counts[label] = counts.get(label, 0) + 1
    each = ", ".join(f"{label} {count}" for label, count in counts.items())
    return [*lines, "", f"Of the paper's claims, graded on its own method: {each}.", ""]
