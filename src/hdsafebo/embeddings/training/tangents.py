"""A trainable perceptron whose pullback metric costs one pass forward and one back.

With J the Jacobian of a decoder f at z, the isometry term needs J v and J'J v for random directions v.
Generic automatic differentiation runs the network anew for each and records more than is needed. For a
perceptron both are a few lines: the tangent t goes forward with the activations, the cotangent c back,

    a = W h + b,   h' = s(a),   t' = s'(a) * (W t),      c = W' (s'(a) * c'),

and s'(a) is shared. Autograd then differentiates this plain graph with respect to the weights.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import torch
from torch import Tensor

from hdsafebo.embeddings.mlp import Layer


class Pullback(NamedTuple):
    """f(z) (n, D), J v (n, D) and J'J v (n, d) of n points."""

    value: Tensor
    tangent: Tensor
    cotangent: Tensor


class TrainableMlp:
    """A perceptron with SiLU units whose layers autograd can train.

    Args:
        sizes: layer sizes, input first.
        generator: source of the initial weights, drawn as torch's own linear layers draw them:
            uniform within +-1/sqrt(inputs).
    """

    def __init__(self, sizes: Sequence[int], generator: torch.Generator) -> None:
        self.weights: list[Tensor] = []
        self.biases: list[Tensor] = []
        for inputs, outputs in pairwise(sizes):
            bound = inputs**-0.5
            for kept, shape in ((self.weights, (outputs, inputs)), (self.biases, (outputs,))):
                drawn = torch.empty(shape).uniform_(-bound, bound, generator=generator)
                kept.append(drawn.requires_grad_())

    @property
    def parameters(self) -> list[Tensor]:
        """All weights and biases."""
        return [*self.weights, *self.biases]

    def __call__(self, x: Tensor) -> Tensor:
        """Outputs (n, m) of inputs (n, k)."""
        for weight, bias in zip(self.weights[:-1], self.biases[:-1], strict=True):
            x = torch.nn.functional.silu(torch.addmm(bias, x, weight.T))
        return torch.addmm(self.biases[-1], x, self.weights[-1].T)

    def pullback(self, z: Tensor, v: Tensor) -> Pullback:
        """Values at z (n, d), with J v and J'J v for directions v (n, d)."""
        slopes: list[Tensor] = []
        h, t = z, v
        for weight, bias in zip(self.weights[:-1], self.biases[:-1], strict=True):
            a = torch.addmm(bias, h, weight.T)
            gate = torch.sigmoid(a)
            h = a * gate
            slopes.append(gate + h * (1.0 - gate))  # the derivative of a * sigmoid(a)
            t = slopes[-1] * (t @ weight.T)
        value, tangent = torch.addmm(self.biases[-1], h, self.weights[-1].T), t @ self.weights[-1].T
        c = tangent @ self.weights[-1]
        for weight, slope in zip(reversed(self.weights[:-1]), reversed(slopes), strict=True):
            c = (slope * c) @ weight
        return Pullback(value, tangent, c)

    def layers(self) -> list[Layer]:
        """The trained layers as NumPy arrays."""
        return [
            Layer(weight.detach().numpy().copy(), bias.detach().numpy().copy())
            for weight, bias in zip(self.weights, self.biases, strict=True)
        ]


def relaxed_distortion(tangent: Tensor, cotangent: Tensor) -> Tensor:
    """Distance of a decoder from a scaled isometry, of J v (n, D) and J'J v (n, d) with v ~ N(0, I).

    The relaxed distortion measure E[tr H^2] / E[tr H]^2 of the pullback metric H = J'J, with both traces
    estimated by Hutchinson's method (Lee, Yoon, Son and Park, Regularized Autoencoders for Isometric
    Representation Learning, ICLR 2022). Its least value is 1/d, at H = c I everywhere.
    """
    return cotangent.square().sum(dim=1).mean() / tangent.square().sum(dim=1).mean() ** 2
