"""Figures of a study, as functions that return matplotlib figures: `figure.savefig("progress.png")`.

What may live here: figures that need nothing but a `Study`. They read it and change nothing.
"""

from __future__ import annotations

from hdsafebo.plots.calibration import calibration
from hdsafebo.plots.parallel import parallel
from hdsafebo.plots.progress import progress
from hdsafebo.plots.slices import slice_map, slices

__all__ = ["calibration", "parallel", "progress", "slice_map", "slices"]
