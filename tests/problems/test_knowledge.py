"""What a task gives, and what a method leaves of it."""

from __future__ import annotations

from hdsafebo.optimizers.registry import method_class
from hdsafebo.problems.knowledge import TaskKnowledge

INFORMED = TaskKnowledge(
    latent_space="codes", kernel_features="drives", safety="no_drop", extra_trials="50 episodes"
)


def unused(method: str, *, original: bool = False) -> list[str]:
    return INFORMED.unused(method_class(method)[0].uses, original=original)


def test_what_is_given_has_words() -> None:
    assert INFORMED.given() == {
        "latent_space": "codes",
        "kernel_features": "drives",
        "safety": "no_drop",
        "extra_trials": "50 episodes",
    }
    assert TaskKnowledge().given() == {}


def test_methods_with_the_common_model_use_all_of_it() -> None:
    for method in ("hdsafebo", "linebo", "config", "hdsafebo_local", "safeopt"):
        assert unused(method) == []


def test_methods_without_a_kernel_leave_its_features() -> None:
    assert unused("cmaes") == unused("scbo") == unused("cei") == ["kernel_features", "extra_trials"]
    assert unused("sobol") == ["kernel_features", "safety", "extra_trials"]
    assert unused("baxus") == ["latent_space", "kernel_features", "safety", "extra_trials"]


def test_in_the_original_space_no_latent_space_is_used() -> None:
    assert unused("hdsafebo_local", original=True) == ["latent_space"]
