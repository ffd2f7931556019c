"""Policies of a Gymnasium environment as a problem: return to maximise, safety of episodes to keep.

from hdsafebo import GymnasiumPolicies, HdSafeBOLocal, lasts

problem = GymnasiumPolicies("Hopper-v5", [lasts(75)], horizon=300, seeds=(1, 2))
optimizer = HdSafeBOLocal(problem, seed=0)
initial = problem.initial_trials(30, seed=0)
optimizer.observe(initial.x, initial.objective, initial.safety, status=initial.status, initial=True)
for _ in range(20):
    trials = optimizer.ask(10)
    results = problem.evaluate(trials)
    optimizer.tell(trials, results.objective, results.safety, status=results.status())
problem.save_policy(optimizer.best().x, "hopper.safetensors")
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from hdsafebo.errors import ProblemError
from hdsafebo.policies.affine import AffinePolicy, Normalisation, in_single_precision
from hdsafebo.policies.designs import Design, gaussian_design
from hdsafebo.policies.environments import (
    EnvironmentMaker,
    Factory,
    check_spaces,
    horizon_of,
)
from hdsafebo.policies.episode import Episode
from hdsafebo.policies.evaluation import play_all
from hdsafebo.policies.features import behaviour_features
from hdsafebo.policies.making import (
    checked_effects,
    checked_seeds,
    main_directions,
    on_a_grid,
    raw_space,
    weight_limits,
)
from hdsafebo.policies.moves import main_moves, move_features
from hdsafebo.policies.policy_file import check_same_space, load_policy, save_policy
from hdsafebo.policies.recording import check_seeds, checked_observations, recorded_observations
from hdsafebo.policies.safety import EpisodeSafety
from hdsafebo.policies.synergies import ActionSynergies
from hdsafebo.problem import LinearFeatures, Problem, check_problem, floats
from hdsafebo.trials import Evaluation, Trials
from hdsafebo.typing import FloatArray, IntArray

if TYPE_CHECKING:
    from hdsafebo.policies.video import Film

_LEAST_SCALE = 0.05
"""Least scale of an observation, in its own units: what never moved must not be magnified without end."""
_MANY_WEIGHTS = 10_000
"""Beyond, weights have a resolution of about a thousandth of their range: no single one matters more."""
_DRAWS = 100
"""Initial policies that limits of weights and main directions of actions are taken from."""


class GymnasiumPolicies(Problem):
    """Affine policies of an environment, one weight per action and observation; see `PolicySpace`.

    When it is made, some initial policies are played. Their observations give the normalisation of
    observations and the behaviour features that the kernel sees; both depend on `recording_seed` alone.

    Args:
        environment: id of a registered environment, or a function that makes one (called with `arguments`,
            and with `render_mode` for a video).
        safety: safety functions of episodes; of several seeds, the least value counts.
        seeds: of the evaluation episodes; the objective is the mean return over them.
        horizon: most steps of an episode; None takes the environment's own limit.
        arguments: keyword arguments of the environment.
        base: (k,) action of the policy whose weights are all 0; None takes the middle of the limits.
        unit: action per unit of weight, a number or (k,); None takes half the range.
        design: draws initial policies; None draws Gaussian ones of all sizes.
        box: limit of the weights, a number or (D,); "design" takes 1.5 times the largest of 100 initial
            policies, weight by weight, and at least 0.03.
        directions: main directions of observations that behaviour features keep; None keeps those with 95 %
            of the recorded observations' second moment, at most 12. What they leave out, `hdsafebo_local`
            searches as an evolution strategy does.
        moves: number of main ways in which 100 initial policies differ, which the kernel sees in place of
            those features; for a design that has few, as reflexes with random gains. `hdsafebo_local` leaves
            all else as it is.
        effects: (q, k) what a unit of each action does, such as joint torques, by which `moves` measures how
            much policies differ; None takes the actions themselves.
        recorded: number of initial policies that are played to record observations; or (n, o) observations
            that were recorded before, which are not checked again.
        recording_seed: of their draw.
        name: in files and messages; None takes the environment's.
        executor: spreads episodes over its workers; None plays them here. Results do not depend on it.

    Attributes:
        policies: the space of policies.
        horizon: most steps of an episode.
        observations: (n, o) recorded ones.
        recorded: (n, o + 1) the same, normalised, with their constant.

    Raises:
        ProblemError: the environment cannot be made or searched; the message says what is wrong.
    """

    depends_on_history = False
    features: LinearFeatures

    def __init__(
        self,
        environment: str | Factory,
        safety: Sequence[EpisodeSafety],
        *,
        seeds: Sequence[int] = (0,),
        horizon: int | None = None,
        arguments: Mapping[str, Any] | None = None,
        base: ArrayLike | None = None,
        unit: ArrayLike | None = None,
        design: Design | None = None,
        box: ArrayLike | Literal["design"] = 1.0,
        directions: int | None = None,
        moves: int | None = None,
        effects: ArrayLike | None = None,
        recorded: int | FloatArray = 10,
        recording_seed: int = 0,
        name: str | None = None,
        executor: Executor | None = None,
    ) -> None:
        self._maker = EnvironmentMaker(environment, dict(arguments or {}))
        self.name = self._maker.name if name is None else name
        self.seeds = checked_seeds(seeds)
        self._safety = tuple(safety)
        self.safety = tuple(function.safety for function in self._safety)
        self.executor = executor
        self._design = gaussian_design() if design is None else design
        made = self._maker.make()
        try:
            check_spaces(made, self.name)
            self.horizon = horizon_of(made, self.name, horizon)
            self.policies = raw_space(made, base, unit)
        finally:
            made.close()
        if isinstance(recorded, int):
            if recorded < 1:
                raise ProblemError(f"recorded is {recorded}; expected at least 1 policy")
            played = self._drawn(recorded, np.random.default_rng(recording_seed))
            self.observations = self._record(played)
        else:
            self.observations = checked_observations(recorded, self.policies.observations, self.name)
        normalisation = Normalisation.of(self.observations, _LEAST_SCALE)
        self.policies = replace(self.policies, normalisation=normalisation)
        self.recorded = normalisation(self.observations)
        drawn = self._drawn(_DRAWS, np.random.default_rng([recording_seed, 1]))
        along = None
        if moves is not None:
            done = checked_effects(effects, self.policies)
            along = main_moves(drawn, done, self.recorded, moves)
        self.bounds = in_single_precision(weight_limits(box, drawn, along))
        if self.policies.dimension > _MANY_WEIGHTS:
            self.bounds, self.resolution = on_a_grid(self.bounds)
        if along is None:
            kept = main_directions(self.recorded) if directions is None else directions
            self.features = behaviour_features(self.recorded, kept, self.policies.actions)
        else:
            self.features = move_features(along, self.bounds[1] - self.bounds[0])
        check_problem(self)

    # --- what an optimiser asks

    def evaluate(self, trials: Trials) -> Evaluation:
        """Play every policy once per seed; a trial with an episode that gave no result is a failed one."""
        if len(trials) == 0:
            return Evaluation(np.empty(0), np.empty((0, len(self.safety))))
        return self.evaluation(self._play(trials.x, self.seeds))

    def initial(self, n: int, rng: np.random.Generator) -> tuple[FloatArray, IntArray]:
        """n policies of the design, cut to the box."""
        x = in_single_precision(np.clip(self._drawn(n, rng), *self.bounds))
        if self.resolution is not None:
            x = np.rint(x / self.resolution) * self.resolution
        return x, np.full(n, -1)

    # --- policies

    def policy(self, x: ArrayLike) -> AffinePolicy:
        """The policy of (D,) weights: call it with an observation, or use its `predict`.

        Raises:
            ProblemError: weights of another shape, or not finite.
        """
        return self.policies.policy(x)

    def play(self, x: ArrayLike, seeds: Sequence[int] | None = None) -> list[Episode]:
        """Episodes of one policy, one per seed; None plays the evaluation seeds."""
        chosen = self.seeds if seeds is None else checked_seeds(seeds)
        return self._play(np.atleast_2d(floats(x, "policies")), chosen)[0]

    def video(self, x: ArrayLike, path: str | Path, seed: int | None = None) -> Episode:
        """Write one episode of a policy as MP4, in real time; None takes the first evaluation seed.

        Raises:
            RenderingUnavailableError: the environment or this machine cannot draw.
        """
        from hdsafebo.policies.video import record_episode

        chosen = self.seeds[0] if seed is None else seed
        return record_episode(self._maker, self.policy(x), chosen, self.horizon, Path(path))

    def film(self, x: ArrayLike, seed: int, fps: float) -> Film:
        """One episode of a policy with its pictures, at most `fps` a second.

        Raises:
            RenderingUnavailableError: the environment or this machine cannot draw.
        """
        from hdsafebo.policies.video import film_episode

        return film_episode(self._maker, self.policy(x), seed, self.horizon, fps)

    def save_policy(self, x: ArrayLike, path: str | Path) -> None:
        """Write a policy with all that is needed to play it, as safetensors.

        Raises:
            WriteError: the file cannot be written.
        """
        save_policy(Path(path), self.policy(x), self._maker.name)

    def load_policy(self, path: str | Path) -> FloatArray:
        """(D,) weights of a policy that was saved by a problem like this one.

        Raises:
            PolicyFileError: the file is missing, damaged, or of a policy of another problem.
        """
        policy = load_policy(Path(path))
        check_same_space(policy.space, self.policies, self.name, path)
        return policy.x

    def synergies(self, directions: ArrayLike, centre: ArrayLike | None = None) -> ActionSynergies:
        """An embedding over (rows, k) directions of action; `centre` (D,) is the code 0, None all zeros.

        Raises:
            ProblemError: the directions are linearly dependent or do not fit.
        """
        rows = np.atleast_2d(floats(directions, "directions"))
        k, d = self.policies.actions, self.policies.dimension
        if rows.shape[1] != k:
            raise ProblemError(
                f"synergies of shape {rows.shape}; expected (rows, {k}), one column per action"
            )
        middle = np.zeros(d) if centre is None else floats(centre, "centre")
        if middle.shape != (d,):
            raise ProblemError(f"centre of shape {middle.shape}; expected ({d},)")
        return ActionSynergies.of_directions(rows / self.policies.unit, middle)

    def initial_trials(self, n: int, seed: int) -> Trials:
        """n initial policies with their results, for `Optimizer.observe`."""
        x, _ = self.initial(n, np.random.default_rng(seed))
        trials = Trials.pending(x, x, len(self.safety), initial=np.ones(n, bool))
        return trials.with_results(self.evaluate(trials))

    def evaluation(self, episodes: Sequence[Sequence[Episode]]) -> Evaluation:
        """Results of n policies from the episodes of each.

        Raises:
            ProblemError: a safety function gives no number.
        """
        reasons = [next((e.failure for e in played if e.failure), None) for played in episodes]
        failed = np.array([reason is not None for reason in reasons])
        objective = np.zeros(len(episodes))
        safety = np.zeros((len(episodes), len(self.safety)))
        for i, played in enumerate(episodes):
            if failed[i]:
                continue
            objective[i] = np.mean([e.total_reward for e in played])
            for j, function in enumerate(self._safety):
                safety[i, j] = min(function.of(e) for e in played)
        return Evaluation(objective, safety, failed, tuple(reasons))

    def _play(self, x: FloatArray, seeds: Sequence[int]) -> list[list[Episode]]:
        policies = [self.policies.policy(row) for row in x]
        return play_all(self._maker, policies, seeds, self.horizon, self.executor)

    def _drawn(self, n: int, rng: np.random.Generator) -> FloatArray:
        """(n, D) policies of the design."""
        x = np.asarray(self._design(self.policies, n, rng), float)
        if x.shape != (n, self.policies.dimension) or not np.isfinite(x).all():
            raise ProblemError(
                f"the initial design of {self.name!r} gave policies of shape {x.shape}; "
                f"expected ({n}, {self.policies.dimension}) finite weights"
            )
        return x

    def _record(self, x: FloatArray) -> FloatArray:
        """(n, o) what initial policies x see, played with all seeds."""
        episodes = self._play(x, self.seeds)
        observations = recorded_observations(episodes, self.name)
        check_seeds(episodes, self._play(x[:1], self.seeds[:1])[0][0], self.seeds, self.name)
        self.evaluation(episodes)  # safety functions that give no number say so now
        return observations
