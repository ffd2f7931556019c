"""Draw a digit as thick as possible while a network still recognises it (paper, appendix)."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from hdsafebo.embeddings.registry import load_embedding
from hdsafebo.errors import DatasetError
from hdsafebo.params import Params
from hdsafebo.problem import Evaluation, FloatArray, IntArray, Problem, Safety, Trials
from hdsafebo.problems.digit_images import DigitImages, load_digit_images
from hdsafebo.problems.digit_predictor import DigitPredictor
from hdsafebo.problems.registry import Codec, Task

PREDICTOR_FILE = "models/digits/predictor.safetensors"
EMBEDDING_FILE = "models/digits/embedding.safetensors"


class ThickDigit(Problem):
    """Sum of intensities under the probability that the image shows the digit.

    Args:
        digit: 0 to 9.
        images: initial trials are images of the digit from here; the best of them that is recognised
            normalises the objective, as in the paper.
        predictor: gives the probability.
        temperature: of the softmax.
        threshold: least probability of a safe image.

    Raises:
        DatasetError: no image of the digit is recognised.
    """

    depends_on_history = False

    def __init__(
        self,
        digit: int,
        images: DigitImages,
        predictor: DigitPredictor,
        *,
        temperature: float,
        threshold: float,
    ) -> None:
        self.name = f"digits_{digit}"
        self.digit = digit
        self.predictor = predictor
        self.temperature = temperature
        self.bounds = np.vstack([np.zeros(images.side**2), np.ones(images.side**2)])
        self.safety = (Safety("recognition_probability", threshold),)
        self.images = images.pixels[images.labels == digit]
        recognised = self._probability(self.images) >= threshold
        if not recognised.any():
            raise DatasetError(f"no image of digit {digit} is recognised with probability >= {threshold}")
        self.best_image_sum = float(self.images[recognised].sum(axis=1).max())

    def initial(self, n: int, rng: np.random.Generator) -> tuple[FloatArray, IntArray]:
        """n different images of the digit."""
        if n > len(self.images):
            raise DatasetError(f"{self.name}: {n} initial images asked for, the set has {len(self.images)}")
        return self.images[rng.choice(len(self.images), n, replace=False)], np.full(n, -1)

    def evaluate(self, trials: Trials) -> Evaluation:
        """Intensities outside [0, 1] cannot be shown, so images are clipped."""
        pixels = np.clip(trials.x, 0.0, 1.0)
        return Evaluation(pixels.sum(axis=1) / self.best_image_sum, self._probability(pixels)[:, None])

    def _probability(self, pixels: FloatArray) -> FloatArray:
        return self.predictor.probability(pixels, self.digit, self.temperature)


def make_task(name: str, params: Params, *, method: str, seed: int, root: Path) -> Task:
    """The task of a digit; see `problems.registry.make_task`."""
    settings = params.tasks.digits.problem
    images = load_digit_images(params.digits.source, params.digits.folder_path(root))
    problem = ThickDigit(
        int(name.rsplit("_", 1)[1]),
        images,
        DigitPredictor.load(root / PREDICTOR_FILE),
        temperature=settings.temperature,
        threshold=settings.threshold,
    )
    embedding = load_embedding(root / EMBEDDING_FILE, input_dim=images.pixels.shape[1])
    codes = embedding.encode(images.pixels)

    def latent(initial_inputs: FloatArray) -> Codec:
        return embedding

    return Task(
        problem,
        latent,
        inputs=(PREDICTOR_FILE, EMBEDDING_FILE),
        latent_bounds=np.vstack([codes.min(axis=0), codes.max(axis=0)]),
    )
