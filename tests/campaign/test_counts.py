"""Failed fits, marked trials and abstentions are in the run file, the same after any number of cuts."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import campaign_toys as toys
import pyarrow.parquet as pq
import pytest
from campaign_items import compute

from hdsafebo.campaign.item import run_path
from hdsafebo.campaign.journal import Journal
from hdsafebo.campaign.runner import RunResult
from hdsafebo.gp import fit as gp_fit
from hdsafebo.optimizers.hdsafebo import HdSafeBO
from hdsafebo.runs.schema import METADATA_KEY, RunCounts

_EVALUATE = gp_fit._Search._evaluate


class Cut(Exception):
    """Stands for whatever ends a process."""


def use_hdsafebo(patch: pytest.MonkeyPatch) -> None:
    """Let the toy be the paper's algorithm with few candidates, whose fits fail when this file says so."""

    class Small(HdSafeBO):
        name = "toy"

        def __init__(self, *args: Any, **settings: Any) -> None:
            super().__init__(*args, **({"candidates": 64} | settings))

    patch.setattr(toys, "Toy", Small)


def execute_here(function: Any, items: Any, on_result: Any, watcher: Any, **options: Any) -> None:
    """Runs in this process, which alone knows what was patched."""
    for item in items:
        on_result(item, function(item))


def fail_fits(patch: pytest.MonkeyPatch, *, below: float) -> None:
    """Every fit of more than 12 trials needs this much jitter."""

    def evaluate(self: Any, theta: Any, jitter: float) -> Any:
        failed = len(self.values) > 12 and jitter < below
        return None if failed else _EVALUATE(self, theta, jitter)

    patch.setattr(gp_fit._Search, "_evaluate", evaluate)


def test_jitters_and_fallbacks_are_counted_and_survive_cuts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    use_hdsafebo(monkeypatch)
    fail_fits(monkeypatch, below=1e-6)
    undisturbed = toys.run_toy(toys.toy_spec(tmp_path / "a", trials=25))
    counts = undisturbed.counts
    # Rounds 1 to 5 are asked with 10 (of which some failed) to 22 trials and four processes each.
    assert counts.fits == 20
    assert 0 < counts.jitters == counts.fallbacks < counts.fits
    assert (counts.missing, counts.abstained) == (0, None)
    real = Journal.append
    for state_share in (float("inf"), 1e-12):
        spec = toys.toy_spec(tmp_path / str(state_share), trials=25)
        result = None
        with monkeypatch.context() as patch:
            patch.setattr("hdsafebo.campaign.runner._STATE_SHARE", state_share)
            for _ in range(20):
                left = iter(range(5))

                def limited(*arguments: Any, left: Any = left) -> Any:
                    if next(left, None) is None:
                        raise Cut
                    return real(*arguments)

                patch.setattr(Journal, "append", limited)
                try:
                    result = toys.run_toy(spec)
                    break
                except Cut:
                    continue
        assert isinstance(result, RunResult)
        assert result.counts == counts
        assert toys.run_toy(spec).counts == counts, "read from the journal"


def test_a_run_whose_fits_all_fail_ends_as_an_abstention(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    use_hdsafebo(monkeypatch)
    fail_fits(monkeypatch, below=1.0)
    result = toys.run_toy(toys.toy_spec(tmp_path, trials=40))
    assert len(result.rows["trial"]) < 20
    assert result.counts.missing == 40 - len(result.rows["trial"])
    assert result.abstained is not None
    assert "no Cholesky factor" in result.abstained


def test_the_run_file_holds_the_counts_of_each_seed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    use_hdsafebo(monkeypatch)
    monkeypatch.setattr("hdsafebo.campaign.item.run", toys.run_toy)
    monkeypatch.setattr("hdsafebo.campaign.item.execute", execute_here)
    compute(tmp_path, seeds=2, trials=22, alpha=1 - 1e-12)  # next to nothing can be believed safe
    metadata = json.loads(pq.read_schema(run_path("synthetic", "toy", tmp_path)).metadata[METADATA_KEY])
    counts = [RunCounts(**entry) for entry in metadata["counts"]]
    assert len(counts) == len(metadata["seeds"]) == 2
    table = pq.read_table(run_path("synthetic", "toy", tmp_path)).to_pandas()
    for seed, count in zip(metadata["seeds"], counts, strict=True):
        assert count.marked == table["marked_unsafe"][table["seed"] == seed].sum()
        assert (count.fits, count.missing, count.abstained) == (16, 0, None)
    assert sum(count.marked for count in counts) > 0


def test_trials_that_abstention_left_out_are_counted(tmp_path: Path) -> None:
    result = toys.run_toy(toys.toy_spec(tmp_path, trials=60, abstain_after=31))
    assert result.counts == RunCounts(
        fits=0, jitters=0, fallbacks=0, marked=0, missing=29, abstained="the toy has seen enough"
    )
