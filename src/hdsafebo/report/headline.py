"""The table in README.md: what was asked, what came out, and where the evidence is."""

from __future__ import annotations

import json
from collections import Counter
from pathlib import Path
from statistics import mean

import numpy as np

from hdsafebo.files.bounded import read_text
from hdsafebo.report.claims.base import OWN_LABELS, STATUS_LABELS, Claim
from hdsafebo.report.claims.own import own_claims
from hdsafebo.report.claims.paper import paper_claims
from hdsafebo.report.data.body_inputs import REFLEX, BodyPolicies
from hdsafebo.report.data.evidence import INPUTS, RUNS
from hdsafebo.report.data.inputs import read_inputs
from hdsafebo.report.data.kept import KeptRuns, read_kept
from hdsafebo.report.data.methods import task_label
from hdsafebo.report.data.outside import OUTSIDE, is_close, outside_label, read_outside
from hdsafebo.report.tables.body import standings

LOCAL, PAPER = "hdsafebo_local", "hdsafebo"
_BODY = "body"
_BENCHMARKS = Path("reports/reference/benchmarks")


def headline_markdown(root: Path) -> str:
    """The table.

    Args:
        root: the project's directory.

    Raises:
        DatasetError: a file of the evidence is malformed.
    """
    rows = [*_outside(root / OUTSIDE), _calibration(root), _month(root), *_runs(root / "reports/reference")]
    lines = ["| what was asked | what came out | evidence |", "|---|---|---|"]
    return "\n".join([*lines, *(f"| {' | '.join(row)} |" for row in rows)])


def _outside(path: Path) -> list[tuple[str, str, str]]:
    """Safe shares and best values on problems that others wrote."""
    table = {problem: row for problem, row in read_outside(path).items() if {LOCAL, PAPER} <= row.keys()}
    count = len(table)
    safe = {m: [row[m]["safe"] for row in table.values()] for m in (LOCAL, PAPER)}
    better = [p for p, row in table.items() if row[LOCAL]["best"] > row[PAPER]["best"]]
    worse = [p for p, row in table.items() if row[LOCAL]["best"] < row[PAPER]["best"]]
    far = [p for p, row in table.items() if not is_close(row[LOCAL])]
    link = "[table](docs/reproduction/results.md#problems-that-others-wrote)"
    return [
        (
            f"Are trials safe? {count} constrained problems that others wrote",
            f"{100 * mean(safe[LOCAL]):.1f} % of the trials of `{LOCAL}` were safe (at least "
            f"{100 * min(safe[LOCAL]):.0f} % on each problem), {100 * mean(safe[PAPER]):.0f} % of those of "
            f"`{PAPER}` with its published beta (at least {100 * min(safe[PAPER]):.0f} %)",
            link,
        ),
        (
            f"How good is the best safe trial? The same {count} problems",
            f"`{LOCAL}` was better on {len(better)} and worse on {len(worse)}"
            f"{_names(worse)}; it stayed more than 1 % from the optimum on {len(far)}{_names(far)}",
            link,
        ),
    ]


def _names(problems: list[str]) -> str:
    return f" ({', '.join(outside_label(p).split(',')[0] for p in problems)})" if problems else ""


def _calibration(root: Path) -> tuple[str, str, str]:
    """Promised and observed safe shares on problems drawn from the model."""
    path = _BENCHMARKS / "calibration.json"
    content = json.loads(read_text(root / path))
    row = max(content["fitted"], key=lambda r: r["alpha"])
    bins = [b["within"] for asked in content["fitted"] for b in asked["bins"]]
    return (
        f"Is a promise kept? {content['problems']} problems drawn from the model itself",
        f"promised {100 * row['alpha']:.0f} %: {100 * row['safe_share_believed']:.1f} % were safe; predicted "
        f"and observed shares agree in {sum(bins)} of {len(bins)} bins",
        f"[calibration.json]({path})",
    )


def _month(root: Path) -> tuple[str, str, str]:
    """Sessions with simulated patients."""
    path = _BENCHMARKS / "session_month.json"
    patients = json.loads(read_text(root / path))["patients"]
    total = {k: sum(p[k] for p in patients) for k in ("unsafe", "recommended", "breaches", "improved")}
    muscles = sum(len(p["final_best"]) for p in patients)
    return (
        f"Sessions: a month of stimulation, {len(patients)} simulated patients",
        f"{total['unsafe']} of {total['recommended']:,} recommended trials were rated unsafe, "
        f"{total['breaches']} broke a hard limit; the best improved for {total['improved']} of {muscles} "
        "muscles",
        f"[session_month.json]({path})",
    )


def _runs(evidence: Path) -> list[tuple[str, str, str]]:
    """The verdicts on this project's own claims, and counts of those on the paper's."""
    asked, link = "Do the paper's claims hold here?", "[claims](docs/reproduction/claims.md)"
    kept = read_kept(evidence)
    if kept is None:
        return [(asked, "not graded: no run is kept", link)]
    inputs = read_inputs(evidence / INPUTS, evidence / RUNS)
    claims = paper_claims(kept.results, inputs.isometry, inputs.stimulation)
    counts = Counter(STATUS_LABELS[next(iter(c.verdicts.values())).status] for c in claims)
    return [
        *_body(kept, inputs.body.played),
        _progress(kept),
        *_own(own_claims(kept.results, kept.planned), link),
        (asked, ", ".join(f"{label}: {n}" for label, n in counts.items()), link),
    ]


def _body(kept: KeptRuns, played: BodyPolicies | None) -> list[tuple[str, str, str]]:
    """How many of the best policies stand on the whole body, and how safe the trials were, by method."""
    stood = {one.method: one for one in standings(played)} if played is not None else {}
    if played is None or not {LOCAL, REFLEX} <= stood.keys() or (_BODY, LOCAL) not in kept.results.runs:
        return []
    shortest, before = (float(np.median(stood[name].seconds.min(axis=1))) for name in (LOCAL, REFLEX))

    def share(method: str) -> str:
        safe = kept.results.estimate(_BODY, method, "safety").mean
        return f"`{method}` {stood[method].whole} of {stood[method].seeds}, {100 * safe:.1f} %"

    others = [share(name) for name in stood if name != LOCAL and (_BODY, name) in kept.results.runs]
    return [
        (
            f"Does a whole body of 416 muscles stay up for {played.horizon_s:g} s after a push?",
            f"Best policies that do after all {len(played.pushes)} pushes, and share of the trials that was "
            f"safe: {'; '.join([share(LOCAL), *others])}. Shortest times of `{LOCAL}` are {shortest:.1f} s "
            f"in the median, of reflexes {before:.1f} s",
            "[results](docs/reproduction/results.md)",
        )
    ]


def _progress(kept: KeptRuns) -> tuple[str, str, str]:
    """How much of the comparison is kept, by family of tasks; the rest has not been run in this size."""
    wanted = Counter(_family(task) for task, _ in kept.planned)
    found = Counter(_family(task) for task, _ in kept.results.runs)
    parts = [f"{family}: {found[family]} of {count}" for family, count in wanted.items()]
    return (
        f"What of the comparison has been run? Methods times tasks of the profile `{kept.profile}`",
        ", ".join(parts),
        "[results](docs/reproduction/results.md)",
    )


def _family(task: str) -> str:
    name = task.split("_")[0]
    return "stimulation" if name == "scs" else name


def _own(claims: list[Claim], link: str) -> list[tuple[str, str, str]]:
    """For each verdict the tasks that it was given on."""
    tasks: dict[str, list[str]] = {}
    for claim in claims:
        status = claim.verdicts[""].status
        if status != "not run":
            tasks.setdefault(OWN_LABELS[status], []).append(task_label(claim.name.removeprefix("own_")))
    if not tasks:
        return []
    asked = f"Is `{LOCAL}` ahead of every other method that is told the same?"
    return [(asked, ". ".join(f"{label}: {'; '.join(names)}" for label, names in tasks.items()), link)]
