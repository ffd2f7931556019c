"""The activating function of potentials whose second difference is known, at points that share the volume."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from hdsafebo.errors import AnatomyError
from hdsafebo.spinal.activating_function import (
    ActivatingFunction,
    along_fibres,
    cord_areas,
    equal_volume_heights,
    sample,
)
from hdsafebo.spinal.geometry.anatomy import Anatomy
from hdsafebo.spinal.lead_field import LeadField

FIBRES = np.array([[0.5, 1.0], [-2.0, -1.0]])
Z = np.linspace(20.0, 88.0, 30)


def with_potential(field: LeadField, values: np.ndarray) -> LeadField:
    """The field with one contact whose potential depends on z only, shape (slices,)."""
    potential = np.broadcast_to(values[:, None, None], (*field.x.shape, 1))
    return replace(field, potential=potential, contacts=field.contacts[:1])


def test_a_parabola_has_a_constant_activating_function(coarse_field: LeadField) -> None:
    field = with_potential(coarse_field, 0.7 * coarse_field.z**2 - 3 * coarse_field.z)
    np.testing.assert_allclose(along_fibres(field, FIBRES, Z), 1.4, rtol=1e-9)


def test_a_wave_has_the_closed_form_of_its_second_difference(coarse_field: LeadField) -> None:
    k = 2 * np.pi / 30
    field = with_potential(coarse_field, np.cos(k * coarse_field.z))
    expected = -2 * (1 - np.cos(k)) * np.cos(k * Z)  # nodes 1 mm apart
    np.testing.assert_allclose(along_fibres(field, FIBRES, Z)[0], expected[:, None] * [1, 1], atol=2e-4)


def test_slices_share_the_volume(coarse_field: LeadField) -> None:
    z = equal_volume_heights(coarse_field, 18.0, 90.0, 36)
    spacing = np.gradient(z)
    area = np.interp(z, coarse_field.z, cord_areas(coarse_field))
    volume = (spacing * area)[1:-1]  # the gradient is one-sided at the ends
    np.testing.assert_allclose(volume, volume.mean(), rtol=0.02)
    assert 18.0 < z[0] < z[-1] < 90.0


def test_cord_area_is_that_of_its_ellipse(coarse_field: LeadField) -> None:
    l3 = Anatomy().segments[3]
    z = (Anatomy().place("L3", end=False) + Anatomy().place("L3", end=True)) / 2
    area = np.interp(z, coarse_field.z, cord_areas(coarse_field))
    assert area == pytest.approx(np.pi * l3.width * l3.depth / 4, rel=0.03)


def test_points_fill_the_half_section(activating: ActivatingFunction) -> None:
    anatomy = Anatomy()
    x, y = activating.points.T
    assert (x > 0).all()
    assert len(x) * 0.9**2 == pytest.approx(np.pi * anatomy.half_width * anatomy.half_depth / 2, rel=0.06)
    assert np.hypot(x / anatomy.half_width, y / anatomy.half_depth).max() < 1
    assert sorted(zip(x, y, strict=True)) == sorted(zip(x, -y, strict=True)) or y.mean() == pytest.approx(
        0, abs=0.1
    )


def test_left_contacts_excite_the_left_more(activating: ActivatingFunction) -> None:
    left, right = np.abs(activating.unit).max(axis=(2, 3)).T
    assert np.all(left >= right)


def test_sampling_beyond_the_model_or_the_cord_is_refused(coarse_field: LeadField) -> None:
    with pytest.raises(AnatomyError, match="cannot sample from 18 to 200 mm"):
        sample(coarse_field, 18.0, 200.0, 0.9, 10)
    with pytest.raises(AnatomyError, match="a sample spacing of 20 mm leaves no point"):
        sample(coarse_field, 18.0, 90.0, 20.0, 10)
