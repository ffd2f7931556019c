"""Draw a digit as thick as possible while a network still recognises it (paper, appendix)."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from hdsafebo.embeddings.registry import load_embedding
from hdsafebo.errors import DatasetError
from hdsafebo.params import Params
from hdsafebo.problem import Codec, Problem, Safety
from hdsafebo.problems.digit_images import DigitImages, load_digit_images
from hdsafebo.problems.digit_predictor import DigitPredictor
from hdsafebo.problems.knowledge import TaskKnowledge
from hdsafebo.problems.registry import INFORMED_SUFFIX, Task, is_informed
from hdsafebo.trials import Evaluation, Trials
from hdsafebo.typing import FloatArray, IntArray

PREDICTOR_FILE = "models/digits/predictor.safetensors"
EMBEDDING_FILE = "models/digits/embedding.safetensors"
_LEAST_PROBABILITY = 1e-6  # below it, and above its complement, odds are all one to the model


class ThickDigit(Problem):
    """Sum of intensities under the probability that the image shows the digit.

    Args:
        digit: 0 to 9.
        images: initial trials are images of the digit from here; the best of them that is recognised
            normalises the objective, as in the paper.
        predictor: gives the probability.
        temperature: of the softmax.
        threshold: least probability of a safe image.
        shown: (n, D) images to what the searched space can show of them. A code has the values of the image
            that it decodes to; with those of the image that it encodes, which is brighter, the initial data
            would mislead every model. None shows images as they are.
        log_odds: the logarithm of the odds is modelled, which does not saturate as the probability does.
        name: of the task; None is `digits_` and the digit.

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
        shown: Callable[[FloatArray], FloatArray] | None = None,
        log_odds: bool = False,
        name: str | None = None,
    ) -> None:
        self.name = f"digits_{digit}" if name is None else name
        self.digit = digit
        self.predictor = predictor
        self.temperature = temperature
        self.bounds = np.vstack([np.zeros(images.side**2), np.ones(images.side**2)])
        transform = _log_odds if log_odds else None
        self.safety = (Safety("recognition_probability", threshold, transform=transform),)
        self.images = images.pixels[images.labels == digit]
        self._shown = shown
        recognised = self._probability(self.images) >= threshold
        if not recognised.any():
            raise DatasetError(f"no image of digit {digit} is recognised with probability >= {threshold}")
        self.best_image_sum = float(self.images[recognised].sum(axis=1).max())

    def initial(self, n: int, rng: np.random.Generator) -> tuple[FloatArray, IntArray]:
        """Different images of the digit, as the searched space shows them."""
        if n > len(self.images):
            raise DatasetError(f"{self.name}: {n} initial images asked for, the set has {len(self.images)}")
        images = self.images[rng.choice(len(self.images), n, replace=False)]
        return images if self._shown is None else self._shown(images), np.full(n, -1)

    def evaluate(self, trials: Trials) -> Evaluation:
        """Intensities outside [0, 1] cannot be shown, so images are clipped."""
        pixels = np.clip(trials.x, 0.0, 1.0)
        return Evaluation(pixels.sum(axis=1) / self.best_image_sum, self._probability(pixels)[:, None])

    def _probability(self, pixels: FloatArray) -> FloatArray:
        return self.predictor.probability(pixels, self.digit, self.temperature)


def make_task(name: str, params: Params, *, seed: int, root: Path) -> Task:
    """The task of a digit, `digits_3` or `digits_3_informed`; see `problems.registry`."""
    settings = params.tasks.digits.problem
    images = load_digit_images(params.digits.source, params.digits.folder_path(root))
    embedding = load_embedding(root / EMBEDDING_FILE, input_dim=images.pixels.shape[1])
    codes = embedding.encode(images.pixels)

    def latent(initial_inputs: FloatArray) -> Codec:
        return embedding

    def shown(pixels: FloatArray) -> FloatArray:
        return np.clip(embedding.decode(embedding.encode(pixels)), 0.0, 1.0)

    informed = is_informed(name)
    problem = ThickDigit(
        int(name.removesuffix(INFORMED_SUFFIX).rsplit("_", 1)[1]),
        images,
        DigitPredictor.load(root / PREDICTOR_FILE),
        temperature=settings.temperature,
        threshold=settings.threshold,
        shown=shown,
        log_odds=informed,
        name=name,
    )
    knowledge = TaskKnowledge(
        latent_space=f"{codes.shape[1]} codes of {embedding.name}, the box of the codes of all images",
        safety=f"recognition_probability, {'the logarithm of its odds' if informed else 'as it is'}",
    )
    return Task(
        problem,
        latent,
        inputs=(PREDICTOR_FILE, EMBEDDING_FILE),
        latent_bounds=np.vstack([codes.min(axis=0), codes.max(axis=0)]),
        knowledge=knowledge,
    )


def _log_odds(probability: FloatArray) -> FloatArray:
    p = np.clip(probability, _LEAST_PROBABILITY, 1.0 - _LEAST_PROBABILITY)
    return np.asarray(np.log(p / (1.0 - p)))
