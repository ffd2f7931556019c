"""Your own system with two safety functions: ask, tell, a failed trial, save and load.

The system here is a made-up polishing robot with eight settings x in [0, 1]^8. What it removes is to be
large; neither the force on the part nor the temperature may pass its limit, and now and then a trial gives
no result because the part slips. Only `polish` knows any of this; replace it by your own system.

    python examples/own_black_box.py
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

from hdsafebo import Evaluation, HdSafeBOLocal, Problem, Safety, Status, Trials

LARGEST_FORCE = 25.0  # N
LARGEST_TEMPERATURE = 52.0  # degrees Celsius
GOOD = np.array([0.9, 0.8, 0.7, 0.6, 0.6, 0.7, 0.8, 0.9])


def polish(x: np.ndarray) -> tuple[float, float, float] | None:
    """Removed mass in g, force in N and temperature in degrees at settings (8,); None if the trial failed."""
    if np.sin(1000.0 * x.sum()) > 0.98:
        return None  # the part slipped
    removed = 10.0 - 4.0 * float(((x - GOOD) ** 2).sum())
    return removed, 6.0 + 28.0 * float(x[:4].mean()), 22.0 + 45.0 * float(x[4:].mean())


class Polishing(Problem):
    """Removed mass, with a margin to each limit. A trial is safe when both margins are positive."""

    name = "polishing"
    bounds = np.array([[0.0] * 8, [1.0] * 8])
    safety = (Safety("force_margin", threshold=0.0), Safety("temperature_margin", threshold=0.0))

    def evaluate(self, trials: Trials) -> Evaluation:
        """Try every row of `trials.x`; a trial without a result is marked, never given a made-up number."""
        results = [polish(x) for x in trials.x]
        failed = np.array([result is None for result in results])
        values = np.array([result or (np.nan,) * 3 for result in results]).reshape(len(results), 3)
        margins = np.array([LARGEST_FORCE, LARGEST_TEMPERATURE]) - values[:, 1:]
        return Evaluation(values[:, 0], margins, failed)


def optimize(state_file: Path, rounds: int = 12, batch: int = 4) -> HdSafeBOLocal:
    """The whole optimisation, cut in the middle and resumed from a file."""
    problem = Polishing()
    optimizer = HdSafeBOLocal(
        problem, alpha=0.95, seed=0
    )  # each trial safe with probability 0.95, it believes

    x = np.random.default_rng(1).uniform(0.0, 0.4, (16, 8))  # careful settings that were tried by hand
    known = problem.evaluate(Trials.pending(x, x, n_safety=2))
    optimizer.observe(x, known.objective, known.safety, status=known.status(), initial=True)

    for number in range(rounds):
        if number == rounds // 2:  # the computer is switched off here, and tomorrow:
            optimizer.save(state_file)
            optimizer = HdSafeBOLocal.load(state_file, problem)
        trials = optimizer.ask(batch)
        result = problem.evaluate(trials)
        optimizer.tell(trials, result.objective, result.safety, status=result.status())
    return optimizer


def main() -> None:
    """Optimise and say what came of it."""
    with tempfile.TemporaryDirectory() as folder:
        optimizer = optimize(Path(folder) / "polishing.zip")
    trials, best = optimizer.trials, optimizer.best()
    assert best is not None
    chosen = trials[~trials.initial]
    failed = int((chosen.status == Status.FAILED).sum())
    safe = optimizer.feasible[~trials.initial].sum() / (len(chosen) - failed)
    start = trials.objective[trials.initial & optimizer.feasible].max()
    print(f"removed {start:.2f} g at best before, {best.objective:.2f} g now, at {np.round(best.x, 2)}")
    print(f"{len(chosen)} trials, {failed} failed; {100 * safe:.0f} % of the others were safe,")
    print(f"{100 * chosen.predicted_safe_probability.mean():.0f} % were predicted to be")


if __name__ == "__main__":
    main()
