"""From the name of a task to its problem and the space it is searched in."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

from hdsafebo.errors import UnknownNameError
from hdsafebo.params import Params
from hdsafebo.problem import Codec, Problem
from hdsafebo.typing import FloatArray


@dataclass(frozen=True)
class Task:
    """One problem instance and its latent space.

    Attributes:
        problem: what is optimised.
        embedding: gives the embedding of the latent space from the (n, D) initial inputs (fitted on
            them, or loaded); None when the task is searched in its original space only.
        inputs: files the task reads, relative to the root (a run depends on their content).
        latent_bounds: (2, d) box of the latent space: limits of the codes of the points that the
            embedding was trained on (paper, appendix); None takes the codes of the initial trials.
    """

    problem: Problem
    embedding: Callable[[FloatArray], Codec] | None
    inputs: tuple[str, ...] = ()
    latent_bounds: FloatArray | None = None


_FAMILIES = {
    "synthetic": "hdsafebo.problems.synthetic",
    "hand": "hdsafebo.problems.hand",
    "scs": "hdsafebo.problems.stimulation",
    "digits": "hdsafebo.problems.digits",
}


def family_names() -> list[str]:
    """The families of tasks."""
    return sorted(_FAMILIES)


def family_of(task: str) -> str:
    """The family of a task: `scs_st` belongs to `scs`.

    Raises:
        UnknownNameError: no family has that name; the message lists the families.
    """
    family = task.split("_")[0]
    if family not in _FAMILIES:
        raise UnknownNameError("task", task, sorted(_FAMILIES))
    return family


def task_module(family: str) -> str:
    """The module of a family of tasks, by the name that `family_of` gives."""
    return _FAMILIES[family]


def make_task(name: str, params: Params, *, method: str, seed: int, root: Path) -> Task:
    """Build a task for one run.

    Every module of a family has a function `make_task` with the same signature. The problem depends on
    `seed` alone, so that all methods meet the same problem and the same initial trials; `method` may
    only decide which safety functions are modelled and which feature map is offered.

    Args:
        name: task name, such as `synthetic`, `hand`, `scs_st`, `digits_3`.
        params: the parameters.
        method: name of the method that will run.
        seed: seed of the run.
        root: directory below which the task's files lie.

    Raises:
        UnknownNameError: there is no such task.
    """
    task: Task = import_module(task_module(family_of(name))).make_task(
        name, params, method=method, seed=seed, root=root
    )
    return task
