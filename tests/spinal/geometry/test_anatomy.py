"""The anatomy is a table that can be changed, and an impossible one is refused by name."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from hdsafebo.errors import AnatomyError, UnknownNameError
from hdsafebo.spinal.field_map import COLUMNS, contact_pixels
from hdsafebo.spinal.geometry.anatomy import GREY_OUTLINE, Anatomy
from hdsafebo.spinal.geometry.anatomy_check import check_anatomy


def test_default_anatomy_is_possible() -> None:
    check_anatomy(Anatomy())


def test_segments_cover_the_cord_without_gaps() -> None:
    anatomy = Anatomy()
    names = [s.name for s in anatomy.segments]
    assert names == ["T12", "L1", "L2", "L3", "L4", "L5", "S1", "S2"]
    for first, second in pairwise(names):
        assert anatomy.place(first, end=True) == anatomy.place(second, end=False)
    assert anatomy.place("mid-L4", end=False) == pytest.approx(56.0 + 5.0)


def test_dorsal_fluid_is_within_the_measured_range() -> None:
    anatomy = Anatomy()
    for segment in anatomy.segments[
        :2
    ]:  # cord segments near the T12 vertebra: 1.5 to 4.5 mm (Holsheimer 1994)
        assert 1.5 <= (anatomy.sac_depth - segment.depth) / 2 <= 4.5


def test_grey_outline_lies_inside_the_cord() -> None:
    x, y = np.array(GREY_OUTLINE).T
    assert (x >= 0).all()
    assert (np.hypot(x, y) < 1).all()


def test_contacts_are_where_the_field_map_paints_them() -> None:
    anatomy = Anatomy()
    row, column = np.divmod(contact_pixels(), COLUMNS)
    x = column.mean(axis=1) + 0.5 - anatomy.paddle_width / 2
    z = row.mean(axis=1) + 0.5 + anatomy.paddle_rostral_edge
    np.testing.assert_allclose(anatomy.contacts(), np.stack([x, z], axis=1))
    assert (anatomy.contacts()[:, 0] < 0).all()


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"width_L3": 18.0}, "cord at L3 .* does not fit its sac"),
        ({"depth_S1": 15.0}, "cord at S1 .* does not fit its sac"),
        ({"sac_width": 26.0}, "sac .* does not fit the canal"),
        ({"paddle_thickness": 4.0}, "paddle .* does not fit the canal"),
        ({"paddle_length": 40.0}, r"contact 7 at x = -4.5, z = 70.5 mm lies off the paddle"),
        ({"canal_depth": 70.0}, "does not fit the body"),
        ({"caudal_end": 80.0}, "does not hold cord and paddle"),
        ({"dura": 0.0}, "dura is 0 mm, expected more than 0"),
        ({"length_L2": -1.0}, "segment L2"),
        ({"sac_depth": float("nan")}, "sac_depth is nan"),
    ],
)
def test_impossible_anatomies_are_refused(values: dict[str, float], message: str) -> None:
    with pytest.raises(AnatomyError, match=message):
        check_anatomy(Anatomy().overridden(values))


def test_unknown_names_are_refused() -> None:
    with pytest.raises(UnknownNameError, match=r"unknown dimension of the anatomy 'width_L9'.*width_L5"):
        Anatomy().overridden({"width_L9": 9.0})
    with pytest.raises(UnknownNameError, match="unknown segment 'L7'"):
        Anatomy().place("L7", end=True)
