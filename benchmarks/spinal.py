"""Verification of the spinal model at full size: accuracy, convergence, conservation, meshes, cost.

    python benchmarks/spinal.py --write             # all of it, some minutes
    python benchmarks/spinal.py --part cylinder --part meshes

The layered cylinder has an exact solution (Fourier and Bessel series). Errors are the largest over a fibre,
relative to its largest value, at r = 0, 2 and 4 mm below the patch; the bent columns use mapped prisms.
CPU seconds are those of all threads, one for the solver and two for the traversal; the wall's stand beside
them. Peak memory is that of a process of its own per part, so of all that was done in it so far.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from hdsafebo.files.atomic import write_json
from hdsafebo.params import Spinal
from hdsafebo.spinal.activating_function import sample
from hdsafebo.spinal.configurations import enumerate_configurations
from hdsafebo.spinal.finite_elements.reference_cylinder import LayeredCylinder
from hdsafebo.spinal.finite_elements.solution import as_lead_field, cord_contacts, solve
from hdsafebo.spinal.geometry.anatomy import Anatomy
from hdsafebo.spinal.geometry.conductivity import conductivity_table, cord_conductivity
from hdsafebo.spinal.geometry.mesh import cord_mesh
from hdsafebo.spinal.geometry.section import EdgeLengths, cord_section
from hdsafebo.spinal.lead_field import LeadField
from hdsafebo.spinal.muscles import districts
from hdsafebo.spinal.traversal import Traversal, traverse
from hdsafebo.spinal.verification import RADII, cylinder_errors

Row = dict[str, float | int | str]

OUT = Path("reports/reference/benchmarks/spinal.json")
ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
SETTINGS = Spinal()
STANDARD = EdgeLengths(SETTINGS.mesh.cord, SETTINGS.mesh.contacts, SETTINGS.mesh.largest)
MESHES = {
    "coarse": (EdgeLengths(0.8, 0.4, 6.0), 1.0),
    "standard": (STANDARD, SETTINGS.mesh.step),
    "fine": (EdgeLengths(0.3, 0.15, 3.0), 0.4),
}


def cylinder() -> list[Row]:
    """The standard mesh on the layered and on a homogeneous cylinder, straight and bent columns."""
    layered, uniform = LayeredCylinder(), LayeredCylinder(across=(0.3,) * 4, along=(0.3,) * 4)
    cases = [("layered", layered, 0.0), ("layered, bent", layered, 0.4), ("homogeneous", uniform, 0.0)]
    return [
        {"case": name, **_errors(case, STANDARD, SETTINGS.mesh.step, bulge)} for name, case, bulge in cases
    ]


def convergence() -> list[Row]:
    """Uniform refinement of straight and bent columns; order from the coarsest mesh on, worst fibre."""
    rows: list[Row] = []
    for bulge in (0.0, 0.4):
        coarsest = np.nan
        for factor in (1.0, 0.7, 0.5, 0.35):
            row: Row = {"case": "bent" if bulge else "straight", "factor": factor}
            row |= _errors(LayeredCylinder(), EdgeLengths(1.0, 0.5, 4.0, 0.6).scaled(factor), factor, bulge)
            error = max(float(row[f"V r={r:g} %"]) for r in RADII)
            if factor == 1.0:
                coarsest = error
            else:
                row["order of V"] = round(float(np.log(coarsest / error) / np.log(1 / factor)), 2)
            rows.append(row)
    return rows


def meshes() -> list[Row]:
    """The cord on three meshes: differences from the fine one, and the cost of the lead fields."""
    runs: dict[str, tuple[Row, Traversal]] = {}
    for name, (lengths, step) in MESHES.items():
        field, row = _solve_cord(lengths, step)
        runs[name] = ({"mesh": name, **row}, _traverse(field))
    best = runs["fine"][1]
    for row, found in runs.values():
        row["SI rms difference"] = float(np.sqrt(np.mean((found.si - best.si) ** 2)))
        row["g rms difference"] = float(np.sqrt(np.mean((found.g - best.g) ** 2)))
        row["threshold mV/mm2"] = found.threshold
    return [row for row, _ in runs.values()]


def traversal() -> list[Row]:
    """Cost and outcome of the traversal; best safe selectivity of the left pools and where it lies."""
    field, _ = _solve_cord(*MESHES["standard"])
    start, wall = time.process_time(), time.perf_counter()
    found = _traverse(field)
    safe = found.g >= SETTINGS.safety_threshold
    rows: list[Row] = [
        {
            "rows": found.g.size,
            "safe share": float(safe.mean()),
            **_seconds(start, wall),
            "peak MB": _peak(),
        }
    ]
    for i, muscle in enumerate(districts(Anatomy())):
        best = np.where(safe, found.si[:, :, i, 0], -1.0).max(axis=0)
        level = int(best.argmax())
        rows.append(
            {
                "muscle": muscle,
                "best safe SI": float(best.max()),
                "level": level,
                "mA": float(found.currents[level]),
                "safe share at the level": float(safe[:, level].mean()),
            }
        )
    return rows


def _errors(case: LayeredCylinder, lengths: EdgeLengths, step: float, bulge: float) -> Row:
    start, wall = time.process_time(), time.perf_counter()
    found = cylinder_errors(case, lengths, step, bulge)
    row: Row = {"unknowns": found.unknowns, **_seconds(start, wall)}
    for name, values in (("V", found.potential), ("AF", found.activating)):
        row |= {f"{name} r={r:g} %": round(100 * float(v), 3) for r, v in zip(RADII, values, strict=True)}
    row["reciprocity"] = found.solution.reciprocity_error
    row["current"] = found.solution.current_error
    return row


def _solve_cord(lengths: EdgeLengths, step: float) -> tuple[LeadField, Row]:
    anatomy, start, wall = Anatomy(), time.process_time(), time.perf_counter()
    mesh = cord_mesh(anatomy, cord_section(anatomy, lengths), step)
    conductivity = cord_conductivity(anatomy, mesh, conductivity_table({}))
    solution = solve(mesh, conductivity, cord_contacts(anatomy, mesh), SETTINGS.tolerance)
    row: Row = {
        "unknowns": solution.unknowns,
        "iterations": solution.iterations,
        **_seconds(start, wall),
        "peak MB": _peak(),
        "reciprocity": solution.reciprocity_error,
        "current": solution.current_error,
    }
    return as_lead_field(mesh, anatomy, solution), row


def _traverse(field: LeadField) -> Traversal:
    anatomy = Anatomy()
    low, high = anatomy.place("L1", end=False), anatomy.place("S2", end=True)
    activating = sample(field, low, high, SETTINGS.sample_spacing, SETTINGS.sample_slices)
    currents = np.array(SETTINGS.currents)
    return traverse(
        activating, districts(anatomy), enumerate_configurations(), currents, SETTINGS.safety_threshold
    )


def _seconds(start: float, wall: float) -> Row:
    """CPU and wall seconds since these readings of the clocks."""
    return {
        "CPU s": round(time.process_time() - start, 1),
        "wall s": round(time.perf_counter() - wall, 1),
    }


def _peak() -> int:
    """Peak memory of the process so far, MB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024


PARTS: dict[str, Callable[[], list[Row]]] = {
    "cylinder": cylinder, "convergence": convergence, "traversal": traversal, "meshes": meshes,
}  # fmt: skip


def in_own_process(part: str) -> list[Row]:
    """Rows of a part, computed in a process that has done nothing else."""
    command = [sys.executable, __file__, "--part", part, "--json"]
    rows: list[Row] = json.loads(
        subprocess.run(
            command, stdout=subprocess.PIPE, text=True, check=True, env=os.environ | ONE_THREAD
        ).stdout
    )
    return rows


def main() -> None:
    """Run the chosen parts and print one table each."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--part", choices=list(PARTS), action="append", help="may be repeated; default: all")
    parser.add_argument("--write", action="store_true", help=f"keep the rows in {OUT}")
    parser.add_argument("--json", action="store_true", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    parts = arguments.part or list(PARTS)
    if arguments.json:
        print(json.dumps(PARTS[parts[0]]()))
        return
    results = json.loads(OUT.read_text(encoding="utf-8")) if OUT.exists() else {}
    for name in parts:
        results[name] = in_own_process(name)
        print(f"\n{(PARTS[name].__doc__ or name).splitlines()[0]}")
        for row in results[name]:
            cells = (f"{k} {v:.3g}" if isinstance(v, float) else f"{k} {v}" for k, v in row.items())
            print("  " + " | ".join(cells), flush=True)
        if arguments.write:
            write_json(OUT, results)


if __name__ == "__main__":
    main()
