"""A task and a method that take milliseconds, to be used in worker processes in place of `synthetic`.

The task has a memory and the method a state of its own, so that a run can only be continued to the bit by
restoring both.
"""

from __future__ import annotations

import os
import signal
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hdsafebo.campaign import run_spec
from hdsafebo.campaign.run_spec import RunSpec
from hdsafebo.campaign.runner import RunResult, run
from hdsafebo.errors import NoSafePointError
from hdsafebo.optimizers import registry as methods
from hdsafebo.optimizers.base import Optimizer, Proposal
from hdsafebo.optimizers.settings import OptimizerSettings
from hdsafebo.params import Params
from hdsafebo.problem import Problem, Safety
from hdsafebo.problems import registry as tasks
from hdsafebo.trials import Evaluation, Trials
from hdsafebo.typing import FloatArray


class Memory(Problem):
    """A bowl with noise whose generator goes on from one evaluation to the next."""

    def __init__(self, seed: int, seconds: float) -> None:
        self.name = "synthetic"
        self.bounds = np.array([[-1.0] * 6, [1.0] * 6])
        self.safety = (Safety("hidden", -9.0, reported=False), Safety("margin", -1.5), Safety("second", -0.9))
        self.optimum = float(seed)
        self._rng = np.random.default_rng(seed)
        self._seconds = seconds
        self.evaluated = 0

    def evaluate(self, trials: Trials) -> Evaluation:
        time.sleep(self._seconds)
        self.evaluated += len(trials)
        noise = 0.1 * self._rng.normal(size=len(trials))
        objective = -(trials.x**2).sum(axis=1) + noise
        safety = np.stack([objective * 0, objective, trials.x[:, 0]], axis=1)
        return Evaluation(objective, safety, failed=trials.x[:, 1] > 0.9)


class Half:
    """An embedding that keeps every second coordinate."""

    def encode(self, x: FloatArray) -> FloatArray:
        return x[:, ::2]

    def decode(self, z: FloatArray) -> FloatArray:
        return np.repeat(z, 2, axis=1)


class ToySettings(OptimizerSettings):
    abstain_after: int = 10**6


class Toy(Optimizer):
    """Steps around the best point, of a size that it remembers."""

    name = "toy"
    Settings = ToySettings
    settings: ToySettings
    step = 1.0

    def propose(self, n: int) -> Proposal:
        if len(self.trials) >= self.settings.abstain_after:
            raise NoSafePointError("the toy has seen enough")
        best = self.best()
        d = self.space.bounds.shape[1]
        centre = np.full(d, 0.5) if best is None else self.space.to_unit(best.z[None])[0]
        points = np.clip(centre + self.step * self.rng.normal(size=(n, d)), 0, 1)
        return Proposal(points, trust_region_length=self.step)

    def finish_round(self, trials: Trials) -> None:
        self.step *= 0.97

    def method_state(self) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
        return {"step": self.step}, {}

    def restore_method_state(self, state: dict[str, Any], arrays: dict[str, NDArray[Any]]) -> None:
        self.step = state["step"]


class Lonely(Toy):
    """Asks for its first trials itself."""

    name = "lonely"
    uses_initial_data = False

    def __init__(self, problem: Problem, **options: Any) -> None:
        super().__init__(problem, **(options | {"bounds": [[-1.0] * 3, [1.0] * 3]}))


def make_task(name: str, params: Params, *, seed: int, root: Path) -> tasks.Task:
    """The toy task; `length_scale` stands for the seconds of an evaluation."""
    problem = Memory(seed, params.tasks.synthetic.problem.length_scale)
    return tasks.Task(problem, lambda x: Half(), inputs=("data/input.txt",))


def install() -> None:
    """Make the toys known in this process, and its code stand still while it is worked on."""
    run_spec.code_digest = lambda family, method: "the code under test"
    tasks._FAMILIES["synthetic"] = __name__
    sys.modules["hdsafebo.optimizers.toys"] = sys.modules[__name__]
    methods.METHODS["toy"] = methods.Method("toys", "Toy")
    methods.METHODS["lonely"] = methods.Method("toys", "Lonely")


def run_toy(spec: RunSpec) -> RunResult:
    """`runner.run` in a process that knows the toys."""
    install()
    return run(spec)


def toy_params(
    *,
    initial: int = 10,
    trials: int = 130,
    batch: int = 3,
    seeds: int = 1,
    seconds: float = 1e-9,
    **settings: Any,
) -> dict[str, Any]:
    """Parameters with toy methods only."""
    budget = {"initial": initial, "trials": trials, "batch": batch, "seeds": seeds}
    nothing = {"budget": budget, "methods": []}
    return {
        "profile": "test",
        "tasks": {
            "synthetic": {"problem": {"length_scale": seconds}, "budget": budget, "methods": ["toy"]},
            "hand": nothing,
            "scs": nothing | {"tasks": []},
            "body": nothing,
            "digits": nothing | {"tasks": []},
        },
        "methods": {
            "toy": settings,
            "lonely": settings,
            "toy_inputs": {"algorithm": "toy", "space": "original"} | settings,
        },
        "tracking": {"enabled": False},
    }


def toy_spec(root: Path, *, method: str = "toy", seed: int = 7, **changes: Any) -> RunSpec:
    """A run of the toys below `root`."""
    install()
    (root / "data").mkdir(parents=True, exist_ok=True)
    if not (root / "data" / "input.txt").exists():
        (root / "data" / "input.txt").write_text("read by the task")
    (root / "progress").mkdir(exist_ok=True)
    return RunSpec("synthetic", method, seed, toy_params(**changes), str(root), str(root / "progress"))


def run_toy_and_die_once(spec: RunSpec) -> RunResult:
    """`run_toy`, killing its process in mid-run the first time that a file asks for it."""
    install()
    marker = Path(spec.root) / "kill-me"
    evaluate = Memory.evaluate

    def evaluate_or_die(self: Memory, trials: Trials) -> Evaluation:
        if self.evaluated > 30 and marker.exists():
            marker.unlink()
            os.kill(os.getpid(), signal.SIGKILL)
        return evaluate(self, trials)

    Memory.evaluate = evaluate_or_die  # type: ignore[method-assign]
    return run(spec)
