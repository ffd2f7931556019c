"""Muscle synergies: principal components of activation data (paper, section 5.2)."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save_file

from hdsafebo.errors import DatasetError, HandModelError
from hdsafebo.files.atomic import write_json
from hdsafebo.files.bounded import require_regular
from hdsafebo.hand.policy import LinearPolicySpace
from hdsafebo.hand.rollout import Scene
from hdsafebo.hand.scene.model import HandModel
from hdsafebo.typing import FloatArray

INDEX_COLUMNS = ("episode", "step")


@dataclass(frozen=True)
class Synergies:
    """Components of activation data.

    Attributes:
        mean: (muscles,) mean activation.
        components: (10, muscles) orthonormal rows, by falling variance.
        explained: (10,) share of the variance that the first k components account for.
        muscles: names, in order.
        variant: of the hand.
        digest: of the hand's model.
    """

    mean: FloatArray
    components: FloatArray
    explained: FloatArray
    muscles: tuple[str, ...]
    variant: str
    digest: str

    def first(self, count: int) -> FloatArray:
        """(count, muscles) the leading components.

        Raises:
            HandModelError: there are not so many.
        """
        if not 1 <= count <= len(self.components):
            raise HandModelError(f"{count} synergies asked for; the file has {len(self.components)}")
        return self.components[:count]


def fit_synergies(activations: pd.DataFrame, hand: HandModel, components: int = 10) -> Synergies:
    """Principal components of a table of activations.

    The rule that fixes the basis: components by falling variance, each with the sign that makes its
    loading of largest size positive.

    Args:
        activations: `episode`, `step` and one column per muscle, in the hand's order.
        hand: the hand that the table belongs to.
        components: how many.

    Raises:
        DatasetError: other columns than the hand's muscles, too few rows, or values outside [0, 1].
    """
    from sklearn.decomposition import PCA

    expected = [*INDEX_COLUMNS, *hand.muscles]
    if list(activations.columns) != expected:
        unknown = sorted(set(activations.columns) - set(expected))
        missing = sorted(set(expected) - set(activations.columns))
        raise DatasetError(
            f"activations are not those of the hand {hand.variant!r}: "
            f"unknown columns {unknown}, missing {missing}"
        )
    values = activations[list(hand.muscles)].to_numpy(np.float64)
    if len(values) <= len(hand.muscles):
        raise DatasetError(
            f"{len(values)} rows of activations; expected more than the {len(hand.muscles)} muscles"
        )
    if not (np.isfinite(values).all() and values.min() >= 0 and values.max() <= 1):
        raise DatasetError("activations have values that are not in [0, 1]")
    pca = PCA(components, svd_solver="covariance_eigh").fit(values)
    rows = pca.components_
    largest = rows[np.arange(components), np.abs(rows).argmax(axis=1)]
    return Synergies(
        mean=pca.mean_,
        components=rows * np.sign(largest)[:, None],
        explained=np.cumsum(pca.explained_variance_ratio_),
        muscles=hand.muscles,
        variant=hand.variant,
        digest=hand.digest,
    )


def synergy_policies(scene: Scene, synergies: Synergies, count: int) -> LinearPolicySpace:
    """The policies over the leading synergies.

    The zero policy keeps the activations of the start pose: it holds the bottle loosely and does not
    turn it. With the mean of the training episodes in its place it would already bring the bottle
    half way up.

    Args:
        scene: hand and horizon.
        synergies: of that hand.
        count: leading components.
    """
    simulation = scene.simulation()
    return LinearPolicySpace(simulation.pose.activation, synergies.first(count), simulation.observer.size)


def save_synergies(path: Path, synergies: Synergies) -> None:
    """Write a safetensors file, and beside it a JSON card with the names and shares for people to read."""
    card = {"variant": synergies.variant, "hand": synergies.digest, "muscles": list(synergies.muscles)}
    arrays = {
        name: np.ascontiguousarray(getattr(synergies, name)) for name in ("mean", "components", "explained")
    }
    save_file(arrays, path, metadata={"card": json.dumps(card)})
    shares = {"variance_accounted_for": [round(float(v), 6) for v in synergies.explained]}
    write_json(path.with_suffix(".json"), card | shares)


def load_synergies(path: Path, hand: HandModel) -> Synergies:
    """Read the synergies of a hand.

    Raises:
        HandModelError: the file is missing or damaged, or belongs to another hand.
    """
    try:
        require_regular(path)
        with safe_open(path, framework="numpy") as file:
            card = json.loads((file.metadata() or {})["card"])
            mean, components, explained = (
                np.asarray(file.get_tensor(name), float) for name in ("mean", "components", "explained")
            )
            muscles, variant, digest = tuple(card["muscles"]), str(card["variant"]), str(card["hand"])
    except (OSError, SafetensorError, KeyError, TypeError, ValueError) as error:
        raise HandModelError(
            f"{path}: cannot be read as synergies: {type(error).__name__}: {error}"
        ) from None
    if muscles != hand.muscles or digest != hand.digest:
        raise HandModelError(
            f"{path}: synergies of another hand: {variant!r}, {len(muscles)} muscles, model {digest[:12]}; "
            f"expected {hand.variant!r}, {len(hand.muscles)} muscles, model {hand.digest[:12]}"
        )
    n = len(components)
    if mean.shape != (len(muscles),) or components.shape != (n, len(muscles)) or explained.shape != (n,):
        raise HandModelError(
            f"{path}: shapes {mean.shape}, {components.shape}, {explained.shape} "
            f"do not fit {len(muscles)} muscles"
        )
    if not all(np.isfinite(a).all() for a in (mean, components, explained)):
        raise HandModelError(f"{path}: values that are not finite")
    return Synergies(mean, components, explained, muscles, variant, digest)
