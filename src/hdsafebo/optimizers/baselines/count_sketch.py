"""Sparse random embeddings in which every input follows one latent coordinate, up to sign.

HeSBO draws them at random (Nayebi, Munteanu and Poloczek, ICML 2019); BAxUS fills the bins evenly and
splits them as it learns (Papenmeier, Nardi and Poloczek, NeurIPS 2022).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hdsafebo.typing import FloatArray, IntArray


@dataclass(frozen=True)
class CountSketch:
    """x_i = sign_i * y_{bin_i}: a map from [-1, 1]^d into [-1, 1]^D that needs no clipping.

    Attributes:
        bins: (D,) latent coordinate of each input.
        signs: (D,) +1 or -1.
        dimension: d, number of latent coordinates.
    """

    bins: IntArray
    signs: FloatArray
    dimension: int

    def lift(self, y: FloatArray) -> FloatArray:
        """(n, D) inputs of the (n, d) latent points."""
        return np.asarray(y[:, self.bins] * self.signs)

    @classmethod
    def random(cls, inputs: int, dimension: int, rng: np.random.Generator) -> CountSketch:
        """Bins drawn independently (HeSBO, section 3: the hash functions h and s)."""
        return cls(rng.integers(dimension, size=inputs), rng.choice([-1.0, 1.0], inputs), dimension)

    @classmethod
    def balanced(cls, inputs: int, dimension: int, rng: np.random.Generator) -> CountSketch:
        """Bins whose sizes differ by at most one (BAxUS, section 3.1)."""
        dimension = min(dimension, inputs)
        bins = np.empty(inputs, np.int64)
        for b, members in enumerate(np.array_split(rng.permutation(inputs), dimension)):
            bins[members] = b
        return cls(bins, rng.choice([-1.0, 1.0], inputs), dimension)

    def split(self, new_bins: int, rng: np.random.Generator) -> tuple[CountSketch, IntArray]:
        """Split every bin into `new_bins` + 1 parts, fewer where it has fewer inputs (BAxUS, algorithm 2).

        Returns:
            The finer embedding, and for each of its coordinates the coordinate it came from: latent
            points are carried over as y[:, parent], which leaves their inputs as they were.
        """
        bins, parent = self.bins.copy(), list(range(self.dimension))
        for b in range(self.dimension):
            members = rng.permutation(np.flatnonzero(self.bins == b))
            if len(members) < 2:
                continue
            for part in np.array_split(members, min(new_bins + 1, len(members)))[1:]:
                bins[part] = len(parent)
                parent.append(b)
        return CountSketch(bins, self.signs, len(parent)), np.array(parent)
