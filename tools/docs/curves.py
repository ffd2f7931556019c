"""Curves of the methods on two small problems, so that the page of each method has a picture of it.

    python -m tools.docs.curves        run all, keep the curves as data, and draw (minutes of CPU)
    python -m tools.docs.curves sobol  run one of them again, and draw all

Both problems are a bowl whose top lies outside a ball of safe points: in a box of six inputs, and, for the
methods that choose rows, over 400 rows of two inputs. Three seeds of 40 trials in rounds of five, from ten
initial trials that all methods share. Small problems say little of how methods compare on others.
"""

from __future__ import annotations

import json
import sys
import warnings
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from hdsafebo.errors import NoSafePointError, OptimisticWarning, ProblemError
from hdsafebo.optimizers.registry import METHODS, make_optimizer
from hdsafebo.problem import FunctionProblem, Safety
from hdsafebo.report.data.methods import style
from hdsafebo.typing import FloatArray, IntArray
from tools.docs.methods import method_pages

ROOT = Path(__file__).resolve().parents[2]
FOLDER = ROOT / "docs/methods/curves"
DATA = FOLDER / "curves.json"
SEEDS, INITIAL, TRIALS, BATCH = (0, 1, 2), 10, 40, 5
_COLOUR, _GREY = "#D55E00", "#BBBBBB"


def bowl(x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Objective with its top at 0.8, safe within a ball about 0.4 in proportion to the dimension."""
    return -((x - 0.8) ** 2).mean(axis=1), 0.06 - ((x - 0.4) ** 2).mean(axis=1)


class Rows:
    """A finite candidate set whose features are its points."""

    def __init__(self, points: FloatArray) -> None:
        self.features = points

    def __len__(self) -> int:
        return len(self.features)

    def inputs(self, rows: IntArray) -> FloatArray:
        """Points of the rows."""
        return self.features[rows]

    def weakest(self) -> IntArray:
        """Rows in the lowest tenth of the first input."""
        return np.argsort(self.features[:, 0])[: len(self) // 10]

    def nearest(self, x: FloatArray, taken: IntArray) -> IntArray:
        """Greedily the nearest free row of each input."""
        distance = ((x[:, None] - self.features) ** 2).sum(axis=2)
        distance[:, taken] = np.inf
        rows = np.empty(len(x), np.int64)
        for i in range(len(x)):
            rows[i] = distance[i].argmin()
            distance[:, rows[i]] = np.inf
        return rows


def problem_of(name: str) -> FunctionProblem:
    """`box` or `rows`."""
    dimension = 6 if name == "box" else 2
    bounds = [[0.0] * dimension, [1.0] * dimension]
    problem = FunctionProblem(bowl, bounds, [Safety("ball", 0.0)], name=name)
    if name == "rows":
        problem.candidates = Rows(np.random.default_rng(7).random((400, 2)))
    return problem


def run(method: str) -> dict[str, Any]:
    """Best safe value and safe share after every trial, on the first problem that the method takes."""
    for name in ("box", "rows"):
        try:
            return {"problem": name, "seeds": [_seed(method, problem_of(name), seed) for seed in SEEDS]}
        except ProblemError:
            continue
    raise RuntimeError(f"{method} takes neither problem")


def _seed(method: str, problem: FunctionProblem, seed: int) -> dict[str, list[float]]:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", OptimisticWarning)  # the published settings are what is shown
        optimizer = make_optimizer(method, problem, seed=seed)
    _begin(optimizer, problem, seed)
    while (left := INITIAL + TRIALS - len(optimizer.trials)) > 0:
        try:
            trials = optimizer.ask(min(BATCH, left))
        except NoSafePointError:
            break
        optimizer.tell(trials, *bowl(trials.x))
    safe = optimizer.feasible
    best = np.maximum.accumulate(np.where(safe, optimizer.trials.objective, -np.inf))
    asked = safe[INITIAL:]
    share = np.cumsum(asked) / np.arange(1, len(asked) + 1)
    return {"best": best[INITIAL:].round(5).tolist(), "safe": share.round(4).tolist()}


def _begin(optimizer: Any, problem: FunctionProblem, seed: int) -> None:
    """Ten careful trials, the same for all methods."""
    rng = np.random.default_rng(1000 + seed)
    if problem.candidates is None:
        x = rng.uniform(0.2, 0.5, (INITIAL, problem.bounds.shape[1]))
        optimizer.observe(x, *bowl(x), initial=True)
        return
    points = problem.candidates.inputs(np.arange(len(problem.candidates)))
    rows = rng.choice(np.flatnonzero((points < 0.5).all(axis=1) & (bowl(points)[1] > 0)), INITIAL, False)
    optimizer.observe(points[rows], *bowl(points[rows]), candidate=rows, initial=True)


def draw(curves: dict[str, Any]) -> None:
    """A picture per method, with all others of its problem in grey."""
    for name, own in curves.items():
        figure = Figure(figsize=(8.0, 2.8), layout="constrained", dpi=100)
        for axes, key in zip(figure.subplots(1, 2), ("best", "safe"), strict=True):
            for other, curve in curves.items():
                if other != name and curve["problem"] == own["problem"]:
                    axes.plot(*_median(curve, key), color=_GREY, linewidth=0.8)
            axes.plot(*_median(own, key), color=_COLOUR, linewidth=2, label=style(name).label)
            axes.set(xlabel="trial", ylabel="best safe value" if key == "best" else "share that was safe")
            axes.legend(frameon=False, fontsize=8, loc="lower right")
        figure.savefig(FOLDER / f"{name}.png", metadata={"Software": None})


def _median(curve: dict[str, Any], key: str) -> tuple[FloatArray, FloatArray]:
    """Median over the seeds, as far as all of them go."""
    length = min(len(seed[key]) for seed in curve["seeds"])
    return np.arange(1, length + 1), np.median([seed[key][:length] for seed in curve["seeds"]], axis=0)


def main(names: list[str]) -> None:
    """Run, keep and draw."""
    FOLDER.mkdir(exist_ok=True)
    curves = json.loads(DATA.read_text()) if names and DATA.exists() else {}
    known = [page.name for page in method_pages() if page.name in METHODS]
    for name in names or known:
        curves[name] = run(name)
        print(name, curves[name]["problem"], flush=True)
    curves = {name: curves[name] for name in known if name in curves}
    DATA.write_text(json.dumps(curves) + "\n", encoding="utf-8")
    draw(curves)


if __name__ == "__main__":
    main(sys.argv[1:])
