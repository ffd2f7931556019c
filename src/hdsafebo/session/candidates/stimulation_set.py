"""The stimulations that may be suggested: contact configurations inside the clinical priors, times currents.

A decoded field map takes the nearest stimulation of the set that was not yet tried and is permitted now
(paper, clinical experiment). Methods that search the set itself see each stimulation through the features of
`activating`.
"""

from __future__ import annotations

from functools import cached_property
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from hdsafebo.session.candidates.activating import activating_features, scale_by_current, unit_activation
from hdsafebo.session.candidates.finite_set import FiniteSet
from hdsafebo.session.definition import Priors
from hdsafebo.session.errors import DefinitionError
from hdsafebo.session.log.state import Point
from hdsafebo.session.measuring.stimulator import (
    CONTACTS,
    Envelope,
    Polarity,
    StimulationLimits,
    Stimulator,
)
from hdsafebo.session.spaces.stimulation import CURRENT_COLUMN, arrays
from hdsafebo.spinal.field_map import PIXELS, REFERENCE_CURRENT_MA, field_maps, unit_potentials
from hdsafebo.spinal.nearest import NearestMap
from hdsafebo.typing import FloatArray, IntArray

MAX_CONFIGURATIONS = 100_000
_LEVELS = 2  # currents to either side that count as neighbouring


class SessionStimulationSet(FiniteSet):
    """See the module. Row i * K + k is configuration i at the k-th of K currents.

    Args:
        priors: what may be suggested.
        envelope: hard limits.
        as_maps: inputs are field maps (728 pixels), for an embedding of maps; otherwise the 16
            polarities and the current themselves.

    Raises:
        DefinitionError: the priors leave nothing that the limits permit, or too much to enumerate.
    """

    def __init__(self, priors: Priors, envelope: Envelope, *, as_maps: bool) -> None:
        self._envelope = envelope
        self._fixed: tuple[tuple[Stimulator, StimulationLimits], NDArray[np.bool_]] | None = None
        self._as_maps = as_maps
        self.currents_ma = np.array(priors.currents_ma)
        self.polarity = _usable(enumerate_polarities(priors), envelope, self.currents_ma[0])
        self._index = {tuple(row): i for i, row in enumerate(self.polarity.tolist())}
        unit = np.repeat(unit_activation(self.polarity), len(self.currents_ma), axis=0)
        super().__init__(scale_by_current(unit, np.tile(self.currents_ma, len(self.polarity))))
        strongest = max(envelope.limits.max_current_ma, self.currents_ma[-1])
        if as_maps:
            self.bounds = np.vstack(
                [np.full(PIXELS, 1.0 - strongest / REFERENCE_CURRENT_MA), np.ones(PIXELS)]
            )
        else:
            self.bounds = np.vstack([[-1.0] * CONTACTS + [0.0], [1.0] * CONTACTS + [strongest]])

    def encode_points(self, points: list[Point]) -> FloatArray:
        """Field maps (k, 728), or polarities and currents (k, 17)."""
        polarity, current = arrays(points)
        if self._as_maps:
            return np.asarray(field_maps(unit_potentials(polarity), current))
        return np.column_stack([polarity.astype(float), current])

    def nearest(self, x: FloatArray, taken: IntArray) -> IntArray:
        """(n,) rows whose maps are nearest to the (n, 728) maps `x`, all different and none in `taken`."""
        if not self._as_maps:
            raise DefinitionError("this method searches codes of field maps: give it an embedding of them")
        mine = taken[taken < self.size]
        return np.asarray(self._nearest.query(x, mine)[0], dtype=np.int64)

    def beyond(self, point: Point) -> IntArray:
        """The same contacts at the same current and all higher ones."""
        configuration = self._index.get(tuple(point["polarity"]))
        if configuration is None:
            return np.empty(0, np.int64)
        levels = np.flatnonzero(self.currents_ma >= point[CURRENT_COLUMN])
        return configuration * len(self.currents_ma) + levels

    def neighbours(self, row: int) -> IntArray:
        """At most one contact more or less, and at most two currents higher or lower."""
        point = self.point(row)
        changed = np.abs(self.polarity - np.array(point["polarity"], np.int8)).sum(axis=1)
        level = int(np.searchsorted(self.currents_ma, point[CURRENT_COLUMN]))
        levels = np.arange(max(level - _LEVELS, 0), min(level + _LEVELS + 1, len(self.currents_ma)))
        rows = np.flatnonzero(changed <= 1)[:, None] * len(self.currents_ma) + levels
        return np.asarray(rows.ravel(), np.int64)

    @cached_property
    def _nearest(self) -> NearestMap:
        return NearestMap(unit_potentials(self.polarity), self.currents_ma)

    def _permitted(self, last: Point | None) -> NDArray[np.bool_]:
        within_step = self._envelope.step(
            self.currents_ma, None if last is None else float(last[CURRENT_COLUMN])
        ).within()
        return self._within_fixed_limits & np.tile(within_step, len(self.polarity))

    @property
    def _within_fixed_limits(self) -> NDArray[np.bool_]:
        """(N,) True for rows within every limit that does not depend on the trial before."""
        limits = (self._envelope.stimulator, self._envelope.limits)
        if self._fixed is None or self._fixed[0] != limits:
            self._fixed = limits, self._find_within_fixed_limits()
        return self._fixed[1]

    def _find_within_fixed_limits(self) -> NDArray[np.bool_]:
        polarity = np.repeat(self.polarity, len(self.currents_ma), axis=0)
        highest = float(self.currents_ma[-1])
        return self._envelope.permitted(polarity, np.tile(self.currents_ma, len(self.polarity)), highest)

    def _row_inside(self, point: Point) -> int | None:
        configuration = self._index.get(tuple(point["polarity"]))
        level = np.flatnonzero(self.currents_ma == point[CURRENT_COLUMN])
        if configuration is None or len(level) == 0:
            return None
        return configuration * len(self.currents_ma) + int(level[0])

    def _point_inside(self, row: int) -> Point:
        configuration, level = divmod(row, len(self.currents_ma))
        return {
            "polarity": self.polarity[configuration].tolist(),
            CURRENT_COLUMN: float(self.currents_ma[level]),
        }

    def _features_of(self, points: list[Point]) -> FloatArray:
        polarity, current = arrays(points)
        return activating_features(polarity, current)


def enumerate_polarities(priors: Priors) -> Polarity:
    """All configurations that the priors allow, (n, 16), ordered by poles, cathodes, anodes.

    Raises:
        DefinitionError: too many to enumerate.
    """
    rows: dict[tuple[int, ...], None] = {}
    for poles in priors.poles:
        for cathodes in combinations(range(CONTACTS), poles.cathodes):
            free = [contact for contact in range(CONTACTS) if contact not in cathodes]
            for n_anodes in poles.anodes:
                for anodes in combinations(free, n_anodes):
                    row = [0] * CONTACTS
                    for contact in cathodes:
                        row[contact] = -1
                    for contact in anodes:
                        row[contact] = 1
                    rows[tuple(row)] = None
                    if len(rows) > MAX_CONFIGURATIONS:
                        raise DefinitionError(
                            f"priors.poles allow more than {MAX_CONFIGURATIONS} configurations"
                        )
    return np.array(list(rows), np.int8).reshape(-1, CONTACTS)


def _usable(polarity: Polarity, envelope: Envelope, lowest_ma: float) -> Polarity:
    """Configurations that the limits permit at the lowest current after any trial."""
    ok = envelope.permitted(polarity, np.full(len(polarity), lowest_ma), None)
    if not ok.any():
        raise DefinitionError(
            "the hard limits permit no configuration of priors.poles, not even at the lowest current"
        )
    return polarity[ok]
