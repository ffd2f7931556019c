"""Pictures of the spinal model: mesh, potential, activating function along the cord, selectivity."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pyarrow as pa
from matplotlib.colors import ListedColormap, SymLogNorm
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.tri import Triangulation
from numpy.typing import NDArray

from hdsafebo.spinal.activating_function import along_fibres
from hdsafebo.spinal.configurations import current_shares
from hdsafebo.spinal.lead_field import LeadField
from hdsafebo.spinal.muscles import MUSCLES, District

Array = NDArray[np.float64]

TISSUE_COLOURS = {
    "grey": "#9a8c98",
    "white": "#f2e9e4",
    "csf": "#8ecae6",
    "dura": "#e09f3e",
    "paddle": "#495057",
    "fat": "#ffe8a3",
    "bone": "#d9d2c5",
}
_VIEW = 13.0  # mm shown on each side of the cord's centre
_RESOLUTION = 150  # dots per inch


def save_figure(figure: Figure, path: Path) -> None:
    """Write a PNG without time stamps."""
    figure.savefig(path, dpi=_RESOLUTION, metadata={"Software": None})


def bipole(rostral: int, caudal: int) -> NDArray[np.int8]:
    """Polarity of a cathode at one contact and an anode at another, shape (16,)."""
    polarity = np.zeros(16, dtype=np.int8)
    polarity[[rostral, caudal]] = -1, 1
    return polarity


def mesh_figure(field: LeadField) -> Figure:
    """The reference section with its tissues, and the slices along the cord."""
    figure = Figure(figsize=(11, 5.2), layout="constrained")
    section, side = figure.subplots(1, 2, width_ratios=(1, 1.1))
    colours = [TISSUE_COLOURS[name] for name in field.tissues]
    section.tripcolor(
        *field.section_nodes, field.triangles.T, field.tissue, cmap=ListedColormap(colours),
        vmin=-0.5, vmax=len(colours) - 0.5, edgecolors="#00000055", linewidth=0.2,
    )  # fmt: skip
    section.set(xlim=(-_VIEW, _VIEW), ylim=(-_VIEW, _VIEW), aspect="equal", title="Reference section")
    section.set(xlabel="x / mm (right)", ylabel="y / mm (dorsal)")
    section.legend(
        handles=[Patch(color=c, label=n) for n, c in zip(field.tissues, colours, strict=True)],
        loc="lower left", fontsize="small", ncols=2,
    )  # fmt: skip
    middle = np.flatnonzero((field.section_nodes[0] == 0) & (np.abs(field.section_nodes[1]) < _VIEW))
    for node in middle:
        side.plot(field.z, field.y[:, node], color="#457b9d", linewidth=0.4)
    for k, z in enumerate(field.z):
        ends = field.y[k, middle]
        side.plot([z, z], [ends.min(), ends.max()], color="#457b9d", linewidth=0.3)
    side.set(title="Median plane: columns and slices", xlabel="z / mm (caudal)", ylabel="y / mm (dorsal)")
    return figure


def potential_figure(field: LeadField, polarity: NDArray[np.int8], current: float) -> Figure:
    """Potential in the section through the first cathode.

    Args:
        field: lead fields.
        polarity: of the contacts, shape (16,).
        current: mA.
    """
    cathode = int(np.flatnonzero(polarity < 0)[0])
    slice_ = int(np.argmin(np.abs(field.z - field.contacts[cathode, 1])))
    values = current * field.potential[slice_] @ current_shares(polarity[None])[0]
    figure = Figure(figsize=(6.4, 5.2), layout="constrained")
    axes = figure.subplots()
    x, y = field.x[slice_], field.y[slice_]
    reach = np.geomspace(1e-3, 1, 25) * np.abs(values).max()
    levels = np.concatenate([-reach[::-1], reach])
    scale = SymLogNorm(reach[0], vmin=levels[0], vmax=levels[-1])
    filled = axes.tricontourf(
        Triangulation(x, y, field.triangles.T), values, levels=levels, cmap="RdBu_r", norm=scale
    )
    for index in range(len(field.tissues)):
        inside = field.tissue == index
        outline = _outline(field.triangles[:, inside])
        axes.plot(x[outline], y[outline], color="black", linewidth=0.5)
    axes.set(xlim=(-_VIEW, _VIEW), ylim=(-_VIEW, _VIEW), aspect="equal")
    axes.set(title=f"Potential at z = {field.z[slice_]:.1f} mm, {current:g} mA", xlabel="x / mm (right)")
    axes.set_ylabel("y / mm (dorsal)")
    figure.colorbar(filled, ax=axes, label="mV", format="%.0f")
    return figure


def activating_figure(
    field: LeadField, polarity: NDArray[np.int8], current: float, districts: Mapping[str, District]
) -> Figure:
    """Activating function along fibres of the left dorsal column, lateral column and grey matter.

    Args:
        field: lead fields.
        polarity: of the contacts, shape (16,).
        current: mA.
        districts: borders of the motor pools, mm.
    """
    fibres = {"dorsal column": (-0.8, 2.6), "lateral column": (-3.6, 0.0), "ventral horn": (-1.8, -1.4)}
    low, high = min(d[0] for d in districts.values()), max(d[1] for d in districts.values())
    z = np.linspace(low, high, 400)
    unit = along_fibres(field, np.array(list(fibres.values())), z)
    values = current * np.tensordot(current_shares(polarity[None])[0], unit, axes=1)
    figure = Figure(figsize=(9, 4.6), layout="constrained")
    axes, pools = figure.subplots(2, 1, sharex=True, height_ratios=(3, 1))
    for i, (name, (x, y)) in enumerate(fibres.items()):
        axes.plot(z, values[:, i], label=f"{name} ({x:g}, {y:g})")
    for contact in np.flatnonzero(polarity):
        colour = "#1d3557" if polarity[contact] < 0 else "#e63946"
        kind = "cathode" if polarity[contact] < 0 else "anode"
        axes.axvspan(*(field.contacts[contact, 1] + [-1.5, 1.5]), color=colour, alpha=0.2, label=kind)
    axes.set(title=f"Activating function, {current:g} mA", ylabel="mV/mm²")
    axes.legend(fontsize="small")
    for i, (muscle, (start, end)) in enumerate(districts.items()):
        pools.barh(i, end - start, left=start, color="#9a8c98")
        pools.text((start + end) / 2, i, muscle, ha="center", va="center", fontsize="small")
    pools.set(yticks=[], xlabel="z / mm (caudal)")
    return figure


def selectivity_figure(table: pa.Table, side: str, safety_threshold: float) -> Figure:
    """Distribution of the selectivity index of the six muscles, safe and unsafe rows apart.

    Args:
        table: the dataset.
        side: "left" or "right".
        safety_threshold: least g of a safe row.
    """
    safe = table["g"].to_numpy() >= safety_threshold
    figure = Figure(figsize=(10, 5.6), layout="constrained")
    bins = np.linspace(-1, 1, 81)
    for axes, muscle in zip(figure.subplots(2, 3, sharex=True).flat, MUSCLES, strict=True):
        values = table[f"si_{muscle}_{side}"].to_numpy()
        axes.hist([values[safe], values[~safe]], bins, stacked=True, color=["#2a9d8f", "#e76f51"])
        best = values[safe].max(initial=-1.0)
        axes.axvline(best, color="black", linewidth=0.8, linestyle=":")
        axes.set(title=f"{muscle} {side} (best safe {best:.3f})", yscale="log")
    figure.supxlabel("selectivity index")
    figure.supylabel("rows")
    colours = [Patch(color="#2a9d8f", label="safe"), Patch(color="#e76f51", label="unsafe")]
    figure.legend(handles=colours, loc="outside upper right", ncols=2)
    return figure


def _outline(triangles: NDArray[np.intp]) -> NDArray[np.intp]:
    """Edges that belong to one triangle only, shape (2, edges)."""
    edges = np.sort(np.concatenate([triangles[[0, 1]], triangles[[1, 2]], triangles[[2, 0]]], axis=1), axis=0)
    unique, count = np.unique(edges, axis=1, return_counts=True)
    return unique[:, count == 1]
