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
from hdsafebo.search.row_space import RowSpace
from hdsafebo.typing import FloatArray

_STEPS = 1600
"""Steps that are judged: a hundred and more of each size, of which some are believed safe."""
_STEP_SIZES = (0.003, 0.5)
"""Standard deviations of random steps per dimension, in widths of the box. In fitted length scales, which
small steps make short, both can shrink together until rounds are copies of one policy (seen on the hand)."""
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
    rows: RowSpace,
    centre: FloatArray,
    beta: float,
    n: int,
    rng: np.random.Generator,
    *,
    least: float = 0.0,
    whole: bool = True,
) -> FloatArray:
    """(m, d) ends of random steps of every size that is believed safe, m at most n, the smallest first.

    Steps that are believed safe form n classes by their size; of each class the best under a posterior sample
    of its own is taken. Chosen from all at once they would mostly be small: there the mean is known to be
    high.

    Args:
        surrogate: what is believed.
        metric: from unit cube to kernel inputs.
        rows: what kernel inputs see of a step.
        centre: (d,) of the unit cube.
        beta: of the safe set.
        n: number of steps.
        rng: source of randomness.
        least: size of a step, in units of the largest that is believed safe.
        whole: judge steps cut to the cube. Without it, they are judged by what kernel inputs see of them, and
            only those that are taken are given the rest and cut: with thousands of dimensions that is many
            times quicker, and the cube cuts little of a step.
    """
    if n == 0:
        return np.empty((0, len(centre)))
    sizes = np.geomspace(*_STEP_SIZES, _STEPS)
    steps = rng.standard_normal((_STEPS, len(centre) if whole else rows.rank))
    if whole:
        ends = np.clip(centre + sizes[:, None] * steps, 0.0, 1.0)
        inputs = metric.inputs(ends)
    else:
        inputs = metric.inputs(centre[None]) + sizes[:, None] * (steps @ rows.image.T)
    safe = np.flatnonzero(surrogate.believed_safe(inputs, beta))
    if least > 0 and len(safe):
        safe = safe[sizes[safe] >= least * np.quantile(sizes[safe], _LARGEST)]
    classes = [part for part in np.array_split(safe, n) if len(part)]
    chosen = [part[thompson_sample(surrogate.objective, inputs[part], 1, rng)] for part in classes]
    taken = np.concatenate([safe[:0], *chosen])
    if whole:
        return ends[taken]
    return np.clip(centre + sizes[taken, None] * rows.completed(steps[taken], rng), 0.0, 1.0)
