"""Potential of 1 mA through each of the 16 contacts, everywhere in the cord and its coverings."""

from __future__ import annotations

import time

from hdsafebo.pipeline.stage import Stage, run_stage
from hdsafebo.spinal.figures import activating_figure, bipole, mesh_figure, potential_figure, save_figure
from hdsafebo.spinal.finite_elements.solution import as_lead_field, cord_contacts, solve
from hdsafebo.spinal.geometry.anatomy import Anatomy
from hdsafebo.spinal.geometry.conductivity import conductivity_table, cord_conductivity
from hdsafebo.spinal.geometry.mesh import cord_mesh
from hdsafebo.spinal.geometry.section import EdgeLengths, cord_section
from hdsafebo.spinal.muscles import districts

_SHOWN_BIPOLE = (12, 14)  # cathode and anode of the pictures, on the medial column


def main(stage: Stage) -> None:
    """Solve the finite-element model and write the lead fields."""
    settings = stage.params.spinal
    anatomy = Anatomy().overridden(settings.anatomy)
    lengths = EdgeLengths(settings.mesh.cord, settings.mesh.contacts, settings.mesh.largest)
    start = time.perf_counter()
    mesh = cord_mesh(anatomy, cord_section(anatomy, lengths), settings.mesh.step)
    conductivity = cord_conductivity(anatomy, mesh, conductivity_table(settings.conductivity))
    solution = solve(mesh, conductivity, cord_contacts(anatomy, mesh), settings.tolerance)
    field = as_lead_field(mesh, anatomy, solution)
    field.save(stage.path("data/spinal/lead_field.npz"))
    polarity = bipole(*_SHOWN_BIPOLE)
    for name, figure in {
        "mesh": mesh_figure(field),
        "potential": potential_figure(field, polarity, 1.0),
        "activating_function": activating_figure(
            field, polarity, 1.0, districts(anatomy, settings.districts)
        ),
    }.items():
        save_figure(figure, stage.path(f"data/spinal/figures/{name}.png"))
    stage.log_metrics(
        {
            "unknowns": solution.unknowns,
            "iterations": solution.iterations,
            "reciprocity_error": solution.reciprocity_error,
            "current_error": solution.current_error,
            "seconds": time.perf_counter() - start,
        }
    )


if __name__ == "__main__":
    run_stage("solve_lead_field", main, blocks=["spinal"])
