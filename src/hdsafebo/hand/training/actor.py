"""The actor network of a trained SAC agent in plain NumPy, stored as safetensors.

A stable-baselines3 archive holds pickled parts; nothing here reads one. What outlives the training is this
actor: two hidden layers, a mean, and state-dependent exploration (gSDE: Raffin et al., CoRL 2021).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError
from safetensors.numpy import load_file, save_file

from hdsafebo.errors import HandModelError

SingleArray = NDArray[np.float32]
MEAN_LIMIT = 2.0
"""stable-baselines3 limits the mean before the tanh to this (`clip_mean`)."""


@dataclass(frozen=True)
class Actor:
    """Weights of an actor; matrices are (outputs, inputs).

    Attributes:
        hidden: weight and bias of each hidden layer.
        mean: weight and bias of the output layer.
        log_std: (hidden, actions) of the exploration matrix.
    """

    hidden: tuple[tuple[SingleArray, SingleArray], ...]
    mean: tuple[SingleArray, SingleArray]
    log_std: SingleArray

    def exploration(self, rng: np.random.Generator) -> SingleArray:
        """(hidden, actions) a matrix that makes the noise a smooth function of the state."""
        return (rng.standard_normal(self.log_std.shape) * np.exp(self.log_std)).astype(np.float32)

    def action(self, observation: SingleArray, exploration: SingleArray | None = None) -> SingleArray:
        """(actions,) in [-1, 1]; the mean action when there is no exploration matrix."""
        features = observation
        for weight, bias in self.hidden:
            features = np.maximum(weight @ features + bias, 0.0)
        weight, bias = self.mean
        raw = np.clip(weight @ features + bias, -MEAN_LIMIT, MEAN_LIMIT)
        return np.asarray(np.tanh(raw if exploration is None else raw + features @ exploration), np.float32)

    def tensors(self) -> dict[str, SingleArray]:
        """The weights by name."""
        named = {"log_std": self.log_std, "mean.weight": self.mean[0], "mean.bias": self.mean[1]}
        for index, (weight, bias) in enumerate(self.hidden):
            named |= {f"hidden{index}.weight": weight, f"hidden{index}.bias": bias}
        return named

    @classmethod
    def from_tensors(cls, named: Mapping[str, SingleArray]) -> Actor:
        """The actor with these weights.

        Raises:
            HandModelError: weights are missing, not finite, or of shapes that do not fit.
        """
        try:
            layers = sum(name.startswith("hidden") and name.endswith(".weight") for name in named)
            hidden = tuple((named[f"hidden{i}.weight"], named[f"hidden{i}.bias"]) for i in range(layers))
            actor = cls(hidden, (named["mean.weight"], named["mean.bias"]), named["log_std"])
        except KeyError as error:
            raise HandModelError(f"actor without {error.args[0]!r}; it has {sorted(named)}") from None
        if not all(np.isfinite(value).all() for value in named.values()):
            raise HandModelError("actor has weights that are not finite")
        width = None
        for weight, bias in (*actor.hidden, actor.mean):
            if (
                weight.ndim != 2
                or bias.shape != weight.shape[:1]
                or (width is not None and weight.shape[1] != width)
            ):
                raise HandModelError(
                    f"actor layers do not fit: weight {weight.shape}, bias {bias.shape}, {width} inputs"
                )
            width = weight.shape[0]
        return actor


def save_actors(path: Path, actors: Mapping[str, Actor], digest: str) -> None:
    """Write named actors of one hand (`full/20000`: observation setting and training steps)."""
    tensors = {
        f"{name}/{key}": np.ascontiguousarray(value)
        for name, actor in actors.items()
        for key, value in actor.tensors().items()
    }
    save_file(tensors, path, metadata={"hand": digest})


def load_actors(path: Path) -> dict[str, Actor]:
    """Read the actors of a file.

    Raises:
        HandModelError: no such file, no safetensors file, or weights that do not fit.
    """
    try:
        tensors = load_file(path)
    except (OSError, SafetensorError) as error:
        raise HandModelError(f"{path}: cannot be read as actors: {error}") from None
    named: dict[str, dict[str, SingleArray]] = {}
    for key, value in tensors.items():
        name, _, tensor = key.rpartition("/")
        named.setdefault(name, {})[tensor] = value
    return {name: Actor.from_tensors(weights) for name, weights in sorted(named.items())}
