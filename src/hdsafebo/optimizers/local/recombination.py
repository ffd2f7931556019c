"""What evolution strategies know of searching many dimensions, for steps that a model only partly predicts.

Around one best point, chance decides: where outcomes are rugged it is a spike, often at the edge of the safe
set. The weighted mean of several good points lies where good points are common (intermediate recombination:
Hansen, The CMA evolution strategy: a tutorial, arXiv:1604.00772, section 3.2).
"""

from __future__ import annotations

import numpy as np

from hdsafebo.gp.sampling import thompson_sample
from hdsafebo.gp.surrogate import Surrogate
from hdsafebo.search.metric import Metric
from hdsafebo.typing import FloatArray

_STEPS = 1600
_STEP_SIZES = (0.003, 0.5)
"""Standard deviations of random steps per dimension, in widths of the box."""
_LARGEST = 0.98
"""Quantile of the sizes believed safe that counts as the largest of them."""


def recombined(parents: FloatArray) -> FloatArray:
    """(d,) mean of the (k, d) parents, the best first, with CMA-ES's logarithmic weights."""
    k = len(parents)
    weights = np.log(k + 0.5) - np.log(np.arange(1, k + 1))
    return np.asarray(weights @ parents / weights.sum())


def safe_steps(
    surrogate: Surrogate,
    metric: Metric,
    centre: FloatArray,
    beta: float,
    n: int,
    rng: np.random.Generator,
    least: float = 0.0,
) -> FloatArray:
    """(m, d) random steps of every size that is believed safe, m at most n, the smallest first.

    Steps that are believed safe form n classes by their size; of each class the best under a posterior sample
    of its own is taken. Chosen from all at once they would mostly be small: there the mean is known to be
    high.

    Args:
        surrogate: what is believed.
        metric: from unit cube to kernel inputs.
        centre: (d,) of the unit cube.
        beta: of the safe set.
        n: number of steps.
        rng: source of randomness.
        least: size of a step, in units of the largest that is believed safe.
    """
    if n == 0:
        return np.empty((0, len(centre)))
    deviation = np.geomspace(*_STEP_SIZES, _STEPS)
    steps = np.clip(centre + deviation[:, None] * rng.standard_normal((_STEPS, len(centre))), 0.0, 1.0)
    inputs = metric.inputs(steps)
    safe = np.flatnonzero(surrogate.believed_safe(inputs, beta))
    if least > 0 and len(safe):
        safe = safe[deviation[safe] >= least * np.quantile(deviation[safe], _LARGEST)]
    classes = [rows for rows in np.array_split(safe, n) if len(rows)]
    chosen = [rows[thompson_sample(surrogate.objective, inputs[rows], 1, rng)] for rows in classes]
    return steps[np.concatenate([safe[:0], *chosen])]
