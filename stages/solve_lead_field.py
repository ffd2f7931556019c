"""Potential of 1 mA through each of the 16 contacts, everywhere in the cord and its coverings."""

from __future__ import annotations

import time

from hdsafebo.spinal.anatomy import Anatomy
from hdsafebo.spinal.conductivity import conductivity_table, cord_conductivity
from hdsafebo.spinal.lead_field import as_lead_field, cord_contacts, solve
from hdsafebo.spinal.mesh import cord_mesh
from hdsafebo.spinal.section import EdgeLengths, cord_section
from hdsafebo.stage import Stage, run_stage


def main(stage: Stage) -> None:
    """Solve the finite-element model and write the lead fields."""
    settings = stage.params.spinal
    anatomy = Anatomy().overridden(settings.anatomy)
    lengths = EdgeLengths(settings.mesh.cord, settings.mesh.contacts, settings.mesh.largest)
    start = time.perf_counter()
    mesh = cord_mesh(anatomy, cord_section(anatomy, lengths), settings.mesh.step)
    conductivity = cord_conductivity(anatomy, mesh, conductivity_table(settings.conductivity))
    solution = solve(mesh, conductivity, cord_contacts(anatomy, mesh), settings.tolerance)
    as_lead_field(mesh, anatomy, solution).save(stage.path("data/spinal/lead_field.npz"))
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
