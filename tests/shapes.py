"""Arrays in calls of `hdsafebo.gp` and `hdsafebo.search` have the shapes that their annotations name."""

from __future__ import annotations

import numpy as np
from beartype import BeartypeConf, FrozenDict, beartype
from jaxtyping import install_import_hook

PACKAGES = ("hdsafebo.gp", "hdsafebo.search")

_NUMBERS = FrozenDict(
    {bool: bool | np.bool_, int: int | np.integer, float: float | int | np.integer | np.floating}
)
check = beartype(conf=BeartypeConf(hint_overrides=_NUMBERS))
"""Of each call; NumPy's own numbers are numbers, and a whole number is a float, too."""


def check_shapes() -> None:
    """Have all calls checked; to be called before the packages are imported."""
    install_import_hook(PACKAGES, f"{__name__}.check")
