"""Lead fields of the cord: reciprocity, conservation, and files that are what they claim."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.sparse import diags

from hdsafebo.spinal.finite_elements.lead_field import LeadField, Solution
from hdsafebo.spinal.finite_elements.solver import LeadFieldError, conjugate_gradients
from hdsafebo.spinal.geometry.anatomy import Anatomy


def test_reciprocity(coarse_solution: Solution) -> None:
    assert coarse_solution.reciprocity_error <= 1e-6


def test_current_leaving_is_current_injected(coarse_solution: Solution) -> None:
    assert coarse_solution.outflow.shape == (16,)
    assert coarse_solution.current_error <= 1e-6


def test_a_contact_feels_itself_most_and_near_ones_more_than_far_ones(coarse_solution: Solution) -> None:
    resistance = coarse_solution.resistance
    assert np.all(np.argmax(resistance, axis=1) == np.arange(16))
    lateral = resistance[0, :8]
    assert np.all(np.diff(lateral) < 0)
    assert resistance.min() > 0


def test_medial_contacts_reach_the_left_cord_more_than_the_right(coarse_field: LeadField) -> None:
    section = np.abs(coarse_field.z - 55.5).argmin()
    x, y = coarse_field.section_nodes
    left, right = (np.argmin(np.hypot(x - s * 3.0, y - 1.0)) for s in (-1, 1))
    assert coarse_field.potential[section, left, 12] > coarse_field.potential[section, right, 12]


def test_conjugate_gradients_solve_and_say_when_they_cannot() -> None:
    rng = np.random.default_rng(3)
    matrix = diags([np.linspace(1, 50, 80), np.full(79, 0.3), np.full(79, 0.3)], [0, 1, -1]).tocsr()
    loads = rng.normal(size=(80, 3))
    found, iterations = conjugate_gradients(matrix, loads, lambda r: r, 1e-10, "test")
    np.testing.assert_allclose(matrix @ found, loads, atol=1e-8)
    assert iterations < 80
    stiff = diags([np.geomspace(1, 1e12, 3000)], [0]).tocsr()
    with pytest.raises(
        LeadFieldError, match=r"relative residual of .* after 200 iterations, expected 1.0e-10"
    ):
        conjugate_gradients(stiff, rng.normal(size=(3000, 2)), lambda r: r, 1e-10, "test")
    broken = matrix.copy()
    broken.data[5] = np.nan
    with pytest.raises(LeadFieldError, match="not finite after 1 iterations"):
        conjugate_gradients(broken, loads, lambda r: r, 1e-10, "test")


def test_files_round_trip(coarse_field: LeadField, tmp_path: Path) -> None:
    path = tmp_path / "lead_field.npz"
    coarse_field.save(path)
    loaded = LeadField.load(path)
    np.testing.assert_array_equal(loaded.triangles, coarse_field.triangles)
    np.testing.assert_array_equal(loaded.tissues, coarse_field.tissues)
    np.testing.assert_allclose(loaded.potential, coarse_field.potential, rtol=1e-6)
    again = tmp_path / "again.npz"
    coarse_field.save(again)
    assert path.read_bytes() == again.read_bytes()


def test_missing_and_damaged_files_are_refused(coarse_field: LeadField, tmp_path: Path) -> None:
    with pytest.raises(LeadFieldError, match="no such file"):
        LeadField.load(tmp_path / "none.npz")
    path = tmp_path / "lead_field.npz"
    path.write_bytes(b"PK\x03\x04 not a zip")
    with pytest.raises(LeadFieldError, match="not a lead field"):
        LeadField.load(path)
    coarse_field.save(path)
    arrays = dict(np.load(path))
    np.savez(path, **{k: v for k, v in arrays.items() if k != "potential"})
    with pytest.raises(LeadFieldError, match="not a lead field"):
        LeadField.load(path)
    np.savez(path, **arrays | {"potential": arrays["potential"][:, :, :15]})
    with pytest.raises(LeadFieldError, match="potential has shape"):
        LeadField.load(path)
    np.savez(path, **arrays | {"z": np.full_like(arrays["z"], np.nan)})
    with pytest.raises(LeadFieldError, match="z has shape"):
        LeadField.load(path)


def test_pickled_objects_are_never_loaded(coarse_field: LeadField, tmp_path: Path) -> None:
    path = tmp_path / "lead_field.npz"
    coarse_field.save(path)
    np.savez(path, **dict(np.load(path)) | {"tissues": np.array([{"a": 1}], dtype=object)})
    with pytest.raises(LeadFieldError, match=r"not a lead field.*allow_pickle"):
        LeadField.load(path)


def test_lead_fields_of_another_anatomy_are_refused(coarse_field: LeadField) -> None:
    coarse_field.require(Anatomy())
    with pytest.raises(LeadFieldError, match="other segments than the parameters have; solve them again"):
        coarse_field.require(Anatomy().overridden({"length_L3": 12.0}))
    with pytest.raises(LeadFieldError, match="other contacts"):
        coarse_field.require(Anatomy().overridden({"paddle_rostral_edge": 30.0}))
