"""Pictures of what the tasks are built on: distances, selectivity, field maps, synergies, training."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from hdsafebo.report.data.inputs import Selectivity, Stimulation
from hdsafebo.report.data.methods import BLUE, ORANGE, SKY, VERMILLION
from hdsafebo.report.figures.panels import Figure, Line, Panel


def distance_figure(distances: dict[str, pd.DataFrame], correlations: dict[str, float]) -> Figure:
    """Pairwise distances of field maps before and after encoding, one panel per embedding."""
    panels = [_distance_panel(name, table, correlations.get(name)) for name, table in distances.items()]
    caption = (
        "Distances of pairs of field maps, between the maps (across) and between their codes (up). A "
        "straight line through the origin is scaled isometry; r is the linear correlation."
    )
    return Figure("pairwise_distances", caption, [panels[i : i + 3] for i in range(0, len(panels), 3)])


def _distance_panel(name: str, table: pd.DataFrame, correlation: float | None) -> Panel:
    x, z = table["original"].to_numpy(float), table["latent"].to_numpy(float)

    def draw(ax: Any) -> None:
        ax.hexbin(x, z, gridsize=45, mincnt=1, cmap="Greys", bins="log", linewidths=0.1, vmin=0.5)
        scale = float(x @ z / (x @ x))
        ax.plot([0, x.max()], [0, scale * x.max()], color=VERMILLION, linewidth=1.1, linestyle=(0, (5, 2)))
        suffix = "" if correlation is None else f", r = {correlation:.4f}"
        ax.set_title(f"{name}{suffix}", loc="left")
        ax.set_xlabel("distance between maps")
        ax.set_ylabel("distance between codes")

    return Panel(f"{name}: distances between maps and between codes", draw, inches=(3.7, 3.0))


def selectivity_figure(found: Stimulation) -> Figure:
    """Distribution of the selectivity index of every muscle group, safe and unsafe parameters apart."""
    edges = np.array(found.edges)
    panels = [_selectivity_panel(muscle, counts, edges) for muscle, counts in found.selectivity.items()]
    caption = (
        "Selectivity index over all stimulation parameters, both sides of the body, on a logarithmic "
        "count; the best safe value is marked."
    )
    return Figure("selectivity_distribution", caption, [panels[i : i + 3] for i in range(0, len(panels), 3)])


def _selectivity_panel(muscle: str, counts: Selectivity, edges: NDArray[np.float64]) -> Panel:
    def draw(ax: Any) -> None:
        ax.stairs(counts.unsafe, edges, fill=True, color=ORANGE, alpha=0.55, label="unsafe")
        ax.stairs(counts.safe, edges, color=BLUE, linewidth=1.4, label="safe")
        ax.set_yscale("log", nonpositive="clip")
        best = counts.best_safe
        if best is not None:
            ax.axvline(best, color="#000000", linewidth=1, linestyle=(0, (2, 2)))
            ax.annotate(
                f"{best:.2f}",
                (best, 1),
                (3, -2),
                xycoords=("data", "axes fraction"),
                textcoords="offset points",
                va="top",
            )
        ax.set_title(f"{muscle}: count over selectivity", loc="left")
        ax.legend(loc="upper left")

    return Panel(f"{muscle}: distribution of the selectivity index", draw)


def field_map_figure(field_map: NDArray[np.float64], title: str) -> Figure:
    """One field map: rows along the cord, columns across."""

    # The contacts' own pixels are extreme; the scale is that of the field between them.
    low, high = float(np.quantile(field_map, 0.05)), float(field_map.max())

    def draw(ax: Any) -> None:
        ax.imshow(field_map, cmap="Greys_r", interpolation="nearest", aspect="equal", vmin=low, vmax=high)
        ax.grid(visible=False)
        ax.set_xlabel("across (pixel)")
        ax.set_ylabel("along the cord, rostral first (pixel)")

    caption = (
        f"Field map of {title}: what an embedding encodes in place of contacts and current. "
        f"Black is {low:.4g} and below, white {high:.4g}."
    )
    return Figure("field_map", caption, [[Panel(f"Field map of {title}", draw, inches=(2.6, 5.2))]])


def synergy_figure(variance: pd.DataFrame) -> Figure:
    """Variance accounted for by 1, 2, ... synergies."""
    x, y = variance["components"].tolist(), variance["variance_accounted_for"].tolist()

    def draw(ax: Any) -> None:
        ax.plot(x, y, "o-", color="#000000")
        ax.set_ylim(0, 1.03)
        ax.set_xlabel("muscle synergies")
        ax.set_title("variance accounted for", loc="left")

    return Figure(
        "synergies",
        "Share of the variance of the muscle activations that the first synergies explain.",
        [
            [
                Panel(
                    "variance accounted for by the first synergies",
                    draw,
                    [Line("share", "#000000", x, y, [None] * len(x))],
                )
            ]
        ],
    )


def learning_figure(curve: pd.DataFrame) -> Figure:
    """Return of the training episodes, one panel per observation setting, with a running mean."""
    panels = [
        _learning_panel(str(name), table.sort_values("step")) for name, table in curve.groupby("setting")
    ]
    caption = (
        "Training of the policies (SAC) whose rollouts give the muscle activations: episodes and their "
        "running mean, per observation setting."
    )
    return Figure("learning_curve", caption, [panels[i : i + 3] for i in range(0, len(panels), 3)])


def _learning_panel(setting: str, episodes: pd.DataFrame) -> Panel:
    x, y = episodes["step"].to_numpy(float), episodes["total_reward"].to_numpy(float)
    window = max(1, len(y) // 25)
    smooth = pd.Series(y).rolling(window, center=True, min_periods=1).mean().to_numpy()

    def draw(ax: Any) -> None:
        ax.plot(x, y, ".", color=SKY, markersize=2.5)
        ax.plot(x, smooth, "-", color="#000000")
        ax.set_xlabel("environment steps")
        ax.set_title(f"{setting}: return of an episode", loc="left")

    mean = Line("running mean", "#000000", x.tolist(), smooth.tolist(), [None] * len(x))
    return Panel(f"return over training, setting {setting}", draw, [mean])
