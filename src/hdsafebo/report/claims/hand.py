"""Claims on the hand and the ablations that run on it (Figure 3, appendices C.2 and C.4)."""

from __future__ import annotations

from hdsafebo.report.claims.base import NOT_RUN, Claim, Verdict, grade, superiority_claim
from hdsafebo.report.data.methods import beta_of_ablation, style
from hdsafebo.report.data.metrics import early_violation
from hdsafebo.report.data.results import Results
from hdsafebo.report.formatting import interval, number, signed
from hdsafebo.report.stats.statistics import Comparison

EARLY_SHARE = 0.25


def hand_claims(results: Results) -> list[Claim]:
    """Against the baselines, in both spaces; the two ablations."""
    shown = ["config", "cei", "cmaes"]  # SCBO and LineBO are left out of the paper's figure
    texts = {
        "objective": (
            "On the hand HdSafeBO optimises more efficiently than the baselines over the PCA subspace."
        ),
        "safety": "On the hand HdSafeBO samples fewer unsafe policies than the baselines.",
        "violation": "On the hand the cumulative violation of HdSafeBO is the lowest.",
    }
    claims = [
        superiority_claim(
            results,
            f"hand_{metric}",
            text,
            "Figure 3",
            "hand",
            tasks=["hand"],
            metric=metric,
            baselines=shown,
        )
        for metric, text in texts.items()
    ]
    return [_original_fails(results), _no_reward(results), *claims, _components(results), _beta(results)]


def _original_fails(results: Results) -> Claim:
    metas = {m: results.meta("hand", m) for m in results.methods("hand")}
    inputs = [m for m, meta in metas.items() if meta.space == "original"]
    ran = [m for m in inputs if not metas[m].algorithm.startswith("hdsafebo")]
    verdict = NOT_RUN
    if ran and "hdsafebo" in results.methods("hand"):
        scale = results.estimate("hand", "hdsafebo", "improvement").mean
        gains = {m: results.estimate("hand", m, "improvement").mean for m in ran}
        fails = [m for m, gain in gains.items() if not gain > 0.1 * scale]
        status = grade(len(fails) == len(ran), 2 * len(fails) >= len(ran))
        each = ", ".join(f"{style(m).label} {number(g)}" for m, g in gains.items())
        verdict = Verdict(status, f"gain over the initial policies: HdSafeBO {number(scale)}, {each}")
    rule = (
        "A baseline fails when its mean gain over the best initial policy is at most a tenth of "
        "HdSafeBO's. Reproduced: all fail. Partly: at least half."
    )
    return Claim(
        "hand_original",
        "All baselines fail to improve the objective over the original parameters.",
        "Section 5.2",
        rule,
        "hand",
        {"": verdict},
    )


def _no_reward(results: Results) -> Claim:
    ran = [m for m in ("scbo", "linebo", "linebo_lower") if m in results.methods("hand")]
    verdict = NOT_RUN
    if {"scbo", "linebo"} <= set(ran):
        means = {m: results.estimate("hand", m, "objective").mean for m in ran}
        fails = [m for m, mean in means.items() if not mean > 0]
        each = ", ".join(f"{style(m).label} {number(v)}" for m, v in means.items())
        verdict = Verdict(grade(len(fails) == len(ran), bool(fails)), f"best safe return: {each}")
    return Claim(
        "hand_no_reward",
        "SCBO (L) and LineBO (L) fail to attain a positive reward.",
        "Section 5.2",
        "Reproduced: the mean of the best safe return is at most 0 for each of them. Partly: for one.",
        "hand",
        {"": verdict},
    )


def _components(results: Results) -> Claim:
    needed = {"hdsafebo", "hdsafebo_global", "hdsafebo_pessimistic"}
    verdict = NOT_RUN
    if needed <= set(results.methods("hand")):
        objective = results.compare("hand", "hdsafebo", "hdsafebo_global", "objective")
        safety = results.compare("hand", "hdsafebo", "hdsafebo_global", "safety")
        early = results.compare_values(
            "hand/early",
            early_violation(results.runs["hand", "hdsafebo"], EARLY_SHARE),
            early_violation(results.runs["hand", "hdsafebo_pessimistic"], EARLY_SHARE),
            higher_is_better=False,
        )
        parts = {
            "objective without local search": objective,
            "safety without local search": safety,
            "early violation without optimism": early,
        }
        verdict = _directions(parts)
    rule = (
        "Three comparisons on common seeds: objective and Safety against the variant without local search, "
        "violation in the first quarter of the trials against "
        "the variant without optimism. Reproduced: all significantly as the paper says. Partly: none "
        "significantly the other way and at least two in its direction."
    )
    statement = (
        "Without local search optimisation and safety degrade; without optimism there "
        "are more unsafe trials early on."
    )
    return Claim("hand_components", statement, "Appendix C.2", rule, "ablation", {"": verdict})


def _directions(parts: dict[str, Comparison]) -> Verdict:
    text = "; ".join(
        f"advantage in {name}: {signed(c.difference)} ({interval(c)})" for name, c in parts.items()
    )
    values = list(parts.values())
    leaning = not any(c.worse for c in values) and sum(c.difference > 0 for c in values) >= 2
    return Verdict(grade(all(c.better for c in values), leaning), text)


def beta_methods(results: Results, task: str) -> dict[float, str]:
    """Methods of the ablation on beta, HdSafeBO itself at the beta of its run file."""
    found = {b: m for m in results.methods(task) if (b := beta_of_ablation(m)) is not None}
    main = results.runs.get((task, "hdsafebo"))
    if found and main is not None and main.meta.beta is not None:
        found.setdefault(main.meta.beta, "hdsafebo")
    return dict(sorted(found.items()))


def _beta(results: Results) -> Claim:
    methods = beta_methods(results, "hand")
    verdict = NOT_RUN
    if len(methods) > 2 and "hdsafebo" in methods.values():
        gain = results.estimate("hand", "hdsafebo", "improvement").mean
        means = {b: results.estimate("hand", m, "objective").mean for b, m in methods.items()}
        base = results.estimate("hand", "hdsafebo", "objective").mean
        apart = [
            b
            for b, m in methods.items()
            if m != "hdsafebo" and results.compare("hand", "hdsafebo", m, "objective").significant
        ]
        spread = max(abs(v - base) for v in means.values()) / gain if gain > 0 else float("inf")
        status = grade(not apart and spread <= 0.25, not apart or spread <= 0.25)
        each = ", ".join(f"β = {b:g}: {number(v)}" for b, v in means.items())
        if len(results.same_trials("hand", list(methods.values()))) == 1:
            status = "empty"
            each += "; every trial is the same whatever β is"
        verdict = Verdict(
            status, f"objective {each}; largest distance from HdSafeBO's is {100 * spread:.0f} % of its gain"
        )
    rule = (
        "Reproduced: no β differs significantly in the objective, and all means lie within a "
        "quarter of HdSafeBO's gain over the initial data. Partly: one of the two. Says "
        "nothing: all trials are the same."
    )
    statement = "Performance is similar for β from 0 to 16; safety may become slightly worse as β grows."
    return Claim("hand_beta", statement, "Appendix C.4", rule, "ablation", {"": verdict})
