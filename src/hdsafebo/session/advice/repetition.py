"""Which of several noisy alternatives to measure again.

Top-two Thompson sampling (Russo 2020, Operations Research 68:1625): a posterior sample says which is best;
half of the time that one is measured, otherwise the best one of the first further sample that says another.
"""

from __future__ import annotations

import numpy as np

from hdsafebo.gp.gaussian_process import GaussianProcess
from hdsafebo.gp.sampling import SamplePaths
from hdsafebo.typing import FloatArray

_SAMPLES = 30  # drawn at most until one says another; were all of them to agree, that one is measured


def top_two(gp: GaussianProcess, inputs: FloatArray, rng: np.random.Generator) -> int:
    """Row of the (k, p) kernel inputs to measure next, k >= 1."""
    best = SamplePaths(gp, _SAMPLES, rng).values(inputs).argmax(axis=0)
    others = best[best != best[0]]
    leader = rng.random() < 0.5 or len(others) == 0
    return int(best[0] if leader else others[0])
