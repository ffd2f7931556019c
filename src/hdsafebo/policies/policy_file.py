"""Policies as safetensors files: numbers and a card, no code."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save_file

from hdsafebo.errors import PolicyFileError
from hdsafebo.files.atomic import replacing
from hdsafebo.files.bounded import require_regular
from hdsafebo.policies.affine import AffinePolicy, Normalisation, PolicySpace
from hdsafebo.typing import FloatArray

_FORMAT = 1
_MOST_BYTES = 1 << 30
_VECTORS = ("low", "high", "base", "unit")


def save_policy(path: Path, policy: AffinePolicy, environment: str = "") -> None:
    """Write a policy with all that is needed to play it.

    Args:
        path: of the file.
        policy: what is written.
        environment: name of its environment, for people to read.

    Raises:
        WriteError: the file cannot be written.
    """
    space = policy.space
    card = {
        "format": _FORMAT,
        "environment": environment,
        "action_shape": list(space.action_shape),
        "observation_shape": list(space.observation_shape),
        "dtype": space.dtype,
    }
    arrays = {name: getattr(space, name) for name in _VECTORS} | {
        "weights": policy.weights,
        "mean": space.normalisation.mean,
        "scale": space.normalisation.scale,
    }
    with replacing(path) as temporary:
        content = {name: np.ascontiguousarray(value, np.float64) for name, value in arrays.items()}
        save_file(content, temporary, metadata={"card": json.dumps(card)})


def load_policy(path: Path) -> AffinePolicy:
    """Read a policy.

    Raises:
        PolicyFileError: the file is missing or damaged, or its numbers do not fit each other.
    """
    try:
        if path.stat().st_size > _MOST_BYTES:
            raise PolicyFileError(f"{path}: {path.stat().st_size} bytes; expected at most {_MOST_BYTES}")
        require_regular(path)
        with safe_open(path, framework="numpy") as file:
            card = json.loads((file.metadata() or {})["card"])
            names = (*_VECTORS, "weights", "mean", "scale")
            a = {name: np.asarray(file.get_tensor(name), np.float64) for name in names}
        if card["format"] != _FORMAT:
            raise PolicyFileError(f"{path}: policy of format {card['format']!r}; expected {_FORMAT}")
        actions = tuple(int(n) for n in card["action_shape"])
        observations = tuple(int(n) for n in card["observation_shape"])
        dtype = np.dtype(str(card["dtype"]))
    except (OSError, SafetensorError, KeyError, TypeError, ValueError, RecursionError) as error:
        reason = f"{type(error).__name__}: {error}"
        raise PolicyFileError(f"{path}: cannot be read as a policy: {reason}") from None
    k, o = int(np.prod(actions)), int(np.prod(observations))
    shapes = dict.fromkeys(_VECTORS, (k,)) | {"weights": (k, o + 1), "mean": (o,), "scale": (o,)}
    for name, shape in shapes.items():
        if a[name].shape != shape:
            raise PolicyFileError(f"{path}: {name} has shape {a[name].shape}; expected {shape}")
        if not np.isfinite(a[name]).all():
            raise PolicyFileError(f"{path}: {name} has values that are not finite")
    if dtype.kind != "f" or not (a["scale"] > 0).all() or not (a["low"] <= a["high"]).all():
        raise PolicyFileError(f"{path}: expected actions that are floats, scales above 0 and low <= high")
    normalisation = Normalisation(a["mean"], a["scale"])
    space = PolicySpace(
        a["low"], a["high"], a["base"], a["unit"], normalisation, actions, observations, str(dtype)
    )
    return AffinePolicy(space, a["weights"])


def check_same_space(found: PolicySpace, expected: PolicySpace, name: str, path: str | Path) -> None:
    """Refuse a policy whose weights mean something else in the space of another problem.

    Args:
        found: space of the policy in the file.
        expected: the problem's space.
        name: of the problem.
        path: of the file.

    Raises:
        PolicyFileError: the two differ; the message says in what.
    """
    shapes = [(space.action_shape, space.observation_shape) for space in (found, expected)]
    if shapes[0] != shapes[1]:
        raise PolicyFileError(
            f"{path}: policy with actions {shapes[0][0]} and observations {shapes[0][1]}; {name!r} has "
            f"{shapes[1][0]} and {shapes[1][1]}"
        )
    for what in ("base", "unit", "low", "high", "normalisation"):
        a, b = (np.concatenate(_vectors(getattr(space, what))) for space in (found, expected))
        if not np.allclose(a, b, rtol=1e-9, atol=1e-12):
            raise PolicyFileError(
                f"{path}: {what} of the policy is not that of {name!r}; load_policy still plays it, and a "
                "problem made with the same environment, design and seeds takes its weights"
            )


def _vectors(part: FloatArray | Normalisation) -> tuple[FloatArray, ...]:
    return (part.mean, part.scale) if isinstance(part, Normalisation) else (part,)
