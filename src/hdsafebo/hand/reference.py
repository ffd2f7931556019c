"""What random policies do: the observations they meet, and how hard the task is for them.

Distances between weights of policies say nothing about behaviour; distances between what the weights do at
observations that policies meet say much. With the second moment S of those observations, two policies W
and W' differ by tr((W - W') S (W - W')'): the mean square difference of their synergy drives.
"""

from __future__ import annotations

from concurrent.futures import Executor
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save_file

from hdsafebo.errors import HandModelError
from hdsafebo.files.atomic import write_json
from hdsafebo.files.bounded import require_regular
from hdsafebo.hand.policy import LinearPolicySpace
from hdsafebo.hand.rollout import Episodes, Scene, episode
from hdsafebo.hand.scene.model import HandModel
from hdsafebo.typing import FloatArray

TRIVIAL_SHARE = 0.05


@dataclass(frozen=True)
class Difficulty:
    """Shares of n random policies, and what the zero policy does.

    Attributes:
        policies: n.
        dropped: share that dropped the bottle.
        upright: share that ended with the bottle upright.
        safe: share with a landing speed of at most `landing_limit`.
        landing_limit: m/s.
        return_quantiles: of the total reward, at 0, 5, 50, 95 and 100 %.
        zero_policy_tilt: mean tilt of the last 20 steps, rad.
        zero_policy_upright: the zero policy already solves the task.
        failed: simulations that diverged.
    """

    policies: int
    dropped: float
    upright: float
    safe: float
    landing_limit: float
    return_quantiles: tuple[float, ...]
    zero_policy_tilt: float
    zero_policy_upright: bool
    failed: int

    @classmethod
    def of(cls, episodes: Episodes, zero: Episodes, landing_limit: float) -> Difficulty:
        """Summary of random policies and of the zero policy."""
        good = ~episodes.failed
        return cls(
            policies=len(good),
            dropped=float(episodes.dropped[good].mean()),
            upright=float(episodes.upright[good].mean()),
            safe=float((episodes.landing_speed[good] <= landing_limit).mean()),
            landing_limit=landing_limit,
            return_quantiles=tuple(
                np.quantile(episodes.total_reward[good], [0, 0.05, 0.5, 0.95, 1]).tolist()
            ),
            zero_policy_tilt=float(zero.tilt[0]),
            zero_policy_upright=bool(zero.upright[0]),
            failed=int(episodes.failed.sum()),
        )

    @property
    def trivial(self) -> bool:
        """Random search or no control at all would do: at least 5 % end upright, or the zero policy does."""
        return self.upright >= TRIVIAL_SHARE or self.zero_policy_upright

    def write(self, path: Path) -> None:
        """Write as JSON."""
        write_json(path, asdict(self))


def observation_moment(
    scene: Scene, space: LinearPolicySpace, parameters: FloatArray, executor: Executor | None = None
) -> FloatArray:
    """(observations, observations) mean of o o' over all control steps of the policies' episodes.

    Args:
        scene: hand and horizon.
        space: how parameters become policies.
        parameters: (n, space.dimension).
        executor: spreads the policies over its workers; the result does not depend on it.
    """
    jobs = [(scene, space, weights) for weights in space.weights(parameters)]
    moments = list(map(_moment, jobs) if executor is None else executor.map(_moment, jobs))
    return np.asarray(sum(total for total, _ in moments) / sum(steps for _, steps in moments))


def _moment(job: tuple[Scene, LinearPolicySpace, FloatArray]) -> tuple[FloatArray, int]:
    """Sum of o o' over an episode, and its number of control steps."""
    scene, space, weights = job
    seen = np.array([observation for observation, _, _ in episode(scene.simulation(), space, weights)])
    return seen.T @ seen, len(seen)


def behaviour_map(moment: FloatArray, directions: int) -> FloatArray:
    """(observations, directions) matrix B with B B' close to S: W B are the features of a policy.

    Args:
        moment: S.
        directions: leading eigenvectors that are kept.

    Raises:
        HandModelError: S is no second moment, or has fewer directions.
    """
    square = moment.ndim == 2 and moment.shape[0] == moment.shape[1]
    if not square or not np.allclose(moment, moment.T) or not 1 <= directions <= len(moment):
        raise HandModelError(f"second moment of shape {moment.shape} for {directions} directions")
    values, vectors = np.linalg.eigh(moment)
    leading = np.argsort(values)[::-1][:directions]
    signs = np.sign(vectors[np.abs(vectors[:, leading]).argmax(0), leading])
    return np.asarray(vectors[:, leading] * signs * np.sqrt(np.maximum(values[leading], 0.0)))


def save_moment(path: Path, moment: FloatArray, hand: HandModel) -> None:
    """Write the second moment of the observations of a hand."""
    save_file({"moment": np.ascontiguousarray(moment)}, path, metadata={"hand": hand.digest})


def load_moment(path: Path, hand: HandModel) -> FloatArray:
    """Read the second moment of the observations of a hand.

    Raises:
        HandModelError: the file is missing or damaged, or belongs to another hand.
    """
    try:
        require_regular(path)
        with safe_open(path, framework="numpy") as file:
            digest = (file.metadata() or {})["hand"]
            moment = np.asarray(file.get_tensor("moment"), float)
    except (OSError, SafetensorError, KeyError) as error:
        raise HandModelError(f"{path}: no second moment of observations: {error}") from None
    if digest != hand.digest:
        raise HandModelError(f"{path}: belongs to model {digest[:12]}; expected {hand.digest[:12]}")
    if moment.ndim != 2 or moment.shape[0] != moment.shape[1] or not np.isfinite(moment).all():
        raise HandModelError(f"{path}: expected a finite square matrix, got shape {moment.shape}")
    return moment
