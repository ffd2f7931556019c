"""Train the embeddings of the field maps on nine tenths of the configurations."""

from __future__ import annotations

import time

import numpy as np

from hdsafebo.embeddings import make_embedding
from hdsafebo.pipeline.stage import Stage, run_stage
from hdsafebo.spinal.configurations import enumerate_configurations
from hdsafebo.spinal.field_map import REFERENCE_CURRENT_MA, RandomCurrents, field_maps, unit_potentials


def main(stage: Stage) -> None:
    """Train the embeddings of the field maps and write them with the list of held-out configurations."""
    settings = stage.params.embeddings
    maps = field_maps(unit_potentials(enumerate_configurations()), REFERENCE_CURRENT_MA)
    split = np.random.default_rng(settings.seed).permutation(len(maps))
    held_out = np.sort(split[: max(1, round(settings.held_out_share * len(maps)))])
    np.save(stage.path("models/embeddings/held_out.npy"), held_out)
    seen = np.delete(maps, held_out, axis=0)
    source = RandomCurrents(tuple(stage.params.spinal.currents))
    for name, options in settings.models.items():
        start = time.process_time()
        rng = np.random.default_rng([settings.seed, *name.encode()])  # the same whichever others are trained
        embedding = make_embedding(name, **options).fit(seen, rng=rng, source=source)
        embedding.save(stage.path(f"models/embeddings/{name}.safetensors"))
        stage.log_metrics({f"{name}_cpu_seconds": time.process_time() - start})


if __name__ == "__main__":
    run_stage("train_embeddings", main, blocks=["embeddings", "spinal.currents"])
