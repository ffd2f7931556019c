"""Predicted safe probabilities are what they say on problems that are drawn from the model."""

from __future__ import annotations

import sys
from functools import cache
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from scipy.special import ndtr, ndtri
from scipy.stats import binomtest

FEW, ALL = 20, 200
ROUNDS = {FEW: 8, ALL: 5}
JOINT = 0.99
"""Confidence with which all bins of a run together hold their predictions."""
SIZES = pytest.mark.parametrize("problems", [FEW, pytest.param(ALL, marks=pytest.mark.slow)])


@cache
def benchmark() -> ModuleType:
    """The benchmark, whose problems and tables these are."""
    path = Path(__file__).parents[2] / "benchmarks" / "calibration.py"
    spec = spec_from_file_location("benchmark_calibration", path)
    assert spec is not None
    assert spec.loader is not None
    module = module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


@cache
def asked(problems: int, alpha: float, *, given: bool = True) -> Any:
    """Trials on the problems with seeds from 1000 up."""
    seeds = range(1000, 1000 + problems)
    return benchmark().ask_all(seeds, alpha, ROUNDS[problems], given=given)


def outside(table: dict[str, Any]) -> list[dict[str, Any]]:
    """Bins whose mean prediction is not in the interval of what was observed."""
    bins = table["bins"]
    level = 1 - (1 - JOINT) / len(bins)
    found = []
    for b in bins:
        limits = binomtest(round(b["trials"] * b["observed"]), b["trials"]).proportion_ci(level, "exact")
        if not limits.low <= b["predicted"] <= limits.high:
            found.append(b)
    return found


@SIZES
@pytest.mark.parametrize("alpha", benchmark().ALPHAS)
@pytest.mark.thorough
def test_given_the_hyper_parameters_every_bin_holds_its_prediction(problems: int, alpha: float) -> None:
    table = benchmark().calibration(asked(problems, alpha), alpha)
    assert table["bins"][-1]["trials"] > problems / 2
    assert not outside(table), table


@SIZES
@pytest.mark.parametrize("alpha", benchmark().ALPHAS)
def test_of_the_trials_believed_safe_a_share_alpha_is_safe(problems: int, alpha: float) -> None:
    table = benchmark().calibration(asked(problems, alpha), alpha)
    assert table["trials"] - table["marked"] > 0.8 * problems * ROUNDS[problems]
    assert table["safe_share_high"] >= alpha, table
    believed = ~np.array(asked(problems, alpha).marked)
    assert (np.array(asked(problems, alpha).predicted)[believed] >= alpha - 1e-6).all()


@pytest.mark.slow
@pytest.mark.parametrize("alpha", benchmark().ALPHAS)
def test_with_fitted_hyper_parameters_a_share_alpha_is_safe_too(alpha: float) -> None:
    table = benchmark().calibration(asked(ALL, alpha, given=False), alpha)
    assert table["safe_share_high"] >= alpha, table


def test_predictions_reach_into_all_bins() -> None:
    low = benchmark().ALPHAS[0]
    assert len(benchmark().calibration(asked(FEW, low), low)["bins"]) == 10


@pytest.mark.parametrize(("alpha", "factor"), [(benchmark().ALPHAS[0], 0.4), (0.95, 2.5)])
def test_a_wrong_deviation_is_noticed(alpha: float, factor: float) -> None:
    """The same trials, predicted with a deviation that is wrong by a factor."""
    trials = asked(FEW, alpha)
    quantile = ndtri(np.clip(trials.predicted, 1e-12, 1 - 1e-12))
    wrong = benchmark().Asked(ndtr(quantile / factor).tolist(), trials.safe, trials.marked)
    assert outside(benchmark().calibration(wrong, alpha))
