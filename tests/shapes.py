"""Arrays in calls of `hdsafebo.gp` and `hdsafebo.search` have the shapes that their annotations name."""

from __future__ import annotations

from beartype import BeartypeConf, beartype
from jaxtyping import install_import_hook

PACKAGES = ("hdsafebo.gp", "hdsafebo.search")

check = beartype(conf=BeartypeConf(is_pep484_tower=True))
"""Of each call; a whole number is a float, too."""


def check_shapes() -> None:
    """Have all calls checked; to be called before the packages are imported."""
    install_import_hook(PACKAGES, f"{__name__}.check")
