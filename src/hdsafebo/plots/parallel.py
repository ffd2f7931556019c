"""All trials at once, one axis per parameter."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from hdsafebo.plots.style import FAILED, UNSAFE, done, labelled, new_figure, varying
from hdsafebo.system.parameters import Choice, Real
from hdsafebo.system.study import Study

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def parallel(study: Study) -> Figure:
    """Parallel coordinates: one line per trial through its parameters and contexts to its objective.

    Safe trials have the colour of their objective, unsafe ones are orange, failed ones grey and dashed.
    """
    from matplotlib import colormaps
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    table = done(study.to_dataframe())
    parts = [*varying(study), *study.system.contexts]
    objective = study.system.objective
    figure = new_figure(1.5 + 1.15 * (len(parts) + 1), 3.8)
    axes = figure.subplots()
    heights = [p.encode(p.check(table[p.name].tolist()))[:, 0] for p in parts if isinstance(p, Real)]
    columns = {p.name: h for p, h in zip([p for p in parts if isinstance(p, Real)], heights, strict=True)}
    for part in parts:
        if isinstance(part, Choice):
            columns[part.name] = part.check(table[part.name].tolist()) / (len(part.values) - 1)
    values = table[objective.name].to_numpy()
    low, high = (np.nanmin(values), np.nanmax(values)) if np.isfinite(values).any() else (0.0, 1.0)
    norm = Normalize(low, high if high > low else low + 1.0)
    colours = colormaps["viridis" if objective.sign > 0 else "viridis_r"]
    lines = np.column_stack([columns[p.name] for p in parts] + [norm(values)])
    for line, outcome, value in zip(lines, table["outcome"], values, strict=True):
        if outcome == "safe":
            axes.plot(line, color=colours(norm(value)), linewidth=1.1, alpha=0.85, zorder=2)
        else:
            failed = outcome == "failed"
            axes.plot(
                line,
                color=FAILED if failed else UNSAFE,
                linewidth=0.9,
                alpha=0.7,
                zorder=1,
                linestyle="--" if failed else "-",
            )
    names = [*map(labelled, parts), labelled(objective)]
    axes.set_xticks(range(len(names)), names, rotation=25, ha="right", fontsize="small")
    axes.set_yticks([])
    axes.set_ylim(-0.06, 1.06)
    for j, part in enumerate(parts):
        axes.axvline(j, color="#BBBBBB", linewidth=0.7, zorder=0)
        ends = (part.values[0], part.values[-1]) if isinstance(part, Choice) else (part.lower, part.upper)  # type: ignore[union-attr]
        for y, end, side in ((-0.02, ends[0], "top"), (1.02, ends[1], "bottom")):
            text = f"{end:g}" if isinstance(end, float) else str(end)
            axes.text(j, y, text, ha="center", va=side, fontsize="x-small")
    axes.axvline(len(parts), color="#BBBBBB", linewidth=0.7, zorder=0)
    figure.colorbar(ScalarMappable(norm, colours), ax=axes, label=labelled(objective))
    for side in ("top", "right", "left", "bottom"):
        axes.spines[side].set_visible(False)
    return figure
