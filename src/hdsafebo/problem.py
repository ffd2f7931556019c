"""What is optimised: a box of inputs, an objective to maximise, safety functions above thresholds."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hdsafebo.errors import ProblemError
from hdsafebo.trials import Evaluation, Trials
from hdsafebo.typing import FloatArray, IntArray


@dataclass(frozen=True)
class Safety:
    """One safety function: an input is safe when its value is at least `threshold`.

    Attributes:
        name: column name of the value.
        threshold: h of the paper (section 3; the paper shifts it to 0).
        modelled: the optimiser fits a Gaussian process to it and keeps its bound above the threshold.
        reported: it decides the `safe` column of results and the metrics Safety and Violation.
        transform: increasing function applied to values and threshold before modelling, so that a
            Gaussian process suits the values better; None models the values as they are.

    Raises:
        ProblemError: the threshold is no finite number, or the transform does not increase there.
    """

    name: str
    threshold: float
    modelled: bool = True
    reported: bool = True
    transform: Callable[[FloatArray], FloatArray] | None = field(default=None, compare=False)

    def __post_init__(self) -> None:
        try:
            # NumPy's own numbers have no place in a saved state.
            threshold = float(floats(self.threshold, "threshold"))
        except (ProblemError, TypeError, ValueError, OverflowError):
            threshold = np.nan
        if not np.isfinite(threshold):
            raise ProblemError(
                f"threshold of safety function {self.name!r} is {self.threshold}; expected a finite number"
            )
        for name, value in (
            ("threshold", threshold),
            ("modelled", bool(self.modelled)),
            ("reported", bool(self.reported)),
        ):
            object.__setattr__(self, name, value)
        if self.transform is not None:
            self._check_increasing(self.transform)

    def _check_increasing(self, transform: Callable[[FloatArray], FloatArray]) -> None:
        """A decreasing transform would model the unsafe side as the safe one."""
        step = 1e-3 * max(abs(self.threshold), 1e-3)
        with np.errstate(all="ignore"):
            low, middle, high = (
                float(np.asarray(transform(np.array([self.threshold + shift])), float).item())
                for shift in (-step, 0.0, step)
            )
        around = [v for v in (low, middle, high) if not np.isnan(v)]  # one side may be no valid value
        if not np.isfinite(middle) or around != sorted(around) or around[0] == around[-1]:
            raise ProblemError(
                f"transform of safety function {self.name!r} makes {low}, {middle}, {high} of "
                f"{self.threshold - step:g}, the threshold {self.threshold:g} and {self.threshold + step:g}; "
                "expected an increasing function that is finite at the threshold"
            )


@runtime_checkable
class Codec(Protocol):
    """What an optimiser needs of an embedding."""

    def encode(self, x: FloatArray, /) -> FloatArray:
        """(n, D) inputs to (n, d) codes."""

    def decode(self, z: FloatArray, /) -> FloatArray:
        """(n, d) codes to (n, D) inputs."""


@runtime_checkable
class MovingCodec(Codec, Protocol):
    """A codec whose decoder moves inputs to where they are permitted, which changes from round to round."""

    def moved(self, z: FloatArray, /) -> NDArray[np.bool_]:
        """(n,) True for codes whose decoded input was moved."""


@runtime_checkable
class LinearCodec(Codec, Protocol):
    """An affine codec that says what becomes of a linear map, so that no method has to find out."""

    def compose(self, matrix: FloatArray, /) -> FloatArray:
        """(p, d) the linear map of codes that (p, D) `matrix` is of decoded inputs."""


class CandidateSet(Protocol):
    """A finite set of inputs, the only ones that can be evaluated."""

    def __len__(self) -> int:
        """N, number of candidates; asking for it builds no features."""

    @property
    def features(self) -> FloatArray:
        """(N, p) inputs of the kernel, one row per candidate."""

    def inputs(self, rows: IntArray) -> FloatArray:
        """(k, D) inputs of the given rows."""

    def nearest(self, x: FloatArray, taken: IntArray) -> IntArray:
        """(n,) rows nearest to the (n, D) inputs `x`, all different and none of them in `taken`."""


@runtime_checkable
class ContextualSet(Protocol):
    """What a `CandidateSet` offers besides, where its inputs have the contexts of the moment, too.

    Methods only: `isinstance` of a protocol reads a set's properties on Python 3.11, and `features` is dear.
    """

    def hold(self, context: FloatArray, /) -> None:
        """Take the (c,) context columns as known from now on."""

    def features_of(self, x: FloatArray, /) -> FloatArray:
        """(n, p) kernel inputs of any (n, D) inputs, under whatever contexts they were tried."""


@dataclass(frozen=True)
class LinearFeatures:
    """Features k = A x + c that state their matrix, so that no method has to find it with D unit vectors.

    Attributes:
        matrix: (p, D) A.
        offset: (p,) c; None means 0.
    """

    matrix: FloatArray
    offset: FloatArray | None = None

    def __call__(self, x: FloatArray) -> FloatArray:
        """(n, p) features of (n, D) inputs."""
        values = np.asarray(x, float) @ self.matrix.T
        return values if self.offset is None else values + self.offset


class Problem(ABC):
    """An objective to maximise under safety functions, over a box or a finite set of inputs.

    Attributes:
        name: identifies the problem in files and messages.
        bounds: (2, D) lower and upper limits of the input.
        safety: the safety functions, in the order of the columns of `Evaluation.safety`.
        candidates: the finite set of inputs when not every point of the box can be evaluated.
        features: affine map from inputs (n, D) to kernel inputs (n, p), when distances between
            inputs say little; None uses the searched space itself. In many dimensions a `LinearFeatures`,
            which states its matrix, saves time and memory.
        optimum: best safe objective when it is known (used in reports only).
        depends_on_history: results depend on what was evaluated before (as those of a function that is
            drawn while it is looked at), so that a resumed run must evaluate all of it again.
        contexts: columns of the input that are known before a trial and not chosen (a load, a day); each
            `ask` is given their values.
        lands: some points of the box cannot be run; `land` says what is run in their place.
        noise: (1 + m,) known standard deviations of one measurement of the objective and of each safety
            function, NaN where unknown; None where all are. Where it is known, a safe probability is that of
            the next measurement, otherwise that of the function.
        resolution: (D,) powers of two; what is proposed in the inputs themselves is rounded to their whole
            multiples, as are the bounds. In tens of thousands of dimensions saved states are then small. None
            leaves every number as it is.
        failures_teach: a trial that failed is evidence that trials near it fail, and nothing that may fail is
            believed safe.
    """

    name: str
    bounds: FloatArray
    safety: tuple[Safety, ...]
    candidates: CandidateSet | None = None
    features: Callable[[FloatArray], FloatArray] | None = None
    optimum: float | None = None
    depends_on_history: bool = True
    contexts: tuple[int, ...] = ()
    lands: bool = False
    noise: FloatArray | None = None
    resolution: FloatArray | None = None
    failures_teach: bool = False

    @abstractmethod
    def evaluate(self, trials: Trials) -> Evaluation:
        """Evaluate the inputs `trials.x` (or `trials.candidate` on a finite set).

        A problem with randomness of its own must depend only on its seed and on the trials evaluated
        before, so that a run can be replayed.
        """

    def initial(self, n: int, rng: np.random.Generator) -> tuple[FloatArray, IntArray]:
        """Inputs of the initial trials: (n, D) points and their (n,) candidate rows (-1 without a set)."""
        if self.candidates is not None:
            rows = rng.choice(len(self.candidates), n, replace=False)
            return self.candidates.inputs(rows), rows
        return rng.uniform(self.bounds[0], self.bounds[1], (n, self.bounds.shape[1])), np.full(n, -1)

    def land(self, x: FloatArray) -> FloatArray:
        """(n, D) inputs that are run where the (n, D) points of the box are proposed.

        Landing what has landed changes nothing, and contexts are left as they are.
        """
        return x

    def neighbours(self, x: FloatArray) -> FloatArray:
        """(k, D) inputs that can be run and differ from the (D,) one in one step of one parameter.

        A search meets them although nothing lies in between; where all points can be run, none are needed.
        """
        return np.empty((0, len(x)))

    def is_safe(self, safety: FloatArray) -> NDArray[np.bool_]:
        """(n,) True where every reported safety function of the (n, m) values meets its threshold."""
        keep = [j for j, s in enumerate(self.safety) if s.reported]
        thresholds = np.array([self.safety[j].threshold for j in keep])
        return np.asarray((safety[:, keep] >= thresholds).all(axis=1))

    def violation(self, safety: FloatArray) -> FloatArray:
        """(n,) sum over reported safety functions of max(0, h - g)."""
        keep = [j for j, s in enumerate(self.safety) if s.reported]
        thresholds = np.array([self.safety[j].threshold for j in keep])
        return np.asarray(np.maximum(0.0, thresholds - safety[:, keep]).sum(axis=1))


def floats(values: ArrayLike, what: str) -> FloatArray:
    """Values as floats; text is refused, of which Python would make numbers: 10 of '1_0'.

    Raises:
        ProblemError: a value is text; `what` is its name.
        ValueError: rows have different lengths.
        TypeError: a value is no number otherwise.
    """
    given = np.asarray(values)
    if (text := first_text(given)) is not None:
        raise ProblemError(f"{what}: {text!r} is text; expected numbers")
    return np.asarray(given, float)


def features_of(problem: Problem, x: FloatArray) -> FloatArray:
    """(n, p) features of (n, D) inputs of a problem that has some; text is refused."""
    assert problem.features is not None
    return floats(problem.features(x), f"features of {problem.name!r}")


def decoded(codec: Codec, z: FloatArray) -> FloatArray:
    """(n, D) inputs of (n, d) codes; text is refused."""
    return floats(codec.decode(z), "decoded codes")


def encoded(codec: Codec, x: FloatArray) -> FloatArray:
    """(n, d) codes of (n, D) inputs; text is refused."""
    return floats(codec.encode(x), "codes of inputs")


def first_text(values: NDArray[Any]) -> str | None:
    """The beginning of the first text in an array, also among objects; None without one."""
    if values.dtype.kind not in "USO":
        return None
    return next((str(value)[:40] for value in values.flat if isinstance(value, str | bytes)), None)


def check_problem(problem: Problem) -> None:
    """Raise `ProblemError` naming what is wrong with a problem's box or safety functions."""
    bounds = floats(problem.bounds, f"bounds of {problem.name!r}")
    if bounds.ndim != 2 or bounds.shape[0] != 2 or bounds.shape[1] == 0:
        raise ProblemError(
            f"bounds of {problem.name!r} have shape {bounds.shape}; expected (2, D) with D >= 1: all lower "
            "limits, then all upper ones"
        )
    infinite = np.flatnonzero(~np.isfinite(bounds).all(axis=0))
    if len(infinite):
        raise ProblemError(f"bounds of {problem.name!r} are not finite in dimensions {infinite[:10]}")
    empty = np.flatnonzero(bounds[0] > bounds[1])
    if len(empty):
        raise ProblemError(
            f"lower bound above upper bound of {problem.name!r} in dimensions {empty.tolist()[:10]}"
        )
    if bounds.shape == (2, 2) and (bounds[0] == bounds[1]).any() and (bounds[:, 0] < bounds[:, 1]).all():
        raise ProblemError(
            f"bounds of {problem.name!r} are {bounds.tolist()}, which look like a pair of limits per "
            f"dimension; expected all lower limits, then all upper ones: {bounds.T.tolist()}"
        )
    if not any(s.modelled for s in problem.safety):
        raise ProblemError(f"problem {problem.name!r} has no modelled safety function; expected at least one")
    matrix = getattr(problem.features, "matrix", None)
    if matrix is not None and (np.ndim(matrix) != 2 or np.shape(matrix)[1] != bounds.shape[1]):
        raise ProblemError(
            f"features of {problem.name!r} have a matrix of shape {np.shape(matrix)}; "
            f"expected (p, {bounds.shape[1]})"
        )
    names = [s.name for s in problem.safety]
    if len(set(names)) != len(names):
        raise ProblemError(f"safety functions of {problem.name!r} have repeated names {names}")
    _check_noise(problem)
    _check_resolution(problem, bounds)


def _check_resolution(problem: Problem, bounds: FloatArray) -> None:
    if problem.resolution is None:
        return
    resolution = np.asarray(problem.resolution, float)
    if resolution.shape != bounds.shape[1:] or not (np.frexp(resolution)[0] == 0.5).all():
        raise ProblemError(
            f"resolution of {problem.name!r} has shape {resolution.shape}; expected ({bounds.shape[1]},) "
            "powers of two"
        )
    if not np.array_equal(bounds / resolution, np.rint(bounds / resolution)):
        raise ProblemError(f"bounds of {problem.name!r} are no whole multiples of its resolution")


def _check_noise(problem: Problem) -> None:
    if problem.noise is None:
        return
    noise = np.asarray(problem.noise, float)
    if noise.shape != (1 + len(problem.safety),) or (noise <= 0).any() or np.isinf(noise).any():
        raise ProblemError(
            f"noise of {problem.name!r} is {noise.tolist()}; expected {1 + len(problem.safety)} positive "
            "standard deviations, of the objective and of each safety function, NaN where unknown"
        )
    for safety, known in zip(problem.safety, np.isfinite(noise[1:]), strict=True):
        if known and safety.transform is not None:
            raise ProblemError(
                f"safety function {safety.name!r} of {problem.name!r} has a transform, and a known noise in "
                "the units before it; give one of the two"
            )


class FunctionProblem(Problem):
    """A problem made of one's own function.

    Args:
        function: takes (n, D) inputs, returns the (n,) objective and the (n, m) safety values.
        bounds: (2, D) limits.
        safety: one `Safety` per column.
        name: name in messages and files.
    """

    def __init__(
        self,
        function: Callable[[FloatArray], tuple[FloatArray, FloatArray]],
        bounds: FloatArray | Sequence[Sequence[float]],
        safety: Sequence[Safety] = (Safety("safety", 0.0),),
        name: str = "function",
    ) -> None:
        self.function = function
        self.bounds = floats(bounds, f"bounds of {name!r}")
        self.safety = tuple(safety)
        self.name = name
        check_problem(self)

    def evaluate(self, trials: Trials) -> Evaluation:
        objective, safety = self.function(trials.x)
        values = floats(safety, f"safety values of {self.name!r}")
        outcomes = floats(objective, f"objective of {self.name!r}")
        return Evaluation(outcomes, values[:, None] if values.ndim == 1 else values)
