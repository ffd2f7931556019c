"""Cost of training: the isometry term in one pass and by generic differentiation, and epochs.

    python benchmarks/embeddings.py --write

Times are those of one thread, CPU and wall; of a step the medians.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import torch

from hdsafebo.embeddings import make_embedding
from hdsafebo.embeddings.training.tangents import TrainableMlp, relaxed_distortion
from hdsafebo.files.atomic import write_json
from hdsafebo.spinal.configurations import enumerate_configurations
from hdsafebo.spinal.field_map import REFERENCE_CURRENT_MA, RandomCurrents, field_maps, unit_potentials

OUT = Path("reports/reference/benchmarks/embeddings.json")
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


def clocks() -> np.ndarray:
    """CPU and wall time, s."""
    return np.array([time.process_time(), time.perf_counter()])


def step_ms(term: Callable[..., torch.Tensor], repeats: int) -> np.ndarray:
    """Median CPU and wall milliseconds of the term and its gradient: batch 256, the paper's decoder."""
    generator = torch.Generator().manual_seed(0)
    decoder = TrainableMlp([16, 256, 256, 256, 256, 728], generator)
    z, v = torch.randn(2, 256, 16, generator=generator)
    times = []
    for _ in range(repeats):
        start = clocks()
        torch.autograd.grad(term(decoder, z, v), decoder.parameters[:-1])
        times.append(clocks() - start)
    return np.asarray(1e3 * np.median(times, axis=0))


def training_seconds(name: str, maps: np.ndarray, epochs: int) -> np.ndarray:
    """CPU and wall seconds of a training on all configurations."""
    settings = {"warm_start_epochs": 2} if name != "residual" else {"homogeneous": True, "origin": 1.0}
    embedding = make_embedding(name, epochs=epochs, **settings)
    start = clocks()
    embedding.fit(maps, rng=np.random.default_rng(0), source=RandomCurrents(CURRENTS))
    return clocks() - start


def epoch_seconds(name: str, maps: np.ndarray, epochs: int) -> np.ndarray:
    """CPU and wall seconds of one epoch more, without what a training does once."""
    return (training_seconds(name, maps, 1 + epochs) - training_seconds(name, maps, 1)) / epochs


def main() -> None:
    """Print the table, and write it if asked."""
    parser = argparse.ArgumentParser(description="Cost of training embeddings, one thread.")
    parser.add_argument("--repeats", type=int, default=20, help="timed repetitions of a step")
    parser.add_argument("--epochs", type=int, default=2, help="timed epochs")
    parser.add_argument("--write", action="store_true", help=f"write {OUT}")
    options = parser.parse_args()

    torch.set_num_threads(1)
    maps = field_maps(unit_potentials(enumerate_configurations()), REFERENCE_CURRENT_MA)
    results = {
        "isometry_term_ms": step_ms(own_distortion, options.repeats),
        "isometry_term_generic_ms": step_ms(generic_distortion, options.repeats),
    }
    for name in ("irvae", "vae", "residual"):
        results[f"{name}_epoch_s"] = epoch_seconds(name, maps, options.epochs)
    table = {key: {"cpu": float(cpu), "wall": float(wall)} for key, (cpu, wall) in results.items()}
    for key, row in table.items():
        print(f"{key:28s} CPU {row['cpu']:10.2f}  wall {row['wall']:10.2f}")
    if options.write:
        write_json(OUT, table)


if __name__ == "__main__":
    main()
