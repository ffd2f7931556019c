"""Blocks of the embeddings, their check, and the digits."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from hdsafebo.params.base import Block, Count, Scalar, Share


class Embeddings(Block):
    """Embeddings of the stimulation field maps.

    Attributes:
        models: settings by name of the embeddings that are trained (`embeddings/`).
        held_out_share: share of the configurations that no training sees.
        seed: of the split and of all training.
    """

    models: dict[str, dict[str, Scalar]] = {
        "irvae": {},
        "pca": {},
        "random": {},
        "residual": {"homogeneous": True, "origin": 1.0},
        "vae": {},
    }
    held_out_share: Annotated[float, Field(gt=0, lt=1)] = 0.1
    seed: Annotated[int, Field(ge=0)] = 0


class IsometryFloors(Block):
    """Least values of an embedding's measures (`embeddings/isometry.py`); null demands nothing.

    Attributes:
        distance_correlation: correlation of distances before and after.
        round_trip: share of seen rows that are nearest to their own decoded code.
        round_trip_held_out: the same for configurations held out of training.
        round_trip_held_out_currents: the same for currents between those of the dataset.
    """

    distance_correlation: Share | None = None
    round_trip: Share | None = None
    round_trip_held_out: Share | None = None
    round_trip_held_out_currents: Share | None = None


class IsometryParams(Block):
    """The check that runs before anything is optimised over an embedding.

    Attributes:
        points: field maps between which distances are taken; the paper has 10,000.
        pairs: random pairs of these points.
        figure_pairs: pairs that are kept for the scatter figure.
        gp_points: maps of the Gaussian process comparison; half are observed.
        gp_draws: functions that are drawn for the comparison.
        jacobian_points: codes at which the pullback metric is taken.
        round_trip_rows: rows of the dataset of which each round-trip share is taken.
        seed: of all that is drawn.
        floors: least value of measures, by embedding; below a floor the pipeline stops.
    """

    points: Annotated[int, Field(ge=100)] = 10_000
    pairs: Annotated[int, Field(ge=100)] = 200_000
    figure_pairs: Count = 5_000
    gp_points: Annotated[int, Field(ge=10)] = 1_000
    gp_draws: Count = 32
    jacobian_points: Count = 100
    round_trip_rows: Count = 5_000
    seed: Annotated[int, Field(ge=0)] = 0
    floors: dict[str, IsometryFloors] = {}


MNIST = "data/mnist"


class Digits(Block):
    """Images, predictor and embedding of the digits task.

    Attributes:
        source: `mnist` (its 10,000 test images, in `data/mnist`), `sklearn` (8 x 8 images that scikit-learn
            brings), `idx` (files of MNIST's format in `folder`) or `openml` (all 70,000 images, a download).
        folder: directory of the IDX files, relative to the project's.
        predictor_epochs: passes over the images when the predictor is trained.
        embedding: name of the embedding.
        embedding_settings: settings of the embedding (`embeddings/`).
        seed: of all that is trained.
    """

    source: Literal["mnist", "sklearn", "idx", "openml"] = "mnist"
    folder: str | None = None
    predictor_epochs: Count = 40
    embedding: str = "irvae"
    embedding_settings: dict[str, Scalar] = {"latent_dim": 6}
    seed: Annotated[int, Field(ge=0)] = 0

    def folder_path(self, root: Path) -> Path | None:
        """Directory of the IDX files."""
        if self.source == "mnist":
            return root / MNIST
        return None if self.folder is None else root / self.folder
