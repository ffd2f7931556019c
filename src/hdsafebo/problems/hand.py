"""The hand task: linear policies that right a bottle and hold it (paper, section 5.2 and appendix).

Objective: the sum of rewards of an episode. Safety functions:

* `landing_speed` (the paper's, reported): minus the speed at which the bottle crosses 0.4 m, or that it has
  at the end of the episode; threshold -4.4 m/s.
* `no_drop`: 1 when the bottle was held to the end, else minus the share of the horizon that was left;
  threshold 0. Held bottles end at about 0 m/s and dropped ones at 4.1 to 4.5 m/s, so the landing speed is
  nearly binary and its threshold lies within the drops, where the speed says nothing about the policy: a
  Gaussian process of it is blind. One of `no_drop` sees the boundary between the modes, and never dropping
  implies a safe landing speed.
* `handling_speed`: minus the largest speed of the bottle while something touches it.
* `upright`: 0.35 rad minus the mean tilt of the last 20 steps; minus pi unless the bottle is held by the hand
  at the end. Nothing unsafe happens below its threshold 0: it is on record to say which policies do the task.

Of these four only those bind an optimiser that are modelled or reported; the others are on record.

The paper's setting (`hand`) models the landing speed. The informed one (`hand_informed`) models `no_drop`,
and its kernel sees what policies do on the main directions of the observations of reference episodes.

No initial policy does the task: a few per cent of uniform draws end upright, and an optimiser that is given
one has nothing to find. Such draws are replaced by further ones, for all methods alike.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from hdsafebo.errors import HandModelError, UnknownNameError
from hdsafebo.hand.policy import LinearPolicySpace
from hdsafebo.hand.reference import behaviour_map, load_moment
from hdsafebo.hand.rollout import UPRIGHT_TILT, Episodes, Scene, evaluate_policies
from hdsafebo.hand.synergies import load_synergies, synergy_policies
from hdsafebo.params import HandProblem, Params
from hdsafebo.problem import Codec, Problem, Safety
from hdsafebo.problems.knowledge import TaskKnowledge
from hdsafebo.problems.registry import Task, is_informed
from hdsafebo.trials import Evaluation, Trials
from hdsafebo.typing import FloatArray, IntArray

SYNERGY_FILE = "models/synergies/pca.safetensors"
MOMENT_FILE = "models/synergies/observations.safetensors"
TASKS = ("hand", "hand_informed")
_MOST_DRAWS = 10
"""Draws of the initial policies, each of as many as the last one left to find."""


@dataclass(frozen=True)
class SynergyCodec:
    """The latent space of policies over synergies: codes W (rows x observations), inputs basis' W.

    Attributes:
        space: the policies over synergies; its basis has orthonormal rows.
    """

    space: LinearPolicySpace

    def decode(self, z: FloatArray) -> FloatArray:
        """(n, D) policies with one row per muscle."""
        return self.space.to_original(z)

    def encode(self, x: FloatArray) -> FloatArray:
        """(n, d) codes; of the part that lies in the span of the synergies."""
        rows = np.asarray(x, float).reshape(len(x), -1, self.space.observations)
        return np.einsum("km,nmo->nko", self.space.basis, rows).reshape(len(x), -1)


class HandPolicies(Problem):
    """Linear policies of the hand, one weight per muscle and observation.

    Args:
        scene: hand and horizon.
        synergies: the policies over synergies that initial trials are drawn from.
        box: limit of the weights over synergies.
        safety: the safety functions, as `safety_functions` gives them.
        features: kernel inputs of policies, or None for the weights themselves.
        name: of the task.
    """

    depends_on_history = False

    def __init__(
        self,
        scene: Scene,
        synergies: LinearPolicySpace,
        box: float,
        safety: tuple[Safety, ...],
        features: Callable[[FloatArray], FloatArray] | None = None,
        name: str = "hand",
    ) -> None:
        self.name = name
        self.scene = scene
        self.codec = SynergyCodec(synergies)
        self.space = LinearPolicySpace.original(synergies.base, synergies.observations)
        self.box = box
        self.safety = safety
        self.features = features
        self._design: tuple[FloatArray, Evaluation] | None = None
        reach = box * np.repeat(np.abs(synergies.basis).sum(axis=0), synergies.observations)
        self.bounds = np.stack([-reach, reach])  # what the box over synergies reaches

    def evaluate(self, trials: Trials) -> Evaluation:
        """One episode per policy; a simulation that diverges is a failed evaluation."""
        if self._design is not None and np.array_equal(self._design[0], trials.x):
            return self._design[1]  # `initial` played them
        return self._evaluation(evaluate_policies(self.scene, self.space, trials.x))

    def initial(self, n: int, rng: np.random.Generator) -> tuple[FloatArray, IntArray]:
        """Policies drawn uniformly from the box over synergies, without those that end upright.

        They are played to know; `evaluate` does not play them again.

        Raises:
            HandModelError: nearly all draws end upright.
        """
        x = np.empty((0, self.bounds.shape[1]))
        played: list[Episodes] = []
        for _ in range(_MOST_DRAWS):
            codes = rng.uniform(-self.box, self.box, (n - len(x), self.codec.space.dimension))
            policies = self.codec.decode(codes)
            episodes = evaluate_policies(self.scene, self.space, policies)
            x = np.concatenate([x, policies[~episodes.upright]])
            played.append(episodes.where(~episodes.upright))
            if len(x) == n:
                self._design = x, self._evaluation(Episodes.joined(played))
                return x, np.full(n, -1)
        raise HandModelError(
            f"after {_MOST_DRAWS} draws only {len(x)} of {n} random policies do not end upright; "
            "expected a box, horizon and roll with which most do not"
        )

    def _evaluation(self, outcome: Episodes) -> Evaluation:
        lost = self.scene.horizon + 1 - outcome.steps  # control steps left at a drop, at least 1
        columns = {
            "landing_speed": -outcome.landing_speed,
            "no_drop": np.where(outcome.dropped, -lost / self.scene.horizon, 1.0),
            "handling_speed": -outcome.handling_speed,
            "upright": np.where(outcome.in_hand, UPRIGHT_TILT - outcome.tilt, -np.pi),
        }
        safety = np.stack([columns[function.name] for function in self.safety], axis=1)
        return Evaluation(outcome.total_reward, safety, outcome.failed)


def safety_functions(
    settings: HandProblem, landing_limit: float, modelled: Sequence[str]
) -> tuple[Safety, ...]:
    """The safety functions of the task; those in `modelled` get a Gaussian process."""
    thresholds = {
        "landing_speed": -landing_limit,
        "no_drop": 0.0,
        "handling_speed": -settings.handling_limit,
        "upright": 0.0,
    }
    return tuple(
        Safety(name, limit, modelled=name in modelled, reported=name in settings.reported)
        for name, limit in thresholds.items()
    )


def make_task(name: str, params: Params, *, seed: int, root: Path) -> Task:
    """The hand task in one of its settings; see `problems.registry`. Nothing in it depends on the seed."""
    if name not in TASKS:
        raise UnknownNameError("hand task", name, TASKS)
    hand, settings = params.hand, params.tasks.hand
    scene = Scene(hand.scene.variant, hand.scene.roll, hand.scene.horizon)
    simulation = scene.simulation()
    synergies = load_synergies(root / SYNERGY_FILE, simulation.hand)
    space = synergy_policies(scene, synergies, hand.synergies.count)
    informed = is_informed(name)
    features, modelled = None, settings.problem.modelled
    if informed:
        moment = load_moment(root / MOMENT_FILE, simulation.hand)
        features, modelled = (
            behaviour_features(moment, settings.informed.directions),
            settings.informed.modelled,
        )
    safety = safety_functions(settings.problem, hand.synergies.landing_limit, modelled)
    problem = HandPolicies(scene, space, hand.synergies.box, safety, features, name)
    codec: Codec = problem.codec
    limits = np.full(space.dimension, hand.synergies.box)
    return Task(
        problem=problem,
        embedding=lambda initial: codec,
        inputs=(SYNERGY_FILE, MOMENT_FILE) if informed else (SYNERGY_FILE,),
        latent_bounds=np.stack([-limits, limits]),
        knowledge=_knowledge(params, modelled, informed=informed),
    )


def _knowledge(params: Params, modelled: Sequence[str], *, informed: bool) -> TaskKnowledge:
    """What the methods are given, in words."""
    synergies, directions = params.hand.synergies, params.tasks.hand.informed.directions
    return TaskKnowledge(
        latent_space=f"weights over {synergies.count} synergies, each at most {synergies.box:g} in size",
        kernel_features=(
            f"muscle drives along the {directions} main directions of reference observations"
            if informed
            else None
        ),
        safety=f"{', '.join(modelled)}, as it is",
        extra_trials=(
            f"{synergies.reference_policies} episodes of random policies, of which the observations are used"
            if informed
            else None
        ),
    )


def behaviour_features(moment: FloatArray, directions: int) -> Callable[[FloatArray], FloatArray]:
    """Kernel inputs of policies: what their muscle drives are along the main directions of observations.

    Args:
        moment: (observations, observations) second moment of reference observations.
        directions: leading directions that are kept.

    Returns:
        A linear map from (n, muscles * observations) policies to (n, muscles * directions).
    """
    matrix = behaviour_map(moment, directions)

    def features(x: FloatArray) -> FloatArray:
        rows = np.asarray(x, float).reshape(len(x), -1, len(matrix))
        return np.asarray(rows @ matrix).reshape(len(x), -1)

    return features
