"""The digits task: images, predictor, objective and safety."""

from __future__ import annotations

import gzip
import struct
from pathlib import Path

import numpy as np
import pytest

from hdsafebo.errors import DatasetError, EmbeddingTrainingError
from hdsafebo.params import Digits
from hdsafebo.params.tasks import DigitsProblem
from hdsafebo.problems.digit_images import load_digit_images, read_idx
from hdsafebo.problems.digit_predictor import DigitPredictor
from hdsafebo.problems.digits import ThickDigit
from hdsafebo.trials import Trials


@pytest.fixture(scope="module")
def predictor() -> DigitPredictor:
    predictor = DigitPredictor(8)
    assert predictor.fit(load_digit_images("sklearn"), epochs=15, rng=np.random.default_rng(0)) > 0.9
    return predictor


def write_idx(path: Path, values: np.ndarray) -> None:
    header = bytes((0, 0, 8, values.ndim)) + struct.pack(f">{values.ndim}I", *values.shape)
    opener = gzip.open if path.suffix == ".gz" else open
    with opener(path, "wb") as file:
        file.write(header + values.tobytes())


def test_idx_files_in_mnists_layout(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    images, labels = rng.integers(0, 256, (5, 28, 28), np.uint8), rng.integers(0, 10, 5).astype(np.uint8)
    write_idx(tmp_path / "t10k-images-idx3-ubyte.gz", images)
    write_idx(tmp_path / "t10k-labels-idx1-ubyte.gz", labels)
    loaded = load_digit_images("idx", tmp_path)
    assert loaded.side == 28
    np.testing.assert_array_equal(loaded.labels, labels)
    np.testing.assert_allclose(loaded.pixels.reshape(5, 28, 28) * 255, images)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "not an IDX file"),
        (b"\x80\x04\x95cposix\nsystem\n", "not an IDX file"),
        (bytes((0, 0, 8, 3)) + struct.pack(">3I", 2, 2, 2) + b"1234", "promises 8|promises"),
        (bytes((0, 0, 8, 3)) + struct.pack(">3I", 2**31, 2**31, 2**31), "promises"),
        (bytes((0, 0, 13, 3)) + struct.pack(">3I", 1, 1, 1) + b"1234", "not an IDX file"),
    ],
)
def test_damaged_idx_files(tmp_path: Path, content: bytes, message: str) -> None:
    path = tmp_path / "train-images-idx3-ubyte"
    path.write_bytes(content)
    with pytest.raises(DatasetError, match=message):
        read_idx(path, 3)


def test_truncated_gzip(tmp_path: Path) -> None:
    path = tmp_path / "train-images-idx3-ubyte.gz"
    write_idx(path, np.zeros((3, 4, 4), np.uint8))
    path.write_bytes(path.read_bytes()[:-12])
    with pytest.raises(DatasetError, match="cannot be read"):
        read_idx(path, 3)


def test_missing_folder_is_named(tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match="no IDX image files"):
        load_digit_images("idx", tmp_path)
    with pytest.raises(DatasetError, match="needs a folder"):
        load_digit_images("idx", None)


def test_training_is_reproducible_and_survives_a_file(predictor: DigitPredictor, tmp_path: Path) -> None:
    images = load_digit_images("sklearn")
    again = DigitPredictor(8)
    again.fit(images, epochs=15, rng=np.random.default_rng(0))
    np.testing.assert_array_equal(again.logits(images.pixels), predictor.logits(images.pixels))
    predictor.save(tmp_path / "p.safetensors")
    loaded = DigitPredictor.load(tmp_path / "p.safetensors")
    np.testing.assert_array_equal(loaded.logits(images.pixels), predictor.logits(images.pixels))


def test_untrained_predictor_is_refused() -> None:
    images = load_digit_images("sklearn")
    shuffled = type(images)(images.pixels, np.random.default_rng(0).permutation(images.labels))
    with pytest.raises(EmbeddingTrainingError, match="predictor_epochs"):
        DigitPredictor(8).fit(shuffled, epochs=1, rng=np.random.default_rng(0))


@pytest.mark.parametrize("content", [b"", b"\x80\x04\x95cposix\nsystem\n", b"\xff" * 64])
def test_hostile_predictor_files(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "p.safetensors"
    path.write_bytes(content)
    with pytest.raises(DatasetError, match="not a digit predictor"):
        DigitPredictor.load(path)


def test_probability_is_the_softmax(predictor: DigitPredictor) -> None:
    pixels = load_digit_images("sklearn").pixels[:20]
    logits = predictor.logits(pixels) / 200.0
    expected = np.exp(logits[:, 3]) / np.exp(logits).sum(axis=1)
    np.testing.assert_allclose(predictor.probability(pixels, 3, 200.0), expected, rtol=1e-12)
    np.testing.assert_allclose(sum(predictor.probability(pixels, d, 200.0) for d in range(10)), 1.0)


def test_objective_is_normalised_by_the_best_valid_image(predictor: DigitPredictor) -> None:
    images = load_digit_images("sklearn")
    problem = ThickDigit(4, images, predictor, temperature=200.0, threshold=0.5)
    x, candidate = problem.initial(len(problem.images), np.random.default_rng(0))
    assert (candidate == -1).all()
    assert len(np.unique(x, axis=0)) == len(np.unique(problem.images, axis=0))
    result = problem.evaluate(Trials.pending(x, x, 1))
    safe = problem.is_safe(result.safety)
    assert result.objective[safe].max() == pytest.approx(1.0)
    brighter = problem.evaluate(Trials.pending(x + 10.0, x, 1))
    assert brighter.objective.max() == pytest.approx(64 / problem.best_image_sum)


def test_initial_trials_are_what_the_searched_space_shows(predictor: DigitPredictor) -> None:
    images = load_digit_images("sklearn")
    plain = ThickDigit(4, images, predictor, temperature=200.0, threshold=0.5)
    dimmed = ThickDigit(4, images, predictor, temperature=200.0, threshold=0.5, shown=lambda x: 0.5 * x)
    x, _ = plain.initial(20, np.random.default_rng(3))
    shown, candidate = dimmed.initial(20, np.random.default_rng(3))
    np.testing.assert_array_equal(shown, 0.5 * x)
    assert (candidate == -1).all()
    assert dimmed.best_image_sum == plain.best_image_sum  # the data set normalises, not what is shown of it


def test_log_odds_keep_the_order_and_the_threshold(predictor: DigitPredictor) -> None:
    images = load_digit_images("sklearn")
    problem = ThickDigit(4, images, predictor, temperature=200.0, threshold=0.5, log_odds=True)
    transform = problem.safety[0].transform
    assert transform is not None
    p = np.array([0.0, 1e-3, 0.5, 0.9, 1.0])
    np.testing.assert_allclose(transform(p)[1:4], np.log(p[1:4] / (1 - p[1:4])), atol=1e-15)
    assert np.isfinite(transform(p)).all()
    assert (np.diff(transform(p)) > 0).all()
    assert problem.is_safe(problem.evaluate(Trials.pending(problem.images, problem.images, 1)).safety).any()


def test_the_papers_temperature_keeps_images_valid_and_probabilities_apart(predictor: DigitPredictor) -> None:
    images = load_digit_images("sklearn")
    assert DigitsProblem().temperature == 200.0
    warm, plain = (
        np.concatenate(
            [predictor.probability(images.pixels[images.labels == d], d, temperature) for d in range(10)]
        )
        for temperature in (200.0, 1.0)
    )
    assert (warm >= 0.5).mean() > 0.9
    assert ((warm > 0.01) & (warm < 0.99)).mean() > 0.9
    assert ((plain < 1e-6) | (plain > 1 - 1e-6)).mean() > 0.95


def test_the_images_in_the_repository_are_mnists_test_images(project_root: Path) -> None:
    images = load_digit_images("mnist", Digits().folder_path(project_root))
    assert images.pixels.shape == (10_000, 784)
    assert np.bincount(images.labels).tolist() == [980, 1135, 1032, 1010, 982, 892, 958, 1028, 974, 1009]
    assert 0.0 == images.pixels.min() < images.pixels.max() == 1.0
