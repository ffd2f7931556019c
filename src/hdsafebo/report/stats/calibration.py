"""Predicted against observed safety, and what beta guarantees."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd
from scipy.stats import binomtest

from hdsafebo.runs.read import RunFile


@dataclass(frozen=True)
class Calibration:
    """Safe probabilities that were predicted when trials were asked, and what came of them.

    Attributes:
        bins: one row per bin of predicted probability that holds a trial: low, high, predicted (mean),
            observed (safe share), observed_low, observed_high (Clopper-Pearson), trials.
        trials: trials that the method chose, with a prediction.
        predicted: mean predicted safe probability.
        observed: safe share of the same trials.
        interval: Clopper-Pearson interval of that share.
        brier: mean squared difference of prediction and outcome.
        brier_constant: the same for the observed share as constant prediction: what a model must beat.
    """

    bins: pd.DataFrame
    trials: int
    predicted: float
    observed: float
    interval: tuple[float, float]
    brier: float
    brier_constant: float


def calibrate(runs: list[RunFile], *, bins: int, confidence: float) -> Calibration | None:
    """Calibration over all trials that the method chose in some run files; None without a prediction.

    Binomial intervals take trials as independent; those of one run are not quite.
    """
    columns = ["predicted_safe_probability", "safe"]
    rows = pd.concat([run.chosen[columns] for run in runs]).dropna()
    if rows.empty:
        return None
    p = rows["predicted_safe_probability"].to_numpy(float)
    y = rows["safe"].to_numpy(float)
    edges = np.linspace(0.0, 1.0, bins + 1)
    index = np.minimum(np.searchsorted(edges, p, side="right") - 1, bins - 1)
    groups = (
        pd.DataFrame({"bin": index, "p": p, "y": y})
        .groupby("bin")
        .agg(p=("p", "mean"), y=("y", "sum"), n=("y", "size"))
    )
    observed = [binomtest(int(k), int(n)) for k, n in zip(groups["y"], groups["n"], strict=True)]
    limits = np.array([test.proportion_ci(confidence, "exact") for test in observed])
    at = groups.index.to_numpy(int)
    table = pd.DataFrame(
        {
            "low": edges[at],
            "high": edges[at + 1],
            "predicted": groups["p"].to_numpy(),
            "observed": (groups["y"] / groups["n"]).to_numpy(),
            "observed_low": limits[:, 0],
            "observed_high": limits[:, 1],
            "trials": groups["n"].to_numpy(),
        }
    )
    whole = binomtest(int(y.sum()), len(y)).proportion_ci(confidence, "exact")
    share = float(y.mean())
    return Calibration(
        bins=table,
        trials=len(y),
        predicted=float(p.mean()),
        observed=share,
        interval=(float(whole.low), float(whole.high)),
        brier=float(((p - y) ** 2).mean()),
        brier_constant=share * (1 - share),
    )
