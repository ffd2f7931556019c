"""The paper's synthetic task (section 5.1 and appendix): objective and safety drawn from Gaussian processes.

Inputs x in R^D are mapped to R^d by a random linear projection, of whose coordinates d_e matter. At a length
scale of 0.05 and d_e = 40 a global search meets white noise: any point has Pr(g >= h) = Phi(-h) = 0.7734
and expected violation phi(h) + h Phi(h) = 0.1311 per trial (h = -0.75), so 300 trials of a random search
give 39.3.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from hdsafebo.problem import Problem, Safety
from hdsafebo.problems.gaussian_path import GaussianPath
from hdsafebo.trials import Evaluation, Trials
from hdsafebo.typing import FloatArray, IntArray

if TYPE_CHECKING:
    from hdsafebo.params import Params
    from hdsafebo.problem import Codec
    from hdsafebo.problems.registry import Task


class SyntheticProblem(Problem):
    """f(x) and g(x): independent Gaussian process paths over d_e coordinates of W'x.

    W has independent normal entries of variance 1/D, so that it nearly preserves lengths. Initial inputs are
    the least-norm ones whose latent points are uniform in [0, 1]^d: they span d dimensions, which is what
    makes PCA to d an isometry on them. The box of inputs is the smallest that holds all such points.

    Args:
        seed: of projection, effective coordinates and paths.
        dimension: D.
        latent_dimension: d.
        effective_dimension: d_e.
        length_scale: of both processes, in latent units.
        threshold: h.
        noise_variance: of the observations of both.
        with_replacement: draw the effective coordinates with replacement, as the authors' program does;
            fewer coordinates matter then.
    """

    def __init__(
        self,
        seed: int,
        *,
        dimension: int = 1000,
        latent_dimension: int = 50,
        effective_dimension: int = 40,
        length_scale: float = 0.05,
        threshold: float = -0.75,
        noise_variance: float = 1e-4,
        with_replacement: bool = False,
    ) -> None:
        structure, objective, safety = np.random.default_rng(seed).spawn(3)
        self.name = "synthetic"
        self.safety = (Safety("safety", threshold),)
        self.projection = structure.standard_normal((dimension, latent_dimension)) / np.sqrt(dimension)
        self.effective: IntArray = structure.choice(
            latent_dimension, effective_dimension, replace=with_replacement
        )
        self._lift = np.linalg.pinv(self.projection)
        reach = np.stack([np.minimum(self._lift, 0.0).sum(axis=0), np.maximum(self._lift, 0.0).sum(axis=0)])
        self.bounds = reach
        self._objective = GaussianPath(effective_dimension, length_scale, noise_variance, objective)
        self._safety = GaussianPath(effective_dimension, length_scale, noise_variance, safety)

    def initial(self, n: int, rng: np.random.Generator) -> tuple[FloatArray, IntArray]:
        """(n, D) inputs with uniform latent points, and -1 for each: there is no candidate set."""
        return rng.random((n, self._lift.shape[0])) @ self._lift, np.full(n, -1)

    def evaluate(self, trials: Trials) -> Evaluation:
        """Noisy objective and safety; further values depend on those revealed before."""
        effective = (trials.x @ self.projection)[:, self.effective]
        return Evaluation(self._objective(effective), self._safety(effective)[:, None])


def make_task(name: str, params: Params, *, seed: int, root: Path) -> Task:
    """The task `synthetic`, searched in d principal components of the initial inputs (section 5.1).

    It has one setting: the paper's is all that is known of a drawn function.
    """
    from hdsafebo.errors import UnknownNameError
    from hdsafebo.problems.knowledge import TaskKnowledge
    from hdsafebo.problems.registry import Task

    if name != "synthetic":
        raise UnknownNameError("task", name, ["synthetic"])
    settings = params.tasks.synthetic.problem
    problem = SyntheticProblem(seed, **settings.model_dump())
    knowledge = TaskKnowledge(
        latent_space=(
            f"{settings.latent_dimension} principal components of the initial trials, the box of their codes"
        ),
        safety="the safety function as it is",
    )
    return Task(problem, pca_of_initial(settings.latent_dimension), knowledge=knowledge)


def pca_of_initial(latent_dimension: int) -> Callable[[FloatArray], Codec]:
    """A function that fits PCA to given (n, D) inputs."""

    def fit(x: FloatArray) -> Codec:
        from hdsafebo.embeddings.registry import make_embedding

        return make_embedding("pca", latent_dim=latent_dimension).fit(x, rng=np.random.default_rng(0))

    return fit
