"""Cost of training: the isometry term in one pass and by generic differentiation, and epochs.

    python benchmarks/embeddings.py --json reports/benchmarks/embeddings.json

Times are CPU seconds of one thread, so that other work on the machine matters little.
"""

from __future__ import annotations

import argparse
import json
import statistics
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import torch

from hdsafebo.embeddings import make_embedding
from hdsafebo.embeddings.tangents import TrainableMlp, relaxed_distortion
from hdsafebo.spinal.configurations import enumerate_configurations
from hdsafebo.spinal.field_map import REFERENCE_CURRENT_MA, RandomCurrents, field_maps, unit_potentials

CURRENTS = tuple(np.geomspace(0.05, 5.0, 10))


def generic_distortion(decoder: TrainableMlp, z: torch.Tensor, v: torch.Tensor) -> torch.Tensor:
    """The same term by torch.autograd.functional, as the method's authors compute it."""
    from torch.autograd.functional import jvp, vjp

    tangent = jvp(decoder, z, v=v, create_graph=True)[1]
    cotangent = vjp(decoder, z, v=tangent, create_graph=True)[1]
    return relaxed_distortion(tangent, cotangent)


def own_distortion(decoder: TrainableMlp, z: torch.Tensor, v: torch.Tensor) -> torch.Tensor:
    """The term in one pass."""
    pullback = decoder.pullback(z, v)
    return relaxed_distortion(pullback.tangent, pullback.cotangent)


def step_ms(term: Callable[..., torch.Tensor], repeats: int) -> float:
    """Median CPU milliseconds of the term and its gradient: batch 256, the paper's decoder."""
    generator = torch.Generator().manual_seed(0)
    decoder = TrainableMlp([16, 256, 256, 256, 256, 728], generator)
    z, v = torch.randn(2, 256, 16, generator=generator)
    times = []
    for _ in range(repeats):
        start = time.process_time()
        torch.autograd.grad(term(decoder, z, v), decoder.parameters[:-1])
        times.append(time.process_time() - start)
    return 1e3 * statistics.median(times)


def training_seconds(name: str, maps: np.ndarray, epochs: int) -> float:
    """CPU seconds of a training on all configurations."""
    settings = {"warm_start_epochs": 2} if name != "residual" else {"homogeneous": True, "origin": 1.0}
    embedding = make_embedding(name, epochs=epochs, **settings)
    start = time.process_time()
    embedding.fit(maps, rng=np.random.default_rng(0), source=RandomCurrents(CURRENTS))
    return time.process_time() - start


def epoch_seconds(name: str, maps: np.ndarray, epochs: int) -> float:
    """CPU seconds of one epoch more, without what a training does once."""
    return (training_seconds(name, maps, 1 + epochs) - training_seconds(name, maps, 1)) / epochs


def main() -> None:
    """Print the table, and write it if asked."""
    parser = argparse.ArgumentParser(description="Cost of training embeddings, CPU time of one thread.")
    parser.add_argument("--repeats", type=int, default=20, help="timed repetitions of a step")
    parser.add_argument("--epochs", type=int, default=2, help="timed epochs")
    parser.add_argument("--json", type=Path, help="write the results here")
    options = parser.parse_args()

    torch.set_num_threads(1)
    maps = field_maps(unit_potentials(enumerate_configurations()), REFERENCE_CURRENT_MA)
    results = {
        "isometry_term_ms": step_ms(own_distortion, options.repeats),
        "isometry_term_generic_ms": step_ms(generic_distortion, options.repeats),
    }
    for name in ("irvae", "vae", "residual"):
        results[f"{name}_epoch_s"] = epoch_seconds(name, maps, options.epochs)
    for key, value in results.items():
        print(f"{key:28s} {value:10.2f}")
    if options.json is not None:
        options.json.parent.mkdir(parents=True, exist_ok=True)
        options.json.write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
