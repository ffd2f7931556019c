"""Districts, neighbours, selectivity and safety by their definitions."""

from __future__ import annotations

import numpy as np
import pytest

from hdsafebo.errors import AnatomyError, UnknownNameError
from hdsafebo.spinal.geometry.anatomy import Anatomy
from hdsafebo.spinal.muscles import MUSCLES, districts, neighbours, safety, selectivity


def test_districts_follow_the_segments() -> None:
    anatomy = Anatomy()
    found = districts(anatomy)
    assert tuple(found) == ("IL", "VL&RF", "TA", "BF&GM", "ST", "GA")
    assert found["IL"] == (anatomy.place("L1", end=False), anatomy.place("L3", end=True))
    assert found["ST"] == (anatomy.place("mid-L4", end=False), anatomy.place("S1", end=True))
    changed = districts(anatomy, {"GA": ["S1", "S1"]})
    assert changed["GA"] == (anatomy.place("S1", end=False), anatomy.place("S1", end=True))


def test_neighbours_are_the_overlapping_pools() -> None:
    assert neighbours(districts(Anatomy())) == {
        "IL": ("VL&RF",),
        "VL&RF": ("IL", "TA", "ST"),
        "TA": ("VL&RF", "BF&GM", "ST"),
        "BF&GM": ("TA", "ST", "GA"),
        "ST": ("VL&RF", "TA", "BF&GM", "GA"),
        "GA": ("BF&GM", "ST"),
    }


def test_pools_that_only_touch_are_no_neighbours() -> None:
    found = neighbours({"a": (0.0, 2.0), "b": (1.0, 3.0), "c": (2.0, 4.0)})
    assert found == {"a": ("b",), "b": ("a", "c"), "c": ("b",)}
    with pytest.raises(AnatomyError, match="district of c overlaps with no other"):
        neighbours({"a": (0.0, 2.0), "b": (1.0, 3.0), "c": (4.0, 5.0)})


def test_selectivity_is_the_papers_formula_on_each_side() -> None:
    rng = np.random.default_rng(5)
    mu = rng.uniform(size=(7, 6, 2))
    adjacent = neighbours(districts(Anatomy()))
    si = selectivity(mu, adjacent)
    for i, muscle in enumerate(MUSCLES):
        for side in (0, 1):
            others = [mu[:, MUSCLES.index(n), side] for n in adjacent[muscle]]
            np.testing.assert_allclose(si[:, i, side], mu[:, i, side] - np.mean(others, axis=0))


def test_selectivity_has_the_papers_extremes() -> None:
    adjacent = neighbours(districts(Anatomy()))
    assert np.all(selectivity(np.full((6, 2), 0.4), adjacent) == pytest.approx(0.0))
    only = np.zeros((6, 2))
    only[4] = 1.0
    assert np.all(selectivity(only, adjacent)[4] == 1.0)
    assert np.all(selectivity(1.0 - only, adjacent)[4] == pytest.approx(-1.0))


def test_safety_is_one_minus_the_largest_activation_on_either_side() -> None:
    mu = np.zeros((2, 6, 2))
    mu[0, 2, 1], mu[1, 5, 0] = 0.3, 0.97
    np.testing.assert_allclose(safety(mu), [0.7, 0.03])


def test_unknown_muscles_and_backward_districts_are_refused() -> None:
    with pytest.raises(UnknownNameError, match="unknown muscle 'SOL'; valid names: BF&GM, GA, IL"):
        districts(Anatomy(), {"SOL": ["L5", "S1"]})
    with pytest.raises(UnknownNameError, match="unknown segment 'L6'"):
        districts(Anatomy(), {"GA": ["L6", "S1"]})
    with pytest.raises(AnatomyError, match=r"district of GA runs from S2 .* to S1"):
        districts(Anatomy(), {"GA": ["S2", "S1"]})
