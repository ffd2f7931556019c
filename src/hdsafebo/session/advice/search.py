"""What an optimiser sees of a session: a problem over the permitted inputs, and the searched space."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np
from numpy.typing import NDArray

from hdsafebo.errors import ProblemError
from hdsafebo.problem import CandidateSet, Codec, Problem, Safety
from hdsafebo.session.candidates.finite_set import FiniteSet
from hdsafebo.session.log.state import Point
from hdsafebo.session.measuring.outcome_scale import OutcomeScale
from hdsafebo.session.spaces.generic import GenericSpace
from hdsafebo.session.spaces.space import Space
from hdsafebo.trials import Evaluation, Trials
from hdsafebo.typing import FloatArray, IntArray


class SessionProblem(Problem):
    """A problem that only people can evaluate.

    Attributes:
        scale: on which noisy objectives are modelled.
    """

    def __init__(
        self,
        name: str,
        bounds: FloatArray,
        safety: tuple[Safety, ...],
        candidates: CandidateSet | None,
        scale: OutcomeScale,
    ) -> None:
        self.name = name
        self.bounds = bounds
        self.safety = safety
        self.candidates = candidates
        self.scale = scale

    def evaluate(self, trials: Trials) -> Evaluation:
        """Not possible: ProblemError."""
        raise ProblemError(f"{self.name!r} is evaluated by the people of the session, never by a program")


class Search(ABC):
    """The permitted inputs as an optimiser sees them.

    Attributes:
        space: of the session.
        embedding: of the inputs; None searches them directly.
        code_bounds: (2, d) box of codes that is searched; None takes that of the initial trials.
        size: number of candidates of a finite set; None without one.
        begins_anew: tightened limits change the searched box, so that an optimiser has to begin anew.
    """

    space: Space
    embedding: Codec | None
    code_bounds: FloatArray | None = None
    size: int | None = None
    begins_anew: bool = False

    @abstractmethod
    def problem(self, target: str) -> SessionProblem:
        """The problem of one target."""

    @abstractmethod
    def input_of(self, point: Point) -> tuple[FloatArray, int]:
        """Input (1, D) of a point and its candidate row (-1 without a set)."""

    @abstractmethod
    def glance(self, point: Point) -> tuple[FloatArray, int]:
        """As `input_of`, for a point that is only looked at and not going to be tried."""

    @abstractmethod
    def point_of(self, x: FloatArray, row: int) -> Point:
        """The point of an input (D,) and its candidate row."""

    @abstractmethod
    def beyond(self, point: Point) -> IntArray:
        """Candidate rows that are not suggested any more once a point was unsafe."""

    @abstractmethod
    def restrict(self, last: Point | None) -> IntArray:
        """Take the point delivered last into account; returns the candidate rows that are forbidden now."""


class FiniteSearch(Search):
    """Search of a finite set."""

    def __init__(self, space: Space, candidates: FiniteSet, embedding: Codec | None) -> None:
        self.space = space
        self.candidates = candidates
        self.embedding = embedding
        self.size = candidates.size

    def problem(self, target: str) -> SessionProblem:
        """See `Search`."""
        return SessionProblem(
            f"session:{target}",
            self.candidates.bounds,
            self.space.safety,
            self.candidates,
            self.space.scale,
        )

    def input_of(self, point: Point) -> tuple[FloatArray, int]:
        """See `Search`."""
        return self.candidates.encode_points([point]), self.candidates.row(point)

    def glance(self, point: Point) -> tuple[FloatArray, int]:
        """See `Search`."""
        return self.candidates.encode_points([point]), self.candidates.scratch_row(point)

    def point_of(self, x: FloatArray, row: int) -> Point:
        """See `Search`."""
        return self.candidates.point(row)

    def beyond(self, point: Point) -> IntArray:
        """See `Search`."""
        return self.candidates.beyond(point)

    def restrict(self, last: Point | None) -> IntArray:
        """See `Search`."""
        return self.candidates.forbidden(last)


class ReachCodec:
    """An embedding whose decoder ends in the box that the largest step permits.

    Proposals are clipped when they are decoded, so what the optimiser encodes again and predicts is the point
    that would really be evaluated.

    Attributes:
        reach: (2, D) the permitted box.
    """

    def __init__(self, space: GenericSpace, inner: Codec | None) -> None:
        width = space.upper - space.lower
        self._lower, self._width = space.lower, np.where(width > 0, width, 1.0)
        self._inner = inner
        self.reach = np.vstack([space.lower, space.upper])

    def encode(self, x: FloatArray, /) -> FloatArray:
        """(n, d) codes; without an inner embedding the inputs over the width of their limits."""
        return (x - self._lower) / self._width if self._inner is None else self._inner.encode(x)

    def decode(self, z: FloatArray, /) -> FloatArray:
        """(n, D) inputs within reach."""
        return np.asarray(np.clip(self._image(z), self.reach[0], self.reach[1]))

    def moved(self, z: FloatArray, /) -> NDArray[np.bool_]:
        """(n,) True for codes that stand for an input out of reach."""
        x = self._image(z)
        return np.asarray(((x < self.reach[0]) | (x > self.reach[1])).any(axis=1))

    def _image(self, z: FloatArray) -> FloatArray:
        """(n, D) inputs that the codes stand for, within reach or not."""
        return self._lower + z * self._width if self._inner is None else np.asarray(self._inner.decode(z))


class BoxSearch(Search):
    """Search of a box. Where nothing moves in steps, the inputs themselves are searched, without a codec."""

    def __init__(self, space: GenericSpace, embedding: Codec | None) -> None:
        self.space = space
        self._bounds = np.vstack([space.lower, space.upper])
        self._generic = space
        self._codec = ReachCodec(space, embedding)
        self.begins_anew = embedding is None and not space.steps
        self.embedding = None if self.begins_anew else self._codec
        self._whole = self._codec.encode(self._bounds) if embedding is None else None

    @property
    def code_bounds(self) -> FloatArray | None:  # type: ignore[override]
        """(2, d) searched box; without a codec, the limits that are in force."""
        return self._generic.reach(None) if self.begins_anew else self._whole

    def problem(self, target: str) -> SessionProblem:
        """See `Search`."""
        return SessionProblem(f"session:{target}", self._bounds, self.space.safety, None, self.space.scale)

    def input_of(self, point: Point) -> tuple[FloatArray, int]:
        """See `Search`."""
        return np.array([point["values"]], float), -1

    def glance(self, point: Point) -> tuple[FloatArray, int]:
        """See `Search`."""
        return self.input_of(point)

    def point_of(self, x: FloatArray, row: int) -> Point:
        """See `Search`."""
        return {"values": x.tolist()}

    def beyond(self, point: Point) -> IntArray:
        """See `Search`; in a box the model alone says what is near."""
        return np.empty(0, np.int64)

    def restrict(self, last: Point | None) -> IntArray:
        """See `Search`."""
        self._codec.reach = self._generic.reach(last)
        return np.empty(0, np.int64)
