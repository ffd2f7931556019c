"""Affine feedback policies: actions from observations, a = clip(base + unit * (W o' + b))."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hdsafebo.errors import ProblemError
from hdsafebo.problem import floats
from hdsafebo.typing import FloatArray

_FARTHEST = 5.0
"""Observations are cut at so many deviations: what no recorded policy has met moves no action further."""


def in_single_precision(x: FloatArray) -> FloatArray:
    """x with every number rounded to single precision; what is too large for it becomes infinite."""
    with np.errstate(over="ignore"):
        return x.astype(np.float32).astype(float)


@dataclass(frozen=True)
class Normalisation:
    """Observations in deviations from recorded ones.

    Attributes:
        mean: (o,) of the recorded observations.
        scale: (o,) their deviations.
    """

    mean: FloatArray
    scale: FloatArray

    @classmethod
    def none(cls, size: int) -> Normalisation:
        """Observations as they are."""
        return cls(np.zeros(size), np.ones(size))

    @classmethod
    def of(cls, observations: FloatArray, least: float) -> Normalisation:
        """From (n, o) recorded observations.

        Args:
            observations: the recorded ones.
            least: smallest deviation of a component, in units of the median one: the noise of a component
                that hardly varies is not to become a signal.
        """
        deviation = observations.std(axis=0)
        median = float(np.median(deviation[deviation > 0])) if (deviation > 0).any() else 1.0
        return cls(observations.mean(axis=0), np.maximum(deviation, least * median))

    def __call__(self, observations: FloatArray) -> FloatArray:
        """(n, o + 1) normalised observations of the (n, o) given ones, and a constant 1."""
        deviations = (observations - self.mean) / self.scale
        ones = np.ones((len(deviations), 1))
        return np.concatenate([np.clip(deviations, -_FARTHEST, _FARTHEST), ones], axis=1)


@dataclass(frozen=True)
class PolicySpace:
    """The affine policies of an environment.

    Attributes:
        low: (k,) least actions.
        high: (k,) largest actions.
        base: (k,) actions of the policy whose weights are all 0.
        unit: (k,) actions per unit of weight.
        normalisation: of the observations.
        action_shape: of the environment's actions, k numbers.
        observation_shape: of the environment's observations, o numbers.
        dtype: of the environment's actions.
    """

    low: FloatArray
    high: FloatArray
    base: FloatArray
    unit: FloatArray
    normalisation: Normalisation
    action_shape: tuple[int, ...]
    observation_shape: tuple[int, ...]
    dtype: str = "float64"

    @property
    def actions(self) -> int:
        """k."""
        return len(self.low)

    @property
    def observations(self) -> int:
        """o."""
        return len(self.normalisation.mean)

    @property
    def dimension(self) -> int:
        """Number of weights of a policy: one row per action, one column per observation and the constant."""
        return self.actions * (self.observations + 1)

    def policy(self, x: ArrayLike) -> AffinePolicy:
        """The policy with the (dimension,) weights x, in single precision: what a file keeps plays the same.

        Raises:
            ProblemError: another shape, or weights that are not finite.
        """
        weights = floats(x, "policy")
        if weights.shape != (self.dimension,):
            raise ProblemError(
                f"policy of shape {weights.shape}; expected ({self.dimension},): {self.actions} actions x "
                f"({self.observations} observations + 1)"
            )
        weights = in_single_precision(weights)
        if not np.isfinite(weights).all():
            raise ProblemError(f"policy has {int((~np.isfinite(weights)).sum())} weights that are not finite")
        return AffinePolicy(self, weights.reshape(self.actions, -1))

    def weights_of(self, gain: FloatArray, bias: FloatArray) -> FloatArray:
        """(dimension,) weights of the policy a = clip(bias + gain o) of observations as they are.

        Args:
            gain: (k, o) action per observation.
            bias: (k,) action at o = 0.
        """
        n = self.normalisation
        constant = bias + gain @ n.mean - self.base
        rows = np.concatenate([gain * n.scale, constant[:, None]], axis=1)
        return np.asarray((rows / self.unit[:, None]).ravel())


@dataclass(frozen=True)
class AffinePolicy:
    """One policy; calling it with an observation gives the action.

    Attributes:
        space: the policies that it is one of.
        weights: (k, o + 1).
    """

    space: PolicySpace
    weights: FloatArray

    @property
    def x(self) -> FloatArray:
        """(dimension,) the weights as an optimiser sees them."""
        return self.weights.ravel()

    def __call__(self, observation: ArrayLike) -> NDArray[Any]:
        """The action at one observation, in the environment's shape and type."""
        return self.predict(observation)[0]

    def predict(
        self,
        observation: ArrayLike,
        state: tuple[NDArray[Any], ...] | None = None,
        episode_start: NDArray[Any] | None = None,
        deterministic: bool = True,
    ) -> tuple[NDArray[Any], tuple[NDArray[Any], ...] | None]:
        """As the method of the same name of stable-baselines3's models, for `evaluate_policy` and the like.

        Args:
            observation: of the environment's shape, or n of them.
            state: returned as it is; these policies have none.
            episode_start: ignored.
            deterministic: ignored; these policies always are.

        Returns:
            The action, or n of them, and `state`.

        Raises:
            ProblemError: an observation of another shape.
        """
        given, shape = floats(observation, "observation"), self.space.observation_shape
        single = given.shape == shape
        if not single and given.shape[1:] != shape:
            raise ProblemError(f"observation of shape {given.shape}; expected {shape} or (n, *{shape})")
        seen = self.space.normalisation(given.reshape(-1, self.space.observations))
        actions = self._actions(seen).astype(self.space.dtype).reshape(-1, *self.space.action_shape)
        return (actions[0] if single else actions), state

    def as_function(self) -> Callable[[ArrayLike], NDArray[Any]]:
        """A function of an observation that needs numpy alone, for a controller without this package."""
        space, weights = self.space, self.weights.copy()
        mean, scale = space.normalisation.mean.copy(), space.normalisation.scale.copy()
        base, unit, low, high = (v.copy() for v in (space.base, space.unit, space.low, space.high))
        shape, dtype = space.action_shape, space.dtype

        def act(observation: ArrayLike) -> NDArray[Any]:
            seen = np.clip((np.ravel(observation) - mean) / scale, -_FARTHEST, _FARTHEST)
            action = base + unit * (weights[:, :-1] @ seen + weights[:, -1])
            return np.clip(action, low, high).astype(dtype).reshape(shape)

        return act

    def _actions(self, seen: FloatArray) -> FloatArray:
        """(n, k) actions at (n, o + 1) normalised observations.

        Row by row, so that one observation gives the same bits alone and among others.
        """
        space = self.space
        drives = np.stack([self.weights @ row for row in seen])
        return np.clip(space.base + space.unit * drives, space.low, space.high)
