"""Numbers that the paper prints, each with its place.

Y. Wei, Z. Yi, H. Li, S. Soedarmadji, Y. Sui: Safe Bayesian Optimization for the Control of
High-Dimensional Embodied Systems. CoRL 2024.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class PaperValue:
    """A number of the paper.

    Attributes:
        value: as printed.
        spread: what follows the plus-minus sign.
        kind: what the spread is: a standard error or a standard deviation.
        source: table or section.
    """

    value: float
    spread: float | None
    kind: Literal["se", "std"]
    source: str


@dataclass(frozen=True)
class PaperSize:
    """Sizes of an experiment in the paper: independent runs, initial and all trials, trials per round."""

    runs: int
    initial: int
    trials: int
    batch: int
    source: str


SIZES = {
    "synthetic": PaperSize(100, 200, 500, 10, "Table 1"),
    "hand": PaperSize(50, 200, 1000, 10, "Figure 3 and section B.3"),
    "scs": PaperSize(10, 200, 1000, 10, "Figure 4"),
    "digits": PaperSize(10, 20, 200, 1, "section C.6; one run for each of ten digits"),
}

_SYNTHETIC_LATENT = {
    # Table 1 for HdSafeBO; the L columns of the appendix's table on embedded subspaces.
    "hdsafebo": ((3.96, 0.15), (0.81, 0.02), (27.42, 4.01)),
    "linebo": ((3.03, 0.05), (0.79, 0.0), (36.26, 1.28)),
    "scbo": ((3.15, 0.06), (0.77, 0.0), (38.51, 0.64)),
    "config": ((2.99, 0.04), (0.77, 0.0), (39.08, 0.6)),
    "cei": ((2.92, 0.03), (0.77, 0.0), (39.15, 0.64)),
    "cmaes": ((2.69, 0.04), (0.77, 0.01), (38.01, 1.94)),
}
_SYNTHETIC_ORIGINAL = {
    # Table 1. The appendix repeats it with other figures for SCBO: 2.95 +- 0.04 and 38.47 +- 0.69.
    "linebo_original": ((3.07, 0.04), (0.78, 0.0), (36.59, 0.82)),
    "scbo_original": ((2.97, 0.06), (0.77, 0.0), (39.05, 0.92)),
    "config_original": ((2.91, 0.05), (0.77, 0.0), (38.96, 0.96)),
    "cei_original": ((2.9, 0.03), (0.77, 0.0), (39.61, 0.58)),
    "cmaes_original": ((2.7, 0.04), (0.78, 0.01), (38.65, 1.89)),
}
_DIGITS = {
    "hdsafebo": ((1.14, 0.12), (18.99, 10.82)),
    "scbo": ((1.08, 0.18), (52.01, 20.28)),
    "config": ((0.77, 0.26), (72.09, 17.85)),
    "cei": ((0.77, 0.26), (72.04, 17.82)),
    "cmaes": ((0.68, 0.12), (72.01, 7.06)),
}
_STIMULATION = {
    "scs_st": {"hdsafebo": (0.26, 0.02), "hesbo": (0.23, 0.0), "baxus": (0.24, 0.03)},
    "scs_ga": {"hdsafebo": (0.22, 0.01), "hesbo": (0.19, 0.02), "baxus": (0.19, 0.05)},
}
_SECONDS_PER_ROUND = {
    "hdsafebo": (11.75, 1.35),
    "linebo": (9.88, 1.01),
    "scbo": (11.99, 1.21),
    "config": (9.49, 1.05),
    "cei": (20.38, 1.21),
    "cmaes": (9.59, 0.72),
}
ISOMETRY = {
    "irvae": {"distance_correlation": 0.9729, "gp_mean_difference": 1.2936, "gp_variance_difference": 2.9953},
    "vae": {"distance_correlation": 0.8923, "gp_mean_difference": 2.1839, "gp_variance_difference": 4.5608},
}
ISOMETRY_POINTS = 10_000
ISOMETRY_SOURCE = "appendix C.3, distance preserving table"


def paper_value(task: str, method: str, metric: str) -> PaperValue | None:
    """The paper's number for a task, method and metric; None when it prints none."""
    if task == "synthetic" and metric in ("objective", "safety", "violation"):
        index = ("objective", "safety", "violation").index(metric)
        if method in _SYNTHETIC_LATENT:
            source = "Table 1" if method == "hdsafebo" else "appendix C.1, columns L"
            return PaperValue(*_SYNTHETIC_LATENT[method][index], "se", source)
        if method in _SYNTHETIC_ORIGINAL:
            return PaperValue(*_SYNTHETIC_ORIGINAL[method][index], "se", "Table 1")
    if task == "digits" and metric in ("objective", "violation") and method in _DIGITS:
        return PaperValue(*_DIGITS[method][("objective", "violation").index(metric)], "std", "appendix C.6")
    if task in _STIMULATION and metric == "objective" and method in _STIMULATION[task]:
        return PaperValue(*_STIMULATION[task][method], "std", "appendix C.5")
    if task in _STIMULATION and metric == "seconds_per_round" and method in _SECONDS_PER_ROUND:
        return PaperValue(*_SECONDS_PER_ROUND[method], "std", "appendix C.7")
    return None


def paper_size(task: str) -> PaperSize | None:
    """The paper's sizes for a task; None when it has no such task."""
    if task.startswith("scs_"):
        return SIZES["scs"] if task in _STIMULATION else None
    return SIZES.get(task.split("_")[0])
