"""Exact nearest rows against brute force over every map."""

import numpy as np
import pytest

from hdsafebo.errors import DatasetError
from hdsafebo.spinal.configurations import enumerate_configurations
from hdsafebo.spinal.field_map import field_maps, unit_potentials
from hdsafebo.spinal.nearest import NearestMap

LINEAR = np.arange(1, 11) * 0.5
GEOMETRIC = np.geomspace(0.05, 5.0, 10)


@pytest.fixture(scope="module")
def unit() -> np.ndarray:
    return unit_potentials(enumerate_configurations())


@pytest.fixture(scope="module")
def nearest(unit: np.ndarray) -> NearestMap:
    return NearestMap(unit, LINEAR)


def brute_force(
    unit: np.ndarray, currents: np.ndarray, query: np.ndarray, done: np.ndarray
) -> tuple[int, float]:
    """Distances to every row, one current at a time, without any expansion of the square."""
    distance = np.column_stack(
        [np.linalg.norm(query - field_maps(unit, current), axis=1) for current in currents]
    )
    distance = np.where(done.reshape(distance.shape), np.inf, distance).ravel()
    return int(distance.argmin()), float(distance.min())


def queries(unit: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
    """Maps between two configurations, below, within and above the currents, with noise from none to much."""
    first, second = unit[rng.integers(len(unit), size=(2, count))]
    weight, strength = rng.random((count, 1)), rng.uniform(0.0, 1.2, (count, 1))
    noise = rng.choice([0.0, 1e-4, 1e-2, 1.0], (count, 1)) * rng.standard_normal((count, unit.shape[1]))
    return 1 + strength * (weight * first + (1 - weight) * second) + noise


@pytest.mark.parametrize("currents", [LINEAR, GEOMETRIC], ids=["linear", "geometric"])
def test_equals_brute_force_over_all_rows(unit: np.ndarray, currents: np.ndarray) -> None:
    rng = np.random.default_rng(1)
    searched = NearestMap(unit, currents)
    maps = queries(unit, 6, rng)
    done = rng.random(len(searched)) < 0.3
    rows, distances = searched.query(maps, done, exclude_within_batch=False)
    for query, row, distance in zip(maps, rows, distances, strict=True):
        expected = brute_force(unit, currents, query, done)
        assert (row, distance) == (expected[0], pytest.approx(expected[1], abs=1e-7))


def test_equals_brute_force_on_a_thousand_queries(unit: np.ndarray, nearest: NearestMap) -> None:
    rng = np.random.default_rng(2)
    maps = queries(unit, 1000, rng)
    done = rng.random(len(nearest)) < 0.5
    rows, distances = nearest.query(maps, done, exclude_within_batch=False)
    strength = LINEAR / 5
    scale = strength**2 * np.einsum("ij,ij->i", unit, unit)[:, None]
    for query, row, distance in zip(maps - 1, rows, distances, strict=True):
        square = scale - 2 * strength * (unit @ query)[:, None] + query @ query
        square[done.reshape(square.shape)] = np.inf
        # the expansion narrows the search to a band far wider than its rounding error, subtraction decides
        near = np.flatnonzero(square <= square.min() + 1e-9 * (1 + query @ query))
        exact = np.linalg.norm(strength[near % 10, None] * unit[near // 10] - query, axis=1)
        assert row == near[exact.argmin()]
        assert distance == pytest.approx(exact.min(), abs=1e-6)


def test_every_map_finds_itself(unit: np.ndarray, nearest: NearestMap) -> None:
    rows = np.random.default_rng(3).choice(len(nearest), 300, replace=False)
    maps = nearest.maps(rows)
    np.testing.assert_allclose(maps, field_maps(unit[rows // 10], LINEAR[rows % 10]), atol=1e-15)
    found, distance = nearest.nearest_rows(maps)
    np.testing.assert_array_equal(found, rows)
    assert distance.max() < 1e-6


def test_a_batch_never_returns_a_row_twice(unit: np.ndarray, nearest: NearestMap) -> None:
    same = np.repeat(field_maps(unit[7], 2.5)[None], 30, axis=0)
    rows, distances = nearest.query(same)
    assert len(set(rows.tolist())) == 30
    assert rows[0] == 74
    assert (np.diff(distances) >= -1e-9).all()
    np.testing.assert_array_equal(nearest.query(same, exclude_within_batch=False)[0], np.full(30, 74))


def test_evaluated_rows_as_numbers_or_as_mask(unit: np.ndarray, nearest: NearestMap) -> None:
    query = field_maps(unit[7:8], 2.5)
    mask = np.zeros(len(nearest), dtype=bool)
    mask[[74, 73]] = True
    by_mask, by_rows = nearest.query(query, mask), nearest.query(query, [74, 73])
    assert by_mask == by_rows
    assert by_mask[0][0] not in (73, 74)
    assert mask.sum() == 2  # the caller's mask is left alone


def test_the_last_row_left_is_found_and_then_none(unit: np.ndarray, nearest: NearestMap) -> None:
    mask = np.ones(len(nearest), dtype=bool)
    mask[123_456] = False
    query = field_maps(unit[:1], 1.0)
    assert nearest.query(query, mask)[0][0] == 123_456
    with pytest.raises(DatasetError, match="all 218000 rows are evaluated"):
        nearest.query(np.repeat(query, 2, axis=0), mask)


def test_one_configuration_and_one_current() -> None:
    rows, distances = NearestMap([[3.0, 4.0]], [5.0]).nearest_rows([[1.0, 1.0]])
    assert rows.tolist() == [0]
    assert distances.tolist() == [5.0]


def test_no_queries_no_rows(nearest: NearestMap) -> None:
    assert nearest.query(np.empty((0, 728)))[0].shape == (0,)


@pytest.mark.parametrize(
    ("unit_maps", "currents", "message"),
    [
        (np.ones(3), LINEAR, r"unit_maps have shape \(3,\)"),
        (np.full((2, 3), np.nan), LINEAR, "NaN"),
        (np.zeros((2, 3)), LINEAR, "zero everywhere"),
        (np.ones((2, 3)), [1.0, 1.0], "increasing"),
        (np.ones((2, 3)), [0.0, 1.0], "positive"),
        (np.ones((2, 3)), [], "currents"),
    ],
)
def test_bad_tables_are_refused(unit_maps: np.ndarray, currents: np.ndarray, message: str) -> None:
    with pytest.raises(DatasetError, match=message):
        NearestMap(unit_maps, currents)


def test_bad_queries_are_refused(nearest: NearestMap) -> None:
    with pytest.raises(DatasetError, match=r"expected \(n, 728\)"):
        nearest.query(np.ones((1, 727)))
    with pytest.raises(DatasetError, match="NaN"):
        nearest.query(np.full((1, 728), np.nan))
    with pytest.raises(DatasetError, match="218000"):
        nearest.query(np.ones((1, 728)), [218_000])
    with pytest.raises(DatasetError, match="rows reach from -1 to 5, expected 0 to 217999"):
        nearest.maps([-1, 5])
    with pytest.raises(DatasetError, match="dtype float64, expected row numbers or a mask"):
        nearest.query(np.ones((1, 728)), [0.5])
    with pytest.raises(DatasetError, match="mask of 3 rows"):
        nearest.query(np.ones((1, 728)), np.ones(3, dtype=bool))
