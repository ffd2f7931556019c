"""Twelve gains of an arm, two limits, and three robots of different speed that share one study.

python examples/arm_gains.py [FOLDER]
"""

import heapq
import sys
from pathlib import Path

import numpy as np
from plants import arm, arm_starts

from hdsafebo import Limit, Objective, Real, Study, System, plots

SYSTEM = System(
    name="arm",
    parameters=[Real(f"gain_{j}", 0.1, 40.0, unit="Nm/rad", log=True) for j in range(1, 13)],
    objective=Objective("tracking_error", "minimise", unit="mm"),
    limits=[Limit("torque", at_most=40.0, unit="Nm"), Limit("clearance", at_least=5.0, unit="mm")],
)
MINUTES = {"fast": 1.0, "usual": 1.5, "slow": 2.5}  # per trial


def main(folder: Path, trials: int = 60, seed: int = 0) -> Study:
    rng = np.random.default_rng(seed)
    study = Study.open(folder / "arm.hdsafebo", SYSTEM, seed=seed)  # goes on where it was, if it exists
    study.observe(arm_starts(20, rng))
    busy = [(minutes, robot, study.ask()) for robot, minutes in MINUTES.items()]
    for _ in range(trials):
        clock, robot, done = heapq.heappop(busy)  # the next robot to finish
        study.tell(done, arm(done.setting, rng))
        heapq.heappush(busy, (clock + MINUTES[robot], robot, study.ask()))
    plots.progress(study).savefig(folder / "progress.png")
    print(study.best().believed)
    return study


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "."))
