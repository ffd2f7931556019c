"""What a newcomer meets: names, signatures, the module as a command, and what a default promises."""

from __future__ import annotations

import inspect
import subprocess
import sys
import warnings

import numpy as np
import pytest

import hdsafebo
from hdsafebo import FunctionProblem, HdSafeBO, HdSafeBOLocal, make_optimizer
from hdsafebo.errors import OptimisticWarning


def problem() -> FunctionProblem:
    return FunctionProblem(lambda x: (-(x**2).sum(1), 1 - x.sum(1)), [[0.0] * 3, [1.0] * 3], name="plain")


def test_public_names_are_shown_and_there() -> None:
    assert set(hdsafebo.__all__) <= set(dir(hdsafebo))
    for name in hdsafebo.__all__:
        assert getattr(hdsafebo, name) is not None
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        _ = hdsafebo.nothing


def test_the_module_is_the_command() -> None:
    result = subprocess.run(
        [sys.executable, "-m", "hdsafebo", "--version"], capture_output=True, text=True, check=True
    )
    assert result.stdout.strip() == f"hdsafebo {hdsafebo.__version__}"


def test_a_class_shows_its_settings() -> None:
    shown = inspect.signature(HdSafeBOLocal).parameters
    assert list(shown)[:4] == ["problem", "embedding", "seed", "bounds"]
    assert shown["beta"].default == -2.0
    assert shown["alpha"].default is None
    assert "batch_success" in inspect.signature(HdSafeBO).parameters
    assert not any(p.kind == p.VAR_KEYWORD for p in shown.values())


def test_a_default_that_promises_little_is_said_once_it_is_not_chosen() -> None:
    with pytest.warns(OptimisticWarning, match=r"beta = 2, .* safe probability of 0\.023 .* pass alpha"):
        HdSafeBO(problem())
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        HdSafeBO(problem(), beta=2.0)
        HdSafeBO(problem(), alpha=0.9)
        HdSafeBOLocal(problem())
        make_optimizer("hdsafebo_pessimistic", problem())


def test_the_text_of_a_table_is_short_and_says_what_is_believed() -> None:
    optimizer = HdSafeBOLocal(problem(), seed=0)
    x = np.random.default_rng(0).random((30, 3)) * 0.3
    optimizer.observe(x, *optimizer.problem.function(x))  # type: ignore[attr-defined]
    text = repr(optimizer.trials)
    assert text.splitlines()[0] == "Trials: 30, 30 completed; the last 8:"
    assert len(text.splitlines()) == 9
    assert len(text) < 1500
    assert "pending, believed safe with" in repr(optimizer.ask(1))


def test_the_model_takes_the_users_own_inputs() -> None:
    import torch

    for kind in (HdSafeBO, HdSafeBOLocal):
        scaled = FunctionProblem(
            lambda x: (x[:, 0] / 100, 1 - x[:, 1] / 1000), [[0.0, -500.0], [100.0, 500.0]], name="scaled"
        )
        optimizer = kind(scaled, alpha=0.9)
        x = np.random.default_rng(0).uniform(*scaled.bounds, (25, 2))
        optimizer.observe(x, *scaled.function(x))
        mean = optimizer.model.posterior(torch.from_numpy(x)).mean.detach().numpy()
        np.testing.assert_allclose(mean[:, 0], x[:, 0] / 100, atol=0.02)
        np.testing.assert_allclose(mean[:, 1], 1 - x[:, 1] / 1000, atol=0.02)
