"""The isometry check: how well an embedding keeps distances and finds its way back.

Proposition 3 of the paper carries the safety guarantee over from the latent space to the original one if
the embedding is an isometry up to scale and the kernel is stationary. So this is measured before anything
is optimised over an embedding (paper, appendix on the distance preserving of IRVAE).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from functools import cached_property

import numpy as np

from hdsafebo.embeddings.base import Embedding
from hdsafebo.embeddings.distances import (
    Rows,
    condition_number,
    distance_correlation,
    distance_scale,
    gp_differences,
    pair_distances,
    reconstruction_mse,
)
from hdsafebo.errors import IsometryError
from hdsafebo.typing import FloatArray


@dataclass(frozen=True)
class IsometryMeasures:
    """What is measured of one embedding.

    Attributes:
        distance_correlation: Pearson correlation of pairwise distances before and after encoding; the
            paper's table of distance preservation calls it linear correlation of distance.
        scale: s of the best fit latent distance = s * original distance.
        gp_mean_difference, gp_variance_difference: see `distances.gp_differences`.
        round_trip: share of seen rows that are nearest to their own decoded code.
        round_trip_held_out: the same for configurations that were held out of training.
        round_trip_held_out_currents: the same for currents between those of the dataset, nearest among them.
        reconstruction_mse: mean squared error of decoded codes per component.
        condition_number: median condition number of the pullback metric J'J of the decoder; 1 for a
            scaled isometry, None where the decoder is blind to a direction of the code.
    """

    distance_correlation: float
    scale: float
    gp_mean_difference: float
    gp_variance_difference: float
    round_trip: float
    round_trip_held_out: float
    round_trip_held_out_currents: float
    reconstruction_mse: float
    condition_number: float | None

    def require(self, name: str, floors: Mapping[str, float]) -> None:
        """Stop if a measure is below its floor.

        Args:
            name: of the embedding.
            floors: least value by measure.

        Raises:
            IsometryError: naming measured value, floor, and the parameter that overrides it.
        """
        below = {key: floor for key, floor in floors.items() if not asdict(self)[key] >= floor}
        if below:
            found = ", ".join(
                f"{key} is {asdict(self)[key]:.4f}, its floor {floor:g}" for key, floor in below.items()
            )
            keys = " and ".join(f"isometry.floors.{name}.{key}" for key in below)
            raise IsometryError(
                f"embedding {name!r}: {found}; train it longer (embeddings.models.{name}.epochs), "
                f"or lower {keys} in params.yaml to go on with it as it is"
            )


@dataclass(frozen=True)
class RoundTrip:
    """Points that are encoded, decoded and looked up.

    Attributes:
        points: shape (n, D).
        rows: rows of a dataset that they are, shape (n,).
        nearest: nearest rows (n,) of that dataset, and the distances (n,), of points (n, D).
    """

    points: FloatArray
    rows: Rows
    nearest: Callable[[FloatArray], tuple[Rows, FloatArray]]

    def share(self, embedding: Embedding) -> float:
        """Share of the points whose decoded code is nearest to the row that they are."""
        found, _ = self.nearest(embedding.decode(embedding.encode(self.points)))
        return float(np.mean(found == self.rows))


@dataclass(frozen=True)
class IsometryCheck:
    """What is measured the same way of every embedding.

    Attributes:
        points: shape (n, D), in random order.
        pairs: of the points whose distances are compared, shape (2, p).
        seen, held_out, held_out_currents: round trips.
        gp_points: of the points, how many the Gaussian process comparison takes; half are observed.
        gp_draws: functions that it draws.
        jacobian_points: of the points, at how many codes the pullback metric is taken.
        seed: of the functions.
    """

    points: FloatArray
    pairs: Rows
    seen: RoundTrip
    held_out: RoundTrip
    held_out_currents: RoundTrip
    gp_points: int
    gp_draws: int
    jacobian_points: int
    seed: int

    @cached_property
    def original_distances(self) -> FloatArray:
        """Distances (p,) of the pairs before encoding."""
        return pair_distances(self.points, self.pairs)

    def measure(self, embedding: Embedding) -> tuple[IsometryMeasures, FloatArray]:
        """All measures of an embedding, and the distances (p,) of the pairs' codes."""
        codes = embedding.encode(self.points)
        latent = pair_distances(codes, self.pairs)
        scale = distance_scale(self.original_distances, latent)
        mean_difference, variance_difference = gp_differences(
            self.points[: self.gp_points],
            codes[: self.gp_points],
            scale,
            np.random.default_rng(self.seed),
            train=self.gp_points // 2,
            draws=self.gp_draws,
        )
        condition = condition_number(embedding, codes[: self.jacobian_points])
        measures = IsometryMeasures(
            distance_correlation=distance_correlation(self.original_distances, latent),
            scale=scale,
            gp_mean_difference=mean_difference,
            gp_variance_difference=variance_difference,
            round_trip=self.seen.share(embedding),
            round_trip_held_out=self.held_out.share(embedding),
            round_trip_held_out_currents=self.held_out_currents.share(embedding),
            reconstruction_mse=reconstruction_mse(embedding, self.points),
            condition_number=condition if np.isfinite(condition) else None,
        )
        return measures, latent
