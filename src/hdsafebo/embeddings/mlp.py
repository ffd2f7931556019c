"""Trained multilayer perceptrons with SiLU units: plain NumPy, so no process needs torch to decode."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hdsafebo.embeddings.storage import Tensor, TensorSpec
from hdsafebo.typing import FloatArray

CHUNK = 8192  # rows at a time, which bounds the memory of the hidden layers


class Layer(NamedTuple):
    """An affine layer x -> W x + b with W (outputs, inputs) and b (outputs,)."""

    weight: Tensor
    bias: Tensor


Layers = Sequence[Layer]


def forward(layers: Layers, x: FloatArray) -> FloatArray:
    """Outputs (n, m) of inputs (n, k), in double precision; SiLU between the layers, none after the last."""
    wide = [Layer(w.astype(float), b.astype(float)) for w, b in layers]
    blocks = [_forward(wide, x[start : start + CHUNK]) for start in range(0, len(x), CHUNK)]
    return np.concatenate(blocks) if blocks else np.empty((0, len(layers[-1].bias)))


def silu(x: FloatArray) -> FloatArray:
    """x / (1 + exp(-x)) (Elfwing, Uchibe and Doya 2018), without overflow."""
    return 0.5 * x * (1.0 + np.tanh(0.5 * x))


def mlp_specs(prefix: str, sizes: Sequence[int]) -> dict[str, TensorSpec]:
    """Stored tensors of a perceptron with these layer sizes, input first."""
    specs = {}
    for index, (inputs, outputs) in enumerate(pairwise(sizes)):
        specs[f"{prefix}.{index}.weight"] = TensorSpec((outputs, inputs), "float32")
        specs[f"{prefix}.{index}.bias"] = TensorSpec((outputs,), "float32")
    return specs


def mlp_tensors(prefix: str, layers: Layers) -> dict[str, Tensor]:
    """A perceptron as named tensors."""
    return {
        f"{prefix}.{index}.{field}": value
        for index, layer in enumerate(layers)
        for field, value in layer._asdict().items()
    }


def mlp_layers(prefix: str, tensors: Mapping[str, Tensor]) -> list[Layer]:
    """The inverse of `mlp_tensors`."""
    count = sum(key.startswith(f"{prefix}.") for key in tensors) // 2
    return [Layer(tensors[f"{prefix}.{i}.weight"], tensors[f"{prefix}.{i}.bias"]) for i in range(count)]


def _forward(layers: Layers, x: FloatArray) -> NDArray[np.float64]:
    for weight, bias in layers[:-1]:
        x = silu(x @ weight.T + bias)
    return x @ layers[-1].weight.T + layers[-1].bias
