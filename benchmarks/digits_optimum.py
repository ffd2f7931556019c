"""The thickest valid image of each digit in the searched box of codes, and what random search meets there.

For the box that is searched (margin 0: it ends where the codes of the data do) and for wider ones, which say
what bounds the objective: the optimum (SLSQP from the thickest
valid ones of random codes and of the data's), how many sides of the box it touches, and the share of valid
images among random codes. It knows what no method does: 20,000 evaluations, and gradients.

    python stages/train_digits.py
    python benchmarks/digits_optimum.py --write
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path

import numpy as np
from scipy.optimize import minimize

from hdsafebo.embeddings.base import Embedding
from hdsafebo.embeddings.registry import load_embedding
from hdsafebo.files.atomic import write_json
from hdsafebo.gp.surrogate import apply_transform
from hdsafebo.params import load_params
from hdsafebo.problem import Problem
from hdsafebo.problems.digit_images import load_digit_images
from hdsafebo.problems.digits import EMBEDDING_FILE, ThickDigit
from hdsafebo.problems.registry import make_task
from hdsafebo.trials import Trials
from hdsafebo.typing import FloatArray

ROOT = Path(__file__).parents[1]
OUT = ROOT / "reports" / "reference" / "benchmarks" / "digits_optimum.json"
MARGINS = (0.0, 0.25, 0.5)
"""By which boxes reach beyond the codes on every side, in widths of their range."""
RANDOM = 20_000
STARTS = 10
APART = 0.2
"""Least distance between starts, in the unit cube."""
STEP = 1e-4
TOLERANCE = 1e-3

Outcomes = Callable[[FloatArray], tuple[FloatArray, FloatArray]]


def outcomes_of(problem: Problem, embedding: Embedding, box: FloatArray) -> Outcomes:
    """(n,) objective and (n,) log odds of validity of (n, d) points of the unit cube."""
    (safety,) = problem.safety

    def outcomes(u: FloatArray) -> tuple[FloatArray, FloatArray]:
        z = box[0] + u * (box[1] - box[0])
        result = problem.evaluate(Trials.pending(embedding.decode(z), z, 1))
        return result.objective, apply_transform(safety.transform, result.safety[:, 0])

    return outcomes


def box_around(codes: FloatArray, margin: float) -> FloatArray:
    """(2, d) limits of (n, d) codes, moved out by `margin` times their range."""
    lower, upper = codes.min(axis=0), codes.max(axis=0)
    reach = margin * (upper - lower)
    return np.vstack([lower - reach, upper + reach])


def separate_starts(u: FloatArray, objective: FloatArray, odds: FloatArray) -> list[FloatArray]:
    """The best valid points that lie apart from one another."""
    starts: list[FloatArray] = []
    for row in np.argsort(-objective, kind="stable"):
        if odds[row] >= 0 and all(np.linalg.norm(u[row] - start) > APART for start in starts):
            starts.append(u[row])
        if len(starts) == STARTS:
            break
    return starts


def climb(outcomes: Outcomes, start: FloatArray) -> tuple[float, FloatArray]:
    """Value and place of the constrained optimum above a start; -inf where SLSQP ends outside."""
    d = len(start)

    @lru_cache(maxsize=2)  # the solver asks for each of the four at the same place
    def at(place: bytes) -> FloatArray:
        """(2, 1 + d): objective and log odds, each with its forward differences."""
        u = np.frombuffer(place)
        values = np.array(outcomes(np.vstack([u, u + STEP * np.eye(d)])))
        return np.column_stack([values[:, 0], (values[:, 1:] - values[:, :1]) / STEP])

    end = minimize(
        lambda u: -at(u.tobytes())[0, 0],
        start,
        jac=lambda u: -at(u.tobytes())[0, 1:],
        constraints={
            "type": "ineq",
            "fun": lambda u: at(u.tobytes())[1, 0],
            "jac": lambda u: at(u.tobytes())[1, 1:],
        },
        bounds=[(0.0, 1.0)] * d,
        method="SLSQP",
        options={"maxiter": 40},
    ).x
    objective, odds = outcomes(end[None])
    return (float(objective[0]) if odds[0] > -TOLERANCE else -np.inf), end


def examine(problem: ThickDigit, embedding: Embedding, box: FloatArray) -> dict[str, float]:
    """What one digit's box holds."""
    outcomes = outcomes_of(problem, embedding, box)
    u = np.random.default_rng(0).random((RANDOM, box.shape[1]))
    objective, odds = outcomes(u)
    images = embedding.encode(np.clip(embedding.decode(embedding.encode(problem.images)), 0.0, 1.0))
    shown = np.clip((images - box[0]) / (box[1] - box[0]), 0.0, 1.0)
    of_data = outcomes(shown)
    starts = separate_starts(
        np.vstack([u, shown]), np.append(objective, of_data[0]), np.append(odds, of_data[1])
    )
    best, place = max((climb(outcomes, start) for start in starts), key=lambda end: end[0])
    sides = int(((place < TOLERANCE) | (place > 1 - TOLERANCE)).sum())
    return {"optimum": best, "sides": sides, "valid_share": float((odds >= 0).mean())}


def main() -> None:
    """Print a line per margin; with --write, keep all in the reference report's folder."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--write", action="store_true", help=f"write {OUT.relative_to(ROOT)}")
    arguments = parser.parse_args()
    params = load_params(ROOT / "params.yaml")
    data = load_digit_images(params.digits.source, params.digits.folder_path(ROOT))
    embedding = load_embedding(ROOT / EMBEDDING_FILE, input_dim=data.pixels.shape[1])
    codes = embedding.encode(data.pixels)
    problems = [
        make_task(f"digits_{digit}_informed", params, seed=0, root=ROOT).problem for digit in range(10)
    ]
    found = {}
    for margin in MARGINS:
        box = box_around(codes, margin)
        digits = [examine(problem, embedding, box) for problem in problems if isinstance(problem, ThickDigit)]
        found[str(margin)] = {key: [round(row[key], 4) for row in digits] for key in digits[0]}
        means = {key: round(float(np.mean(values)), 3) for key, values in found[str(margin)].items()}
        print(f"margin {margin}: means {means}, optima {found[str(margin)]['optimum']}", flush=True)
    if arguments.write:
        write_json(OUT, {"margins": found})


if __name__ == "__main__":
    main()
