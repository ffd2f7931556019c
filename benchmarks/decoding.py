"""Exact nearest-row decoding of field maps against brute force: equality and time.

    python benchmarks/decoding.py --queries 1000 --write

Times are medians of CPU time with one thread; wall times stand beside them.
"""

from __future__ import annotations

import argparse
import statistics
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
from scipy.spatial.distance import cdist
from threadpoolctl import threadpool_limits

from hdsafebo.files.atomic import write_json
from hdsafebo.progress import track
from hdsafebo.spinal.configurations import enumerate_configurations
from hdsafebo.spinal.field_map import unit_potentials
from hdsafebo.spinal.nearest import NearestMap

OUT = Path("reports/reference/benchmarks/decoding.json")
BATCH = 10  # queries per round of the optimiser
EVALUATED = 1000  # rows that a finished run has evaluated


def mixtures(unit: np.ndarray, count: int, noise: float, rng: np.random.Generator) -> np.ndarray:
    """Maps between two configurations at any current up to a fifth above the largest, with pixel noise."""
    first, second = unit[rng.integers(len(unit), size=(2, count))]
    share, strength = rng.random((count, 1)), rng.uniform(0.0, 1.2, (count, 1))
    exact = 1 + strength * (share * first + (1 - share) * second)
    return exact + noise * rng.standard_normal((count, unit.shape[1]))


def brute_force(unit: np.ndarray, currents: np.ndarray, queries: np.ndarray, taken: np.ndarray) -> np.ndarray:
    """Nearest rows by the distance of each query to each of the 218,000 maps, pixel by pixel."""
    best, rows = np.full(len(queries), np.inf), np.zeros(len(queries), np.int64)
    for level, current in enumerate(track(currents, "brute force")):
        distances = cdist(queries, 1 + current / 5 * unit)
        distances[:, taken[taken % len(currents) == level] // len(currents)] = np.inf
        nearest = distances.argmin(axis=1)
        least = distances[np.arange(len(queries)), nearest]
        rows[least < best] = nearest[least < best] * len(currents) + level
        best = np.minimum(best, least)
    return rows


def median_ms(call: Callable[[], object], repeats: int) -> dict[str, float]:
    """Median CPU and wall time of a call in milliseconds."""
    cpu, wall = [], []
    for _ in range(repeats):
        start, begin = time.process_time(), time.perf_counter()
        call()
        cpu.append(time.process_time() - start)
        wall.append(time.perf_counter() - begin)
    return {"cpu_ms": 1e3 * statistics.median(cpu), "wall_ms": 1e3 * statistics.median(wall)}


@threadpool_limits.wrap(limits=1)
def main() -> None:
    """Print the table, and write it if asked."""
    parser = argparse.ArgumentParser(
        description="Exact nearest-row decoding: equality with brute force, time."
    )
    parser.add_argument("--queries", type=int, default=20, help="random queries compared with brute force")
    parser.add_argument("--repeats", type=int, default=30, help="timed repetitions")
    parser.add_argument("--seed", type=int, default=0, help="of the queries")
    parser.add_argument("--write", action="store_true", help=f"write {OUT}")
    options = parser.parse_args()

    rng = np.random.default_rng(options.seed)
    unit, currents = unit_potentials(enumerate_configurations()), np.geomspace(0.05, 5.0, 10)
    nearest = NearestMap(unit, currents)
    results: dict[str, dict[str, float]] = {"build": median_ms(partial(NearestMap, unit, currents), 3)}
    taken = rng.choice(len(nearest), EVALUATED, replace=False)
    for noise in (0.0, 0.01, 0.1):
        batch = mixtures(unit, BATCH, noise, rng)
        timed = median_ms(partial(nearest.query, batch, taken), options.repeats)
        results[f"ten_queries_noise_{noise:g}"] = timed
    maps = mixtures(unit, options.queries, 0.01, rng)
    results["brute_force_ten_queries"] = median_ms(
        partial(brute_force, unit, currents, maps[:BATCH], taken), 3
    )
    found, _ = nearest.query(maps, taken, exclude_within_batch=False)
    equal = int(np.sum(found == brute_force(unit, currents, maps, taken)))
    results["against_brute_force"] = {"queries": options.queries, "equal": equal}
    for key, values in results.items():
        print(f"{key:28s} " + "  ".join(f"{name} {value:.2f}" for name, value in values.items()))
    if options.write:
        write_json(OUT, results)


if __name__ == "__main__":
    main()
