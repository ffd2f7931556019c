"""Train the predictor and the embedding of the digits task."""

from __future__ import annotations

import numpy as np

from hdsafebo.embeddings.registry import make_embedding
from hdsafebo.pipeline.stage import Stage, run_stage
from hdsafebo.problems.digit_images import load_digit_images
from hdsafebo.problems.digit_predictor import DigitPredictor
from hdsafebo.problems.digits import EMBEDDING_FILE, PREDICTOR_FILE


def main(stage: Stage) -> None:
    """Train the predictor and the embedding of the digits task."""
    settings = stage.params.digits
    images = load_digit_images(settings.source, settings.folder_path(stage.root))
    rng = np.random.default_rng(settings.seed)
    predictor = DigitPredictor(images.side)
    accuracy = predictor.fit(images, epochs=settings.predictor_epochs, rng=rng)
    predictor.save(stage.path(PREDICTOR_FILE))
    embedding = make_embedding(settings.embedding, **settings.embedding_settings).fit(images.pixels, rng=rng)
    embedding.save(stage.path(EMBEDDING_FILE))
    error = float(((embedding.decode(embedding.encode(images.pixels)) - images.pixels) ** 2).mean())
    stage.log_metrics({"predictor_accuracy": accuracy, "reconstruction_mse": error})
    print(f"predictor accuracy {accuracy:.3f} on held-out images, reconstruction error {error:.4f} per pixel")


if __name__ == "__main__":
    run_stage("train_digits", main, blocks=["digits"])
