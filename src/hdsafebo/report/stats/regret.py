"""How fast a run comes near a known optimum."""

from __future__ import annotations

import numpy as np
import pandas as pd

from hdsafebo.runs.read import RunFile
from hdsafebo.runs.series import Series, per_round

CHECKPOINTS = (300, 400, 600, 1000)
TARGET_SHARE = 0.95


def regret(run: RunFile, series: Series | None = None) -> pd.DataFrame | None:
    """Share of the best safe value of a finite set over the trials; None when it is unknown or not positive.

    Returns:
        One row per seed: share_300, share_400, share_600, share_1000 (best safe objective / optimum by the
        round in which that trial was; NaN beyond the end of the run) and trials_to_95 (trials at the end of
        the round that reached 95 %, the initial ones included; NaN when it never did).
    """
    optimum = run.meta.optimum
    if optimum is None or optimum <= 0:
        return None
    curves = per_round(run.trials) if series is None else series
    share = np.nan_to_num(curves.objective / optimum, nan=-np.inf)
    table = pd.DataFrame(index=pd.Index(curves.units, name="seed"))
    for checkpoint in CHECKPOINTS:
        at = int(np.searchsorted(curves.trials, checkpoint))
        known = at < len(curves.trials)
        values = share[:, at] if known else np.full(len(share), np.nan)
        table[f"share_{checkpoint}"] = np.where(np.isfinite(values), values, np.nan)
    reached = share >= TARGET_SHARE
    table["trials_to_95"] = np.where(reached.any(axis=1), curves.trials[reached.argmax(axis=1)], np.nan)
    return table
