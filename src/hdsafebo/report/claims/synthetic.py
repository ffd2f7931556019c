"""Claims on the synthetic functions (Table 1, appendix C.1)."""

from __future__ import annotations

import numpy as np

from hdsafebo.params import Space
from hdsafebo.report.claims.base import BASELINES, NOT_RUN, Claim, Verdict, grade, superiority_claim
from hdsafebo.report.data.methods import style
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
            "On synthetic functions HdSafeBO has the highest safe decision ratio (0.81 against 0.77 to 0.79)."
        ),
        "violation": (
            "On synthetic functions HdSafeBO has the lowest cumulative violation (27.4 against 36.3 to 39.6)."
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
    ran = results.methods_with("synthetic", "safeopt")
    verdict = NOT_RUN
    if ran:
        table = results.metrics("synthetic", ran[0])
        certified = [counts.certified for counts in results.meta("synthetic", ran[0]).counts]
        known = [n for n in certified if n is not None]
        still = (table["new_points"] == 0).to_numpy()
        stuck = still if len(known) < len(certified) else still & (np.array(known) == 0)
        share = float(stuck.mean())
        most = f"at most {max(known)}" if known else "an unknown number"
        verdict = Verdict(
            grade(share >= 0.9, share >= 0.5),
            f"{int(table['new_points'].sum())} of {int(table['chosen'].sum())} trials at a point "
            f"that was not tried before, {most} of its grid points certified; stuck in "
            f"{100 * share:.0f} % of {len(table)} runs",
        )
    rule = (
        "A run is stuck when SafeOpt certifies no point of its grid and tries no new point: its objective "
        "may still rise, as the maximum of repeated noisy observations. Reproduced: at least 90 % of the "
        "runs are stuck. Partly: at least half."
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
    spaces: tuple[Space, ...] = ("latent", "original")
    ran = {b: [results.methods_with("synthetic", b, space) for space in spaces] for b in BASELINES}
    pairs = {b: (latent[0], original[0]) for b, (latent, original) in ran.items() if latent and original}
    verdict = NOT_RUN
    if pairs:
        found = {b: results.compare("synthetic", *pair, "objective") for b, pair in pairs.items()}
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
