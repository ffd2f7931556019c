"""The pictures show what their data say."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from hdsafebo.spinal.dataset import to_table
from hdsafebo.spinal.figures import (
    activating_figure,
    bipole,
    mesh_figure,
    potential_figure,
    save_figure,
    selectivity_figure,
)
from hdsafebo.spinal.geometry.anatomy import Anatomy
from hdsafebo.spinal.lead_field import LeadField
from hdsafebo.spinal.muscles import districts
from hdsafebo.spinal.traversal import Traversal


def test_mesh_and_potential_are_drawn_and_saved_reproducibly(coarse_field: LeadField, tmp_path: Path) -> None:
    paths = [tmp_path / "a.png", tmp_path / "b.png"]
    for path in paths:
        save_figure(mesh_figure(coarse_field), path)
    assert paths[0].read_bytes() == paths[1].read_bytes()
    assert paths[0].stat().st_size > 10_000
    axes = potential_figure(coarse_field, bipole(12, 14), 1.0).axes[0]
    assert "1 mA" in axes.get_title()


def test_activating_function_is_largest_at_the_cathode(coarse_field: LeadField) -> None:
    figure = activating_figure(coarse_field, bipole(12, 14), 2.0, districts(Anatomy()))
    line = figure.axes[0].lines[0]
    z, values = (np.asarray(c) for c in line.get_data())
    assert abs(z[np.argmax(values)] - coarse_field.contacts[12, 1]) < 2.0
    assert [t.get_text() for t in figure.axes[1].texts] == list(districts(Anatomy()))


def test_every_row_is_in_the_histograms(traversal: Traversal) -> None:
    figure = selectivity_figure(to_table(traversal), "left", 0.05)
    axes = [a for a in figure.axes if a.get_title()]
    assert len(axes) == 6
    for a in axes:
        tops = {}
        for patch in a.patches:
            tops[round(patch.get_x(), 4)] = max(
                tops.get(round(patch.get_x(), 4), 0), patch.get_y() + patch.get_height()
            )
        assert sum(tops.values()) == 218_000
