"""The page of results in the documentation, written from the kept evidence."""

from __future__ import annotations

from pathlib import Path
from statistics import mode

from hdsafebo.report.claims.base import OWN_LABELS, STATUS_LABELS, Claim
from hdsafebo.report.claims.own import own_claims
from hdsafebo.report.claims.paper import paper_claims
from hdsafebo.report.data.evidence import INPUTS, RUNS, read_provenance
from hdsafebo.report.data.inputs import read_inputs
from hdsafebo.report.data.json_files import read_json
from hdsafebo.report.data.kept import read_kept
from hdsafebo.report.data.methods import style, task_label
from hdsafebo.report.data.outside import outside_label, read_outside
from hdsafebo.report.data.results import Results
from hdsafebo.report.formatting import number, with_error

NO_RUN = "No run is kept in `reports/reference`."


def runs_markdown(evidence: Path) -> str:
    """What the runs of the evidence came to: a table per task and setting.

    Args:
        evidence: folder of `data.evidence`.

    Raises:
        DatasetError: a file of the evidence is missing or malformed.
    """
    kept = read_kept(evidence)
    if kept is None:
        return NO_RUN
    revision = str(read_provenance(evidence).get("revision") or "an unknown revision")
    lines = [
        f"Profile `{kept.profile}`, revision {revision[:10]}; mean ± one standard error over runs. Tasks",
        "marked informed give every method what a practitioner would know; the others what the paper gives.",
        "",
    ]
    for task in kept.results.experiments:
        lines += _table(kept.results, task)
    return "\n".join(lines)


def claims_markdown(evidence: Path) -> str:
    """The verdicts on this project's own claims, and on the paper's.

    Raises:
        DatasetError: as `runs_markdown`.
    """
    kept = read_kept(evidence)
    if kept is None:
        return NO_RUN
    inputs = read_inputs(evidence / INPUTS, evidence / RUNS)
    lines = ["### Of this project's own method", ""]
    for claim in own_claims(kept.results, kept.planned):
        verdict = claim.verdicts[""]
        lines.append(f"- {claim.statement} **{OWN_LABELS[verdict.status]}**: {verdict.text}.")
    lines += ["", "### Of the paper", ""]
    claims = paper_claims(kept.results, inputs.isometry, inputs.stimulation)
    return "\n".join([*lines, *map(_paper_claim, claims)])


def _paper_claim(claim: Claim) -> str:
    verdict = next(iter(claim.verdicts.values()))
    return f"- {claim.statement} ({claim.source}) **{STATUS_LABELS[verdict.status]}**: {verdict.text}."


def outside_markdown(path: Path) -> str:
    """Problems that others wrote: best safe value and safe share of every method.

    Raises:
        DatasetError: the table is malformed.
    """
    lines = ["| problem | optimum | method | best safe value | safe share | marked | seeds |"]
    lines.append("|---|---|---|---|---|---|---|")
    for problem, methods in read_outside(path).items():
        for method, row in sorted(methods.items(), key=lambda item: item[0] != "hdsafebo_local"):
            cells = [outside_label(problem), number(row["optimum"], 5), f"`{method}`", number(row["best"], 5)]
            marked = "–" if row["marked"] is None else f"{row['marked']:.3f}"  # a method that marks none
            cells += [f"{row['safe']:.3f}", marked, str(row["seeds"])]
            lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


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


def growth_markdown(path: Path) -> str:
    """CPU time of `hdsafebo_local` on its inputs, as `benchmarks/constrained_time.py` measured it.

    Raises:
        DatasetError: the file cannot be read as JSON.
    """
    rows = read_json(path) or []
    if not rows:
        return "Not measured."
    axes = {"trials": "known trials", "dimension": "inputs", "constraints": "limits"}
    centre = {axis: mode(r[axis] for r in rows) for axis in axes}  # one axis varies at a time
    lines = ["| what grows | CPU seconds per 10 trials |", "|---|---|"]
    for axis, label in axes.items():
        line = [r for r in rows if all(r[other] == centre[other] for other in axes if other != axis)]
        found = {r[axis]: f"{r['cpu_s']:.2f}" for r in line}
        others = ", ".join(f"{centre[other]} {axes[other]}" for other in axes if other != axis)
        each = ", ".join(f"{n}: {found[n]}" for n in sorted(found))
        lines.append(f"| {label}, with {others} | {each} |")
    return "\n".join(lines)


def wide_markdown(path: Path) -> str:
    """Rounds of `hdsafebo_local` in tens of thousands of dimensions, by `benchmarks/wide_rounds.py`.

    Raises:
        DatasetError: the file cannot be read as JSON.
    """
    lines = ["| inputs | known trials | CPU seconds per 10 trials | peak memory | saved state |"]
    lines.append("|---|---|---|---|---|")
    for row in read_json(path) or []:
        cells = [f"{row['dimension']:,}", f"{row['trials']:,}", f"{row['round_cpu_s']:.2f}"]
        cells += [f"{row['peak_mb'] / 1000:.2f} GB", f"{row['state_mb']:.0f} MB"]
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)
