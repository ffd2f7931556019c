"""Claims on the guarantee (Proposition 1), the bound (Theorem 1) and the latent space (Proposition 3)."""

from __future__ import annotations

import numpy as np
from scipy.stats import norm

from hdsafebo.report.claims.base import NOT_RUN, Claim, Status, Verdict, grade, worst_of
from hdsafebo.report.data.inputs import Isometry
from hdsafebo.report.data.methods import task_label
from hdsafebo.report.data.results import Results
from hdsafebo.report.formatting import number, with_error

GRADED = ("hdsafebo", "hdsafebo_local", "linebo", "linebo_lower")
"""Methods whose safe set has a bound, HdSafeBO first."""
LOOSE = 10.0
"""A bound of more than so many times what was observed says nothing."""
NOISE = {"synthetic": 0.01}
"""Standard deviation of the noise of observed safety values, by task; none elsewhere. It is in the observed
violation and not in the bound, and adds at most phi(0) times as much to the expectation of one trial."""


def theory_claims(results: Results, isometry: dict[str, Isometry] | None) -> list[Claim]:
    """Observed safety beside the guarantee, observed violation beside the sum of one-step bounds."""
    methods = [m for m in GRADED if any(m in results.methods(task) for task in results.experiments)]
    if "hdsafebo" not in methods:
        methods = ["hdsafebo", *methods]
    return [
        Claim(
            "guarantee",
            "Each trial is safe with probability at least α, where Φ(β) ≤ 1 − α.",
            "Proposition 1",
            "Per task: reproduced when the mean safe share less two standard errors is at least the α that "
            "β guarantees; partly when only the mean is. An α below one half says nothing: more may be "
            "unsafe than safe. The worst task counts.",
            "safety",
            {method: _guarantee(results, method) for method in methods},
        ),
        Claim(
            "one_step_bound",
            "The expected cumulative violation is bounded.",
            "Theorem 1",
            "Per task: reproduced when the mean violation is at most the mean sum of the one-step bounds "
            "σ(βΦ(β) + φ(β)), both of the functions that were modelled, as they were modelled, and the "
            f"noise of the observations allowed for. A bound of more than {LOOSE:g} times what was observed "
            "says nothing. The worst task counts. Where a function is modelled through a transform, no "
            "bound is on record.",
            "safety",
            {method: _bound(results, method) for method in methods},
        ),
        _theorem(results),
        _original_space(results, isometry),
        Claim(
            "information_gain",
            "The trust region lowers the maximum information gain, and so the bound of Theorem 1.",
            "Section 4.2",
            "Not graded: the information gain of a run is not on record.",
            "safety",
            {"": Verdict("not run", "not measured")},
        ),
    ]


def _alpha(results: Results, task: str, method: str) -> float | None:
    return results.meta(task, method).guaranteed_alpha if method in results.methods(task) else None


def _guarantee(results: Results, method: str) -> Verdict:
    found: list[Verdict] = []
    for task in results.experiments:
        alpha = _alpha(results, task, method)
        if alpha is None:
            continue
        safe = results.estimate(task, method, "safety")
        low = safe.mean - (2 * safe.se if np.isfinite(safe.se) else 0.0)
        status = grade(low >= alpha, safe.mean >= alpha)
        if alpha < 0.5 and status == "reproduced":
            status = "empty"
        text = f"{task_label(task)}: observed {with_error(safe)}, guaranteed {number(alpha)}"
        found.append(Verdict(status, text + (" (vacuous)" if alpha < 0.5 else "")))
    return worst_of(found) if found else NOT_RUN


def _bound(results: Results, method: str) -> Verdict:
    found: list[Verdict] = []
    for task in results.experiments:
        if method not in results.methods(task):
            continue
        limit = results.estimate(task, method, "violation_bound")
        seen = results.estimate(task, method, "modelled_violation")
        if not limit.runs:
            continue
        meta = results.meta(task, method)
        noise = NOISE.get(task, 0.0) * float(norm.pdf(0)) * (meta.n_trials - meta.n_initial)
        status = grade(seen.mean <= limit.mean + noise, False)
        if status == "reproduced" and limit.mean > LOOSE * seen.mean:
            status = "empty"
        allowed = f" and {number(noise)} for the noise" if noise else ""
        found.append(
            Verdict(
                status,
                f"{task_label(task)}: observed {with_error(seen)}, sum of bounds "
                f"{with_error(limit)}{allowed}",
            )
        )
    return worst_of(found) if found else NOT_RUN


def _theorem(results: Results) -> Claim:
    """Does the theorem's statement follow from the one-step bound at the beta and size of the runs?"""
    verdict = NOT_RUN
    tasks = [t for t in results.experiments if _alpha(results, t, "hdsafebo") is not None]
    if tasks:
        meta = results.meta(tasks[0], "hdsafebo")
        beta = float(meta.beta or 0.0)
        needed = (beta + float(norm.pdf(beta) / norm.cdf(beta))) / 2
        # The least that beta_c can be here: as many points as a round has trials, one round, delta 1/2
        least = float(np.sqrt(2 * np.log(meta.batch * np.pi**2 / (6 * 0.5))))
        status: Status = "partly" if least >= needed else "not"
        verdict = Verdict(
            status,
            "as printed the proof takes a random term out of an expectation; the statement follows from the "
            f"one-step bound when √β_c ≥ (β + φ(β)/Φ(β))/2 = {number(needed)} at β = {number(beta)}, and "
            f"√β_c is at least {number(least)} here",
        )
    return Claim(
        "theorem_1",
        "E[V_T] ≤ (1 − α) √(C₁ T β_c γ_T) with probability 1 − δ.",
        "Theorem 1",
        "Partly: the printed proof does not hold, and the statement follows from the tighter one-step bound "
        "σ(βΦ(β) + φ(β)) ≤ 2 Φ(β) √β_c σ. Not: neither.",
        "safety",
        {"": verdict},
    )


def _original_space(results: Results, isometry: dict[str, Isometry] | None) -> Claim:
    """Proposition 3: what it carries over, and whether the embedding is what it asks for."""
    verdict = NOT_RUN
    alphas = [a for t in results.experiments if (a := _alpha(results, t, "hdsafebo")) is not None]
    if alphas and isometry:
        each = ", ".join(f"{name} {check.distance_correlation:.4f}" for name, check in isometry.items())
        vacuous = max(alphas) < 0.5
        verdict = Verdict(
            "empty" if vacuous else "partly",
            f"what carries over is α = {number(max(alphas))}; distance correlation of the learned and linear "
            f"embeddings of field maps: {each} (1 is isometric up to scale; principal components are "
            "isometric on their subspace)",
        )
    return Claim(
        "proposition_3",
        "With an isometric embedding and a stationary kernel the guarantee holds in the original space.",
        "Proposition 3",
        "It follows at once: such a kernel sees distances only, and these are the same. Partly: the "
        "embeddings are isometric only nearly. Says nothing: the α that carries over is below one half.",
        "embeddings",
        {"": verdict},
    )
