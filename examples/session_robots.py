"""A session for three robots: a person approves each trial, and results come in any order.

The same steps are `hdsafebo session suggest`, `approve` and `record` on the command line, and buttons on the
page of `hdsafebo session serve`.
"""

import tempfile
from pathlib import Path

import numpy as np
from plants import grasp

from hdsafebo import Session, create_session
from hdsafebo.session.spaces.space import Report

FILES = Path(__file__).parent / "session_box"
ROBOTS = ("left", "middle", "right")


def main(folder: Path, rounds: int = 8, seed: int = 0) -> Session:
    rng = np.random.default_rng(seed)
    session = create_session(
        folder / "gripper", FILES / "session.yaml", who="ann", initial=FILES / "initial.csv"
    )
    for _ in range(rounds):
        running = []
        for robot in ROBOTS:
            suggestion = session.suggest(f"ann, {robot}")
            print(session.space.describe(suggestion.point), suggestion.belief["safe_probability"])
            running.append(session.approve(f"ann, {robot}", suggestion.number))
        for trial in rng.permutation(running):  # whichever robot is done first
            values = grasp(session.space.row(trial.point), rng)
            session.record("ann", Report(values=values), trial.number)
    best = session.best()
    print("best safe:", session.space.describe(best.point), best.outcomes)
    return session


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as made:
        main(Path(made))
