"""Every method continues a run that was cut to the bit, from its saved state and without one."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from hdsafebo.campaign import run_spec
from hdsafebo.campaign.rounds import Round, RunJournal
from hdsafebo.campaign.run_spec import RunSpec
from hdsafebo.campaign.runner import run
from hdsafebo.optimizers.registry import METHODS
from hdsafebo.runs.schema import TIMES

FAST = ("hdsafebo", "hdsafebo_local", "sobol")
ON_FINITE_SETS = ("random_lowest", "thompson_rows")


class Cut(Exception):
    """Stands for whatever ends a process."""


def spec_of(root: Path, method: str) -> RunSpec:
    """A small run on the synthetic task."""
    problem = {"dimension": 40, "latent_dimension": 8, "effective_dimension": 5}
    budget = {"initial": 30, "trials": 60, "batch": 6, "seeds": 1}
    nothing: dict[str, Any] = {"budget": budget, "methods": []}
    params = {
        "profile": "test",
        "tasks": {
            "synthetic": nothing | {"problem": problem},
            "hand": nothing,
            "scs": nothing | {"tasks": []},
            "body": nothing,
            "digits": nothing | {"tasks": []},
        },
        "methods": {method: {}},
    }
    (root / "progress").mkdir(parents=True)
    return RunSpec("synthetic", method, 1000, params, str(root), str(root / "progress"))


@pytest.mark.parametrize("state_share", [float("inf"), 1e-12], ids=["states", "first state only"])
@pytest.mark.parametrize(
    "method",
    [
        m if m in FAST else pytest.param(m, marks=pytest.mark.slow)
        for m in sorted(set(METHODS) - set(ON_FINITE_SETS))
    ],
)
def test_a_run_that_is_cut_twice_is_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, method: str, state_share: float
) -> None:
    monkeypatch.setattr(run_spec, "code_digest", lambda family, method: "the code under test")
    monkeypatch.setattr("hdsafebo.campaign.runner._STATE_SHARE", state_share)
    undisturbed = run(spec_of(tmp_path / "a", method)).rows
    spec = spec_of(tmp_path / "b", method)
    real = RunJournal.append
    for rounds in (2, 2):
        left = iter(range(rounds))

        def append(self: RunJournal, entry: Round, left=left) -> None:  # type: ignore[no-untyped-def]
            if next(left, None) is None:
                raise Cut
            real(self, entry)

        with monkeypatch.context() as patch:
            patch.setattr(RunJournal, "append", append)
            with pytest.raises(Cut):
                run(spec)
    continued = run(spec).rows
    assert list(continued) == list(undisturbed)
    for name in set(continued) - set(TIMES):
        assert continued[name].tobytes() == undisturbed[name].tobytes(), name
