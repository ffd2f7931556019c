"""Files of lead fields are what they claim."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from hdsafebo.spinal.geometry.anatomy import Anatomy
from hdsafebo.spinal.lead_field import LeadField, LeadFieldError


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
