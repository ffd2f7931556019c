"""Evaluates batches of linear policies, each in one episode.

Every evaluation runs through `BottleSimulation`, one physics step after the other, and depends on the
policy alone, so results are the same to the bit for any batch, order, executor and number of workers.
"""

from __future__ import annotations

import threading
from collections.abc import Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, fields
from itertools import chain, compress
from typing import cast

import numpy as np
from numpy.typing import NDArray

from hdsafebo.hand.policy import LinearPolicySpace
from hdsafebo.hand.scene.model import Variant, hand_model
from hdsafebo.hand.simulation import HORIZON, BottleSimulation, Step
from hdsafebo.typing import FloatArray

FINAL_STEPS = 20  # of 120, over which the end of an episode is averaged
UPRIGHT_TILT = 0.35  # rad; the first tilt that the reward has a bonus for

_local = threading.local()


@dataclass(frozen=True)
class Scene:
    """What an evaluation needs besides the policy; small, so that it travels to workers.

    Attributes:
        variant: which hand.
        roll: of the arm, rad.
        horizon: control steps per episode.
    """

    variant: str = "extended"
    roll: float = 1.4
    horizon: int = HORIZON

    def simulation(self) -> BottleSimulation:
        """The simulation of this scene, made once per thread."""
        made: dict[Scene, BottleSimulation] = _local.__dict__.setdefault("simulations", {})
        if self not in made:
            made[self] = BottleSimulation(hand_model(cast(Variant, self.variant), self.roll), self.horizon)
        return made[self]


@dataclass(frozen=True)
class Episodes:
    """Outcomes of n episodes.

    Attributes:
        total_reward: (n,) sum of rewards; NaN where the simulation failed.
        landing_speed: (n,) speed of the bottle when it crossed 0.4 m, or at the end of the episode, m/s.
        handling_speed: (n,) largest speed of the bottle while something touched it, m/s.
        dropped: (n,) the bottle fell below 0.4 m.
        tilt: (n,) mean tilt over the last 20 steps, rad.
        overlapping: (n,) share of the last 20 steps in which the bottle was in the place of the forearm.
        steps: (n,) control steps.
        failures: (n,) why a simulation failed, or None.
    """

    total_reward: FloatArray
    landing_speed: FloatArray
    handling_speed: FloatArray
    dropped: NDArray[np.bool_]
    tilt: FloatArray
    overlapping: FloatArray
    steps: NDArray[np.int64]
    failures: tuple[str | None, ...]

    @property
    def failed(self) -> NDArray[np.bool_]:
        """(n,) True where the simulation failed."""
        return np.array([reason is not None for reason in self.failures], bool)

    @property
    def in_hand(self) -> NDArray[np.bool_]:
        """(n,) True where the bottle ended held by the hand, not wedged against the forearm."""
        return ~self.dropped & (self.overlapping == 0) & ~self.failed

    @property
    def upright(self) -> NDArray[np.bool_]:
        """(n,) True where the bottle ended upright (tilt at most 0.35 rad) and held by the hand."""
        return (self.tilt <= UPRIGHT_TILT) & self.in_hand

    def where(self, chosen: NDArray[np.bool_]) -> Episodes:
        """The episodes where the (n,) mask is True."""
        columns = {f.name: getattr(self, f.name)[chosen] for f in fields(self) if f.name != "failures"}
        return Episodes(**columns, failures=tuple(compress(self.failures, chosen)))

    @classmethod
    def joined(cls, parts: Sequence[Episodes]) -> Episodes:
        """All episodes of the parts, at least one, in their order."""
        names = [f.name for f in fields(cls) if f.name != "failures"]
        columns = {name: np.concatenate([getattr(part, name) for part in parts]) for name in names}
        return cls(**columns, failures=tuple(chain.from_iterable(part.failures for part in parts)))


def evaluate_policies(
    scene: Scene, space: LinearPolicySpace, parameters: FloatArray, executor: Executor | None = None
) -> Episodes:
    """Run one episode per policy.

    Args:
        scene: hand and horizon.
        space: how parameters become policies.
        parameters: (n, space.dimension).
        executor: spreads the policies over its workers; None evaluates them here, one by one.

    Raises:
        HandModelError: policies of the wrong shape, or not finite.
    """
    jobs = [(scene, space, weights) for weights in space.weights(parameters)]
    rows = list(map(_outcome, jobs) if executor is None else executor.map(_outcome, jobs))
    return _collect(rows)


def policy_excitations(scene: Scene, space: LinearPolicySpace, parameters: FloatArray) -> FloatArray:
    """(steps, muscles) excitations of one policy, (dimension,), in its episode: what pictures replay."""
    weights = space.weights(np.atleast_2d(parameters))[0]
    simulation = scene.simulation()
    return np.array([excitation for _, excitation, _ in episode(simulation, space, weights)])


def episode(
    simulation: BottleSimulation, space: LinearPolicySpace, weights: FloatArray
) -> Iterator[tuple[FloatArray, FloatArray, Step]]:
    """Run one episode of a policy, step by step.

    Args:
        simulation: is reset first.
        space: how weights become excitations.
        weights: (rows, observations).

    Yields:
        Observation, excitation and what came of it.
    """
    observation = simulation.reset()
    while True:
        excitation = space.excitation(weights, observation)
        step = simulation.step(excitation)
        yield observation, excitation, step
        if step.ended:
            return
        observation = step.observation


def _collect(rows: Sequence[tuple[float, float, float, bool, float, float, int, str | None]]) -> Episodes:
    """The table of single episodes."""
    if not rows:
        empty = np.empty(0)
        return Episodes(empty, empty, empty, np.empty(0, bool), empty, empty, np.empty(0, np.int64), ())
    total, landing, handling, dropped, tilts, overlapping, steps, failures = zip(*rows, strict=True)
    return Episodes(
        np.array(total),
        np.array(landing),
        np.array(handling),
        np.array(dropped, bool),
        np.array(tilts),
        np.array(overlapping),
        np.array(steps, np.int64),
        tuple(failures),
    )


def _outcome(
    job: tuple[Scene, LinearPolicySpace, FloatArray],
) -> tuple[float, float, float, bool, float, float, int, str | None]:
    """Outcome of one policy: the columns of `Episodes`."""
    scene, space, weights = job
    simulation = scene.simulation()
    steps = [step for _, _, step in episode(simulation, space, weights)]
    last = steps[-1]
    if last.failure is not None:
        return np.nan, np.nan, np.nan, False, np.nan, np.nan, simulation.steps, last.failure
    return (
        sum(step.reward.total for step in steps),
        simulation.bottle_speed,
        simulation.peak_contact_speed,
        last.dropped,
        float(np.mean([step.tilt for step in steps[-FINAL_STEPS:]])),
        float(np.mean([step.in_forearm for step in steps[-FINAL_STEPS:]])),
        simulation.steps,
        None,
    )
