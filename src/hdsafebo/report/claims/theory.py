"""Claims on the guarantee (Proposition 1) and the violation bound (Theorem 1)."""

from __future__ import annotations

import numpy as np

from hdsafebo.report.claims.base import NOT_RUN, Claim, Verdict, grade, worst_of
from hdsafebo.report.data.methods import task_label
from hdsafebo.report.data.results import Results
from hdsafebo.report.formatting import number, with_error


def theory_claims(results: Results) -> list[Claim]:
    """Observed safety beside the guarantee, observed violation beside the sum of one-step bounds."""
    guarantee: list[Verdict] = []
    bound: list[Verdict] = []
    for task in results.experiments:
        alpha = (
            results.meta(task, "hdsafebo").guaranteed_alpha if "hdsafebo" in results.methods(task) else None
        )
        if alpha is None:
            continue
        safe = results.estimate(task, "hdsafebo", "safety")
        low = safe.mean - (2 * safe.se if np.isfinite(safe.se) else 0.0)
        vacuous = " (vacuous)" if alpha < 0.5 else ""
        guarantee.append(
            Verdict(
                grade(low >= alpha, safe.mean >= alpha),
                f"{task_label(task)}: observed {with_error(safe)}, guaranteed {number(alpha)}{vacuous}",
            )
        )
        limit = results.estimate(task, "hdsafebo", "violation_bound")
        seen = results.estimate(task, "hdsafebo", "violation")
        if limit.runs:
            bound.append(
                Verdict(
                    grade(seen.mean <= limit.mean, False),
                    f"{task_label(task)}: observed {with_error(seen)}, sum of bounds {with_error(limit)}",
                )
            )
    return [
        Claim(
            "guarantee",
            "Each trial is safe with probability at least α, where Φ(β) ≤ 1 − α.",
            "Proposition 1",
            "Per task: reproduced when the mean safe share less two standard errors is at least the α that "
            "β guarantees; partly when only the mean is. The worst task counts.",
            "safety",
            {"": worst_of(guarantee) if guarantee else NOT_RUN},
        ),
        Claim(
            "violation_bound",
            "The expected cumulative violation is bounded.",
            "Theorem 1",
            "Per task: reproduced when the mean violation is at most the mean sum of the one-step bounds "
            "σ(βΦ(β) + φ(β)), which replace the theorem's bound "
            "because its proof does not hold as printed. The worst task counts.",
            "safety",
            {"": worst_of(bound) if bound else NOT_RUN},
        ),
    ]
