"""Sentences that follow from the numbers of one task."""

from __future__ import annotations

import math

import pandas as pd
from scipy.stats import norm

from hdsafebo.report.data.methods import style, task_label
from hdsafebo.report.data.metrics import METRIC_LABELS
from hdsafebo.report.data.paper import paper_size, paper_value
from hdsafebo.report.data.results import POOLS, Results
from hdsafebo.report.formatting import number, with_error
from hdsafebo.report.sections.base import Text
from hdsafebo.report.stats.statistics import MIN_PAIRS
from hdsafebo.runs.series import METRICS

AGREEMENT = 2.0


def size_sentence(results: Results, task: str, methods: list[str]) -> Text:
    """What was run, at what size, and whether that is the paper's."""
    metas = [results.meta(task, m) for m in methods]
    counts = [len(results.metrics(task, m)) for m in methods]
    trials, initial, batch = (
        sorted({getattr(m, name) for m in metas}) for name in ("n_trials", "n_initial", "batch")
    )
    profiles = sorted({m.profile for m in metas})
    units = "digits" if task in POOLS else "runs"
    ours = (
        f"{_span(counts)} {units} per method, {_span(initial)} initial of {_span(trials)} trials, "
        f"{_span(batch)} per round; profile {', '.join(profiles)}"
    )
    failed = sum(int(results.metrics(task, m)["failed"].sum()) for m in methods)
    lost = f" {failed} evaluations failed and are left out." if failed else ""
    paper = paper_size(task)
    if paper is None:
        return Text(f"Size: {ours}. The paper has no such task.{lost}", "size")
    theirs = (
        f"{paper.runs} {units}, {paper.initial} initial of {paper.trials} trials, "
        f"{paper.batch} per round ({paper.source})"
    )
    below = min(counts) < paper.runs or trials[0] < paper.trials
    verdict = "below the paper's size" if below else "at least the paper's size"
    return Text(f"Size: {ours}. Paper: {theirs}. This is {verdict}.{lost}", "size")


GIVEN = {
    "latent_space": "latent space",
    "kernel_features": "kernel features",
    "candidate_rows": "candidate rows",
    "safety": "safety functions that are modelled",
    "extra_trials": "evaluated before the initial trials",
}


def given_blocks(results: Results, task: str, methods: list[str]) -> list[Text]:
    """What every method was given, and what some of them cannot use."""
    metas = {m: results.meta(task, m) for m in methods}
    given = {name: text for meta in metas.values() for name, text in meta.given.items()}
    if not given:
        return []
    each = "; ".join(f"{GIVEN.get(name, name)}: {text}" for name, text in given.items())
    unused = {name: [style(m).label for m, meta in metas.items() if name in meta.unused] for name in given}
    left = "; ".join(f"{GIVEN.get(name, name)} by {', '.join(who)}" for name, who in unused.items() if who)
    texts = [Text(f"What every method was given. {each[0].upper()}{each[1:]}.", "size")]
    return texts + ([Text(f"Not used: {left}.", "size")] if left else [])


def same_trials_findings(results: Results, task: str, methods: list[str]) -> list[Text]:
    """Methods whose runs have the same outcomes trial by trial: they differ by nothing that acted."""
    return [
        Text(
            f"The same trials in every run: {'; '.join(style(m).label for m in group)}. What tells these "
            "methods apart changed no choice here.",
            "finding",
        )
        for group in results.same_trials(task, methods)
        if len(group) > 1
    ]


def _span(values: list[int]) -> str:
    low, high = min(values), max(values)
    return str(low) if low == high else f"{low} to {high}"


def leader_findings(results: Results, task: str, methods: list[str]) -> list[Text]:
    """Who leads in each metric, and against whom that is significant."""
    return [t for metric in METRICS if (t := _leader_finding(results, task, methods, metric)) is not None]


def _leader_finding(results: Results, task: str, methods: list[str], metric: str) -> Text | None:
    leader = results.leader(task, metric, methods)
    if leader is None:
        return None
    mean = with_error(results.estimate(task, leader.method, metric))
    head = f"{METRIC_LABELS[metric]}: {style(leader.method).label} leads with {mean}"
    if leader.runner_up is None:
        return Text(f"{head}; nothing to compare it with.", "finding")
    second = f"{style(leader.runner_up).label} {with_error(results.estimate(task, leader.runner_up, metric))}"
    if leader.significant:
        others = len(leader.rivals)
        against = "the other method" if others == 1 else f"all {others} other methods"
        return Text(f"{head}, significantly better than {against} (next: {second}).", "finding")
    pairs = min(c.pairs for c in leader.rivals.values())
    if pairs < MIN_PAIRS:
        reason = f"{pairs} common seeds are too few for a test, which needs {MIN_PAIRS}"
    else:
        reason = "no significant lead over " + ", ".join(style(m).label for m in leader.not_beaten)
    return Text(f"{head} (next: {second}); {reason}.", "finding")


def paper_findings(results: Results, task: str) -> list[Text]:
    """HdSafeBO here beside HdSafeBO in the paper, in combined standard errors."""
    size = paper_size(task)
    texts = []
    for metric in METRICS:
        theirs = paper_value(task, "hdsafebo", metric)
        if theirs is None or size is None or "hdsafebo" not in results.methods(task):
            continue
        ours = results.estimate(task, "hdsafebo", metric)
        spread = theirs.spread or 0.0
        their_error = spread / math.sqrt(size.runs) if theirs.kind == "std" else spread
        error = math.hypot(0.0 if math.isnan(ours.se) else ours.se, their_error)
        if not ours.runs or error == 0:
            continue
        apart = abs(ours.mean - theirs.value) / error
        texts.append(
            Text(
                f"HdSafeBO's {METRIC_LABELS[metric]} here ({with_error(ours)}) and in the paper "
                f"({theirs.value:g} ± {number(their_error, 2)}) are {number(apart, 2)} combined standard "
                f"errors apart: {'they agree' if apart <= AGREEMENT else 'they differ'}.",
                "finding",
            )
        )
    return texts


def closed_form_finding(results: Results) -> Text | None:
    """Random search on the synthetic task in closed form: safety is a standard normal there.

    Safety = Phi(-h) and the violation per trial h Phi(h) + phi(h), h the threshold.
    """
    if "sobol" not in results.methods("synthetic"):
        return None
    meta = results.meta("synthetic", "sobol")
    if len(meta.thresholds) != 1:
        return None
    h = meta.thresholds[0]
    safety, violation = (
        float(norm.cdf(-h)),
        (meta.n_trials - meta.n_initial) * float(h * norm.cdf(h) + norm.pdf(h)),
    )
    seen = {m: with_error(results.estimate("synthetic", "sobol", m)) for m in ("safety", "violation")}
    return Text(
        f"Check of the task: random search has Safety {number(safety)} and Violation {number(violation)} in "
        f"closed form; Sobol search has {seen['safety']} and {seen['violation']} here.",
        "finding",
    )


def ratio_finding(results: Results, task: str) -> Text | None:
    """This project's violation beside the least of the baselines'."""
    ours = [m for m in results.methods(task) if style(m).family == "ours"]
    others = [m for m in results.methods(task) if style(m).family not in ("ours", "ablation")]
    if not ours or not others:
        return None
    best = min(others, key=lambda m: results.estimate(task, m, "violation").mean)
    base = results.estimate(task, best, "violation").mean
    if not base > 0:
        return None
    shares = ", ".join(
        f"{style(m).label} {100 * results.estimate(task, m, 'violation').mean / base:.0f} %" for m in ours
    )
    return Text(
        f"{task_label(task)}: Violation as a share of the best baseline's ({style(best).label}): {shares}.",
        "finding",
    )


def regret_finding(task: str, shares: dict[str, pd.DataFrame]) -> Text:
    """Which methods come within 5 % of the best safe value, and after how many trials."""
    medians = {
        m: float(table["trials_to_95"].median())
        for m, table in shares.items()
        if table["trials_to_95"].notna().mean() > 0.5
    }
    if not medians:
        return Text(
            f"{task_label(task)}: no method reaches 95 % of the best safe value in most runs.", "finding"
        )
    each = ", ".join(
        f"{style(m).label} {v:.0f}" for m, v in sorted(medians.items(), key=lambda item: item[1])
    )
    return Text(
        f"{task_label(task)}: median trials until 95 % of the best safe value, "
        f"where most runs reach it: {each}.",
        "finding",
    )
