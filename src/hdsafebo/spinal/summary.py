"""What the report shows of the stimulation dataset, without its 218,000 rows."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyarrow as pa

from hdsafebo.spinal.activating_function import SIDES
from hdsafebo.spinal.configurations import CONTACTS
from hdsafebo.spinal.field_map import COLUMNS, ROWS, field_maps, unit_potentials
from hdsafebo.spinal.muscles import MUSCLES

_BINS = 80  # of selectivity from -1 to 1
_EXAMPLE = "si_ST_left"


def selectivity_summary(table: pa.Table, threshold: float) -> dict[str, Any]:
    """Plain data for JSON.

    Args:
        table: the dataset, see `dataset.schema`.
        threshold: least g of a safe row.

    Returns:
        rows, threshold, safe_share; edges of bins of selectivity; by muscle, both sides of the body, the
        counts of safe and of unsafe rows in each bin and the largest selectivity of a safe row; as example
        the field map (52 rows of 14 pixels, three decimals) of the safe row that selects the left ST best.
    """
    safe = table["g"].to_numpy() >= threshold
    edges = np.linspace(-1.0, 1.0, _BINS + 1)
    selectivity = {}
    for muscle in MUSCLES:
        values = np.stack([table[f"si_{muscle}_{side}"].to_numpy() for side in SIDES], axis=1)
        counts = {
            name: np.histogram(values[rows], edges)[0].tolist()
            for name, rows in (("safe", safe), ("unsafe", ~safe))
        }
        selectivity[muscle] = counts | {"best_safe": float(values[safe].max()) if safe.any() else None}
    return {
        "rows": len(safe),
        "threshold": threshold,
        "safe_share": float(safe.mean()),
        "edges": edges.tolist(),
        "selectivity": selectivity,
        "example": _example(table, safe) if safe.any() else None,
    }


def _example(table: pa.Table, safe: np.ndarray) -> dict[str, Any]:
    row = int(np.argmax(np.where(safe, table[_EXAMPLE].to_numpy(), -np.inf)))
    polarity = np.array([table[f"contact_{i}"][row].as_py() for i in range(CONTACTS)])
    current = float(table["current"][row].as_py())
    cathodes, anodes = (", ".join(str(i + 1) for i in np.flatnonzero(polarity == sign)) for sign in (-1, 1))
    title = (
        f"cathodes {cathodes}, anodes {anodes}, {current:.3g} mA, the best safe selection of ST on the left"
    )
    pixels = field_maps(unit_potentials(polarity[None]), current)[0].reshape(ROWS, COLUMNS)
    return {"pixels": np.round(pixels, 3).tolist(), "title": title}
