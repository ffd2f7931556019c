"""Claims on the embedding (appendix C.3) and the digits (appendix C.6)."""

from __future__ import annotations

from hdsafebo.report.claims.base import NOT_RUN, Claim, Verdict, grade, superiority_claim
from hdsafebo.report.data.inputs import Isometry
from hdsafebo.report.data.results import DIGITS, Results
from hdsafebo.report.formatting import number


def embedding_claims(isometry: dict[str, Isometry] | None) -> list[Claim]:
    """IRVAE against VAE."""
    verdict = NOT_RUN
    if isometry is not None and {"irvae", "vae"} <= set(isometry):
        a, b = isometry["irvae"], isometry["vae"]
        wins = [
            a.distance_correlation > b.distance_correlation,
            a.gp_mean_difference < b.gp_mean_difference,
            a.gp_variance_difference < b.gp_variance_difference,
        ]
        verdict = Verdict(
            grade(all(wins), any(wins)),
            f"IRVAE against VAE: correlation {a.distance_correlation:.4f} / {b.distance_correlation:.4f} "
            "(paper 0.9729 / 0.8923), "
            f"GP mean difference {number(a.gp_mean_difference)} / {number(b.gp_mean_difference)}, "
            f"GP variance difference {number(a.gp_variance_difference)} / {number(b.gp_variance_difference)}",
        )
    rule = "Reproduced: IRVAE better in all three measures. Partly: in one or two."
    statement = "The IRVAE preserves distances and GP predictions better than a conventional VAE."
    return [Claim("embedding_isometry", statement, "Appendix C.3", rule, "embeddings", {"": verdict})]


def digit_claims(results: Results) -> list[Claim]:
    """Objective and Violation against the baselines, digits as units."""
    texts = {
        "objective": "On digits HdSafeBO draws the thickest recognised digits (1.14 against 1.08 for SCBO).",
        "violation": (
            "On digits its violation is 63 % below that of the second best method, SCBO (19 against 52)."
        ),
    }
    return [
        superiority_claim(
            results,
            f"digits_{metric}",
            text,
            "Appendix C.6",
            "digits",
            tasks=[DIGITS],
            metric=metric,
            baselines=["scbo", "config", "cei", "cmaes"],
        )
        for metric, text in texts.items()
    ]
