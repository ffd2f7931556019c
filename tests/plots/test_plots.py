"""Figures show what the study holds; they change nothing."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure
from system.small import mixed_starts, mixed_system, run_mixed

from hdsafebo import Study, plots
from hdsafebo.errors import NoSafePointError
from hdsafebo.plots.calibration import wilson
from hdsafebo.system.errors import TableError


@pytest.fixture(scope="module")
def study() -> Study:
    """A mixed study with initial, suggested, failed and pending trials."""
    made = Study(mixed_system(), alpha=0.9)
    made.observe(mixed_starts())
    for number in range(4):
        suggestion = made.ask(context={"load": 1.0})
        if number == 2:
            made.tell(suggestion, failed=True)
        else:
            made.tell(suggestion, run_mixed(suggestion.setting, suggestion.context))
    made.ask(context={"load": 1.0})
    return made


def drawn_points(figure: Figure, panel: int = 0) -> int:
    return sum(len(c.get_offsets()) for c in figure.axes[panel].collections if c.get_label()[0] != "_")


def test_progress_has_a_mark_per_trial_and_the_best_safe_line(study: Study) -> None:
    figure = plots.progress(study)
    table = study.to_dataframe()
    done = table[table["status"] == "completed"]
    finite = sum(
        np.isfinite(np.asarray(c.get_offsets(), float)).all(axis=1).sum() for c in figure.axes[0].collections
    )
    assert finite == len(done)
    assert len(figure.axes) == 3
    assert figure.axes[1].get_ylabel() == "heat (C)"
    (line,) = [x for x in figure.axes[0].lines if x.get_label() == "best safe"]
    assert np.nanmin(line.get_ydata()) == done["error"][done["safe"]].min()


def test_slices_show_the_predictions(study: Study) -> None:
    figure = plots.slices(study, ["pulses", "pad"])
    best = study.best()
    assert best is not None
    setting = best.believed.setting
    (mean,) = [x for x in figure.axes[0].lines if len(x.get_xdata()) == 8]
    believed = study.predict({k: [v] * 8 for k, v in setting.items()} | {"pulses": list(range(1, 9))})
    np.testing.assert_allclose(mean.get_ydata(), believed["error"])
    (safe,) = [x for x in figure.axes[2].lines if len(x.get_xdata()) == 8]
    np.testing.assert_allclose(safe.get_ydata(), believed["safe_probability"])
    assert [t.get_text() for t in figure.axes[3].get_xticklabels()] == ["soft", "ribbed", "hard"]


def test_map_shows_the_predictions(study: Study) -> None:
    figure = plots.slice_map(study, "frequency", "angle", context={"load": 2.0})
    assert figure.axes[0].get_xscale() == "log"
    (mesh,) = [c for c in figure.axes[1].collections if type(c).__name__ == "QuadMesh"]
    assert 0 <= mesh.get_array().min() <= mesh.get_array().max() <= 1
    with pytest.raises(TableError, match="pad is no number"):
        plots.slice_map(study, "pad", "angle")
    with pytest.raises(TableError, match="'angel' is no parameter that varies"):
        plots.slice_map(study, "frequency", "angel")


def test_calibration_counts_suggestions_with_results(study: Study) -> None:
    figure = plots.calibration(study)
    assert figure.axes[0].get_title() == "4 suggestions"
    assert sum(int(t.get_text()) for t in figure.axes[0].texts) == 4


@pytest.mark.parametrize(("share", "n", "low", "high"), [(0.5, 10, 0.237, 0.763), (1.0, 10, 0.722, 1.0)])
def test_wilson_interval(share: float, n: int, low: float, high: float) -> None:
    assert wilson(share, n) == pytest.approx((low, high), abs=1e-3)


def test_parallel_coordinates_have_a_line_per_trial(study: Study) -> None:
    figure = plots.parallel(study)
    lines = [x for x in figure.axes[0].lines if len(x.get_xdata()) == 6]
    assert len(lines) == 24


def test_figures_change_nothing_and_can_be_written(study: Study, tmp_path) -> None:
    before, generator = study.to_dataframe(), study.optimizer.rng.bit_generator.state
    for name in ("progress", "slices", "calibration", "parallel"):
        getattr(plots, name)(study).savefig(tmp_path / f"{name}.png")
    pd.testing.assert_frame_equal(study.to_dataframe(), before)
    assert study.optimizer.rng.bit_generator.state == generator


def test_without_a_safe_trial_the_place_must_be_said() -> None:
    unsafe = Study(mixed_system(), alpha=0.9)
    unsafe.observe([r | {"heat": 99.0} for r in mixed_starts()])
    with pytest.raises(NoSafePointError, match="say with `at`"):
        plots.slices(unsafe)
    at = {k: mixed_starts()[0][k] for k in ("frequency", "angle", "pulses", "pad")} | {"gap": 3}
    assert plots.slices(unsafe, ["angle"], at=at, context={"load": 1.0}).axes
