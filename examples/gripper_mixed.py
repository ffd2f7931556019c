"""Numbers, whole numbers and a choice; a rule that always holds; known noise; starts from a CSV file."""

from pathlib import Path

import numpy as np
import pandas as pd
from plants import gripper

from hdsafebo import Choice, Integer, Limit, Objective, Real, Study, System

SYSTEM = System(
    name="gripper",
    parameters=[
        Real("frequency", 1, 200, unit="Hz", log=True),
        Real("current", 0, 20, unit="mA"),
        Real("angle", -30, 30, unit="degrees", step=0.5),
        Integer("pulses", 1, 8),
        Integer("rest", 0, 10),
        Choice("pad", ["soft", "ribbed", "hard"]),
    ],
    objective=Objective("error", "minimise", unit="mm", noise=0.1),
    limits=[Limit("temperature", at_most=60, unit="C", noise=0.5), Limit("grip", at_least=2, noise=0.1)],
    constraints=["2*pulses + rest <= 14"],
)


def main(trials: int = 60, seed: int = 0) -> Study:
    rng = np.random.default_rng(seed)
    study = Study(SYSTEM, alpha=0.95, seed=seed)
    study.observe(pd.read_csv(Path(__file__).parent / "gripper_starts.csv"))
    for _ in range(trials):
        suggestion = study.ask()
        study.tell(suggestion, gripper(suggestion.setting, rng))
    print(study.best().believed, "one more trial may gain", round(study.expected_gain(), 3), "mm")
    return study


if __name__ == "__main__":
    main()
