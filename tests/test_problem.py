"""What a problem may not be."""

import json
from typing import Any

import numpy as np
import pytest

from hdsafebo.errors import ProblemError, TrialError
from hdsafebo.optimizers.controls.sobol import Sobol
from hdsafebo.problem import FunctionProblem, Safety, decoded, encoded, features_of
from hdsafebo.search.space import SearchSpace
from hdsafebo.trials import Trials


@pytest.mark.parametrize(
    "transform",
    [
        lambda v: -v,
        lambda v: -np.log(v),
        lambda v: 1.0 / v,
        lambda v: np.zeros_like(v),
        lambda v: (v - 60.0) ** 2,
        lambda v: np.log(v - 60.0),
        lambda v: np.full_like(v, np.nan),
    ],
    ids=["negative", "log", "inverse", "constant", "parabola", "infinite at the threshold", "nan"],
)
def test_a_transform_that_does_not_increase_is_refused(transform) -> None:
    with pytest.raises(ProblemError, match="transform of safety function 'temp' makes"):
        Safety("temp", 60.0, transform=transform)


@pytest.mark.parametrize("threshold", [0.6, 1e-6, 1e6])
@pytest.mark.parametrize(
    "transform", [np.log, np.sqrt, np.arctan, np.cbrt, lambda v: np.log(v + 1e-9), lambda v: 3 * v]
)
def test_increasing_transforms_are_taken(transform, threshold: float) -> None:
    assert Safety("level", threshold, transform=transform).transform is transform


@pytest.mark.parametrize(
    ("transform", "value"),
    [
        (lambda v: np.where(v > 80.0, 0.0, v), 90.0),  # falls where the threshold's surroundings do not show
        (lambda v: np.where(v < 50.0, 99.0, v), 40.0),
        (np.log, -1.0),
        (lambda v: v[:1], 70.0),
    ],
)
def test_a_value_that_its_transform_moves_across_the_threshold_is_refused(transform, value: float) -> None:
    problem = FunctionProblem(
        lambda x: (x[:, 0], x), np.array([[0.0], [1.0]]), [Safety("temp", 60.0, transform=transform)]
    )
    made = Sobol(problem)
    with pytest.raises(TrialError, match="transform of safety 'temp'"):
        made.observe([[0.5], [0.6]], [0.0, 0.0], [65.0, value])
    assert len(made.trials) == 0
    made.observe([[0.5]], [0.0], [65.0])


@pytest.mark.parametrize("kind", [np.float16, np.float32, np.float64, np.int64, np.array, int])
def test_thresholds_of_any_number_type_are_plain_numbers(kind) -> None:
    threshold = Safety("level", kind(2)).threshold
    assert type(threshold) is float
    assert json.dumps(threshold) == "2.0"


@pytest.mark.parametrize("threshold", [np.float32("nan"), np.inf, "high", None, [1.0, 2.0]])
def test_thresholds_that_are_no_number(threshold) -> None:
    with pytest.raises(ProblemError, match="threshold of safety function 'level' is"):
        Safety("level", threshold)


class Texts:
    """A codec that gives text for numbers."""

    def __init__(self, text: Any) -> None:
        self.text = text

    def encode(self, x: Any) -> Any:
        return [[self.text]]

    def decode(self, z: Any) -> Any:
        return [[self.text]]


@pytest.mark.parametrize("text", ["1_0", "١٢", b"1", np.str_("3")])
def test_text_is_no_number_of_a_problem(text: Any) -> None:
    with pytest.raises(ProblemError, match="expected a finite number"):
        Safety("level", text)
    for bounds in ([[0.0, 0.0], [text, 1.0]], np.array([[0.0, 0.0], [text, 1.0]], object)):
        with pytest.raises(ProblemError, match="is text; expected numbers"):
            FunctionProblem(lambda x: (x[:, 0], x[:, 0]), bounds)
        with pytest.raises(ProblemError, match="is text; expected numbers"):
            SearchSpace(bounds, isotropic=False)
    for function in (
        features_of,
        lambda problem, x: decoded(Texts(text), x),
        lambda problem, x: encoded(Texts(text), x),
    ):
        made = FunctionProblem(lambda x: (x[:, 0], x[:, 0]), [[0.0], [1.0]])
        made.features = lambda x: [[text]]
        with pytest.raises(ProblemError, match="is text; expected numbers"):
            function(made, np.zeros((1, 1)))
    made = FunctionProblem(lambda x: ([text], [0.0]), [[0.0], [1.0]])
    with pytest.raises(ProblemError, match="is text; expected numbers"):
        made.evaluate(Trials.pending(np.zeros((1, 1)), np.zeros((1, 1)), 1))
