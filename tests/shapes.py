"""Arrays in calls of `hdsafebo.gp` and `hdsafebo.search` have the shapes that their annotations name."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from beartype import BeartypeConf, FrozenDict, beartype
from jaxtyping import config, install_import_hook

PACKAGES = ("hdsafebo.gp", "hdsafebo.search")

_NUMBERS = FrozenDict(
    {bool: bool | np.bool_, int: int | np.integer, float: float | int | np.integer | np.floating}
)
check = beartype(conf=BeartypeConf(hint_overrides=_NUMBERS))
"""Of each call; NumPy's own numbers are numbers, and a whole number is a float, too."""


CHECKED = ("gp", "search", "test_shapes.py", "optimizers/test_registry.py")
"""Tests during which calls are checked: those of both packages, and a round of each method. Checks cost two
to four times the CPU time of the calls, so other tests, which make the same calls, go without."""


def check_shapes() -> None:
    """Have calls checked; to be called before the packages are imported."""
    install_import_hook(PACKAGES, f"{__name__}.check")


def checking(test: Path) -> None:
    """Check calls during a test, or leave them unchecked, by the file that the test is in."""
    here = test.relative_to(Path(__file__).parent)
    checked = any(here.is_relative_to(place) for place in CHECKED)
    config.update("jaxtyping_disable", not checked)
