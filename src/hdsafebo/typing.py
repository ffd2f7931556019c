"""Array types, named once."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, get_args

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

if TYPE_CHECKING:
    from typing import Annotated as Shaped
else:

    class Shaped:
        """`Shaped[FloatArray, "n d"]`: an array whose dimensions have names, equal ones of equal length.

        Annotations are not evaluated when the package is used. The tests evaluate those of `gp` and `search`
        and check every call (`tests/shapes.py`). A single name has a space before it, lest linters take it
        for that of a type.
        """

        def __class_getitem__(cls, item: tuple[Any, str]) -> Any:
            import jaxtyping

            kind, dimensions = item
            (number,) = get_args(get_args(kind)[1])
            checks = {np.float64: jaxtyping.Float64, np.int64: jaxtyping.Int64, np.bool_: jaxtyping.Bool}
            return checks[number][np.ndarray, dimensions.strip()]
