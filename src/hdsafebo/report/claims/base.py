"""Verdicts on the claims of the paper: rules, stated in words beside the code that applies them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from hdsafebo.report.data.methods import style, task_label
from hdsafebo.report.data.metrics import METRIC_LABELS
from hdsafebo.report.data.results import Results
from hdsafebo.report.formatting import interval, signed
from hdsafebo.report.stats.statistics import MIN_PAIRS, Comparison

OURS = ("hdsafebo", "hdsafebo_local")
BASELINES = ["linebo", "scbo", "config", "cei", "cmaes"]

VARIANTS = {
    "linebo": ("linebo_lower",),
    "cei": ("cei_botorch", "cei_prob", "cei_prob_botorch"),
    "cmaes": ("cmaes_tuned", "cmaes_centre"),
}
"""The paper's baselines at their best: a claim against a baseline must hold against each of its variants."""

Status = Literal["reproduced", "partly", "not", "empty", "not run"]
STATUS_LABELS: dict[Status, str] = {
    "reproduced": "reproduced",
    "partly": "partly",
    "not": "not reproduced",
    "empty": "holds, but says nothing",
    "not run": "not run",
}
OWN_LABELS: dict[Status, str] = STATUS_LABELS | {"reproduced": "holds", "not": "does not hold"}
"""For what this project says of its own method."""


def grade(reproduced: bool, partly: bool) -> Status:
    """The status that two conditions give, the stronger first."""
    return "reproduced" if reproduced else "partly" if partly else "not"


@dataclass(frozen=True)
class Verdict:
    """A status and the numbers that it follows from."""

    status: Status
    text: str


NOT_RUN = Verdict("not run", "not run in this profile")


@dataclass(frozen=True)
class Claim:
    """A claim of the paper.

    Attributes:
        name: identifies it in tables.
        statement: what the paper says.
        source: where.
        rule: when it counts as reproduced, partly reproduced or not.
        section: anchor of the evidence on the page.
        verdicts: by method (`hdsafebo` first, which is the paper's, then others held to the same rule), or
            one under "".
    """

    name: str
    statement: str
    source: str
    rule: str
    section: str
    verdicts: dict[str, Verdict]


SUPERIORITY_RULE = (
    "Reproduced: significantly better than every baseline that was run, in either space and in each of its "
    "variants, and every baseline of the paper was run. Partly: significantly worse than none, and either "
    "ahead of all in the mean or significantly "
    "better than at least half. Not: otherwise."
)


def superiority(
    results: Results, tasks: list[str], method: str, metric: str, baselines: list[str]
) -> Verdict:
    """Is a method better than the paper's baselines in a metric on all the tasks?

    A baseline counts as run when a method with its algorithm ran, whatever space was searched; each of its
    `VARIANTS` that ran is compared as well.
    """
    comparisons: dict[tuple[str, str], Comparison] = {}
    missing: set[str] = set()
    for task in tasks:
        ran = results.methods(task)
        for baseline in baselines:
            names = (baseline, *VARIANTS.get(baseline, ()))
            variants = [m for name in names for m in results.methods_with(task, name)]
            if method not in ran or not variants:
                where = f" ({task_label(task)})" if len(tasks) > 1 else ""
                missing.add(f"{style(baseline).label}{where}" if method in ran else task_label(task))
            else:
                comparisons |= {(task, m): results.compare(task, method, m, metric) for m in variants}
    comparisons = {key: c for key, c in comparisons.items() if c.pairs}
    if not comparisons:
        return NOT_RUN
    return Verdict(
        _status(comparisons, complete=not missing), _sentence(comparisons, metric, sorted(missing))
    )


def _status(comparisons: dict[tuple[str, str], Comparison], *, complete: bool) -> Status:
    values = list(comparisons.values())
    if any(c.worse for c in values):
        return "not"
    better = sum(c.better for c in values)
    ahead = all(c.difference > 0 for c in values)
    return grade(better == len(values) and complete, 2 * better >= len(values) or ahead)


def _sentence(comparisons: dict[tuple[str, str], Comparison], metric: str, missing: list[str]) -> str:
    """The numbers behind a verdict on superiority."""
    several = len({task for task, _ in comparisons}) > 1

    def name(key: tuple[str, str]) -> str:
        return f"{style(key[1]).label} ({task_label(key[0])})" if several else style(key[1]).label

    better = [k for k, c in comparisons.items() if c.better]
    worse = [k for k, c in comparisons.items() if c.worse]
    closest = min(comparisons, key=lambda k: comparisons[k].difference)
    c = comparisons[closest]
    parts = [
        f"{METRIC_LABELS[metric]} significantly better than {len(better)} of {len(comparisons)} comparisons"
    ]
    if worse:
        parts.append(f"significantly worse than {', '.join(map(name, worse))}")
    parts.append(f"smallest lead: {signed(c.difference)} over {name(closest)} ({interval(c)})")
    if min(v.pairs for v in comparisons.values()) < MIN_PAIRS:
        parts.append(f"a test needs at least {MIN_PAIRS} pairs")
    if missing:
        parts.append(f"not run: {', '.join(missing)}")
    return "; ".join(parts)


def worst_of(verdicts: list[Verdict]) -> Verdict:
    """Several conditions that must all hold: the worst status; parts not run make it partly at best."""
    run = [v for v in verdicts if v.status != "not run"]
    if not run:
        return verdicts[0]
    order: list[Status] = ["not", "partly", "empty", "reproduced"]
    status = min((v.status for v in run), key=order.index)
    if len(run) < len(verdicts) and status == "reproduced":
        status = "partly"
    return Verdict(status, " · ".join(v.text for v in verdicts))


def superiority_claim(
    results: Results,
    name: str,
    statement: str,
    source: str,
    section: str,
    *,
    tasks: list[str],
    metric: str,
    baselines: list[str],
) -> Claim:
    """A claim of superiority, with a verdict for each of this project's methods."""
    verdicts = {m: superiority(results, tasks, m, metric, baselines) for m in OURS}
    return Claim(name, statement, source, SUPERIORITY_RULE, section, verdicts)
