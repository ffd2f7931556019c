"""Claims on the synthetic functions (Table 1, appendix C.1)."""

from __future__ import annotations

from hdsafebo.report.claims.base import BASELINES, NOT_RUN, Claim, Verdict, grade, superiority_claim
from hdsafebo.report.data.methods import ORIGINAL, style
from hdsafebo.report.data.results import Results
from hdsafebo.report.formatting import signed


def synthetic_claims(results: Results) -> list[Claim]:
    """Objective, Safety and Violation against the baselines; SafeOpt; latent against original space."""
    texts = {
        "objective": (
            "On synthetic functions HdSafeBO reaches a significantly better objective than all baselines "
            "(3.96 against at most 3.15)."
        ),
        "safety": (
            "On synthetic functions it has the highest safe decision ratio (0.81 against 0.77 to 0.79)."
        ),
        "violation": (
            "On synthetic functions it has the lowest cumulative violation (27.4 against 36.3 to 39.6)."
        ),
    }
    claims = [
        superiority_claim(
            results,
            f"synthetic_{metric}",
            text,
            "Table 1, appendix C.1",
            "synthetic",
            tasks=["synthetic"],
            metric=metric,
            baselines=BASELINES,
        )
        for metric, text in texts.items()
    ]
    return [*claims, _safeopt(results), _latent_against_original(results)]


def _safeopt(results: Results) -> Claim:
    ran = [m for m in ("safeopt", "safeopt" + ORIGINAL) if m in results.methods("synthetic")]
    verdict = NOT_RUN
    if ran:
        gain = results.metrics("synthetic", ran[0])["improvement"].fillna(0.0)
        stuck = float((gain <= 0).mean())
        verdict = Verdict(
            grade(stuck >= 0.9, stuck >= 0.5),
            f"no gain over the initial data in {100 * stuck:.0f} % of {len(gain)} runs",
        )
    rule = (
        "Reproduced: no better than the initial data in at least 90 % of the runs. Partly: in at least half."
    )
    return Claim(
        "synthetic_safeopt",
        "SafeOpt fails to expand the safe region from the initial points.",
        "Section 5.1",
        rule,
        "synthetic",
        {"": verdict},
    )


def _latent_against_original(results: Results) -> Claim:
    pairs = [b for b in BASELINES if {b, b + ORIGINAL} <= set(results.methods("synthetic"))]
    verdict = NOT_RUN
    if pairs:
        found = {b: results.compare("synthetic", b, b + ORIGINAL, "objective") for b in pairs}
        ahead = sum(c.difference > 0 for c in found.values())
        worse = [style(b).label for b, c in found.items() if c.worse]
        status = grade(2 * ahead > len(found) and not worse, 2 * ahead >= len(found))
        leads = ", ".join(f"{style(b).label} {signed(c.difference)}" for b, c in found.items())
        verdict = Verdict(status, f"objective in the latent space minus in the original space: {leads}")
    rule = (
        "Reproduced: the mean objective is higher over the latent space for most baselines and "
        "significantly lower for none. Partly: for at least half."
    )
    return Claim(
        "synthetic_latent",
        "Baselines improve slightly over the embedded subspace.",
        "Appendix C.1",
        rule,
        "synthetic",
        {"": verdict},
    )
