"""The section on the hand: who ends upright, how hard the task is, pictures of the best policies."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from hdsafebo.errors import DatasetError
from hdsafebo.report.data.hand_inputs import HandInputs, StoredDifficulty, read_hand
from hdsafebo.report.data.inputs import StoredPicture, read_inputs
from hdsafebo.report.data.results import Results
from hdsafebo.report.sections.base import Text
from hdsafebo.report.sections.hand import hand_section
from hdsafebo.report.tables.hand import Upright, upright, upright_finding
from hdsafebo.report.tables.results import Table
from hdsafebo.runs.read import read_runs
from report.run_files import trial_table, write_run

DIFFICULTY = {
    "policies": 200,
    "dropped": 0.34,
    "upright": 0.025,
    "safe": 0.895,
    "landing_limit": 4.4,
    "return_quantiles": [-1185.0, -1004.0, -578.0, -75.0, 175.0],
    "zero_policy_tilt": 2.86,
    "zero_policy_upright": False,
}
POLICY = {
    "method": "hdsafebo_local",
    "seed": 3,
    "objective": 423.3,
    "replayed": 423.3,
    "tilt": 0.12,
    "upright": True,
    "dropped": False,
    "failure": None,
    "picture": "1_hdsafebo_local.png",
}


def outcomes(objective: list[float], safe: list[bool], tilted: list[float], n_initial: int) -> pd.DataFrame:
    n = len(objective)
    return pd.DataFrame(
        {
            "seed": [0] * n,
            "trial": range(n),
            "initial": [k < n_initial for k in range(n)],
            "objective": objective,
            "safe": safe,
            "status": ["completed"] * n,
            "safety_no_drop": [1.0 if s else -0.5 for s in safe],
            "safety_upright": tilted,
        }
    )


def test_trials_until_the_best_safe_policy_is_upright() -> None:
    # The upright policy of trial 2 is not the best one, that of trial 4 not safe; that of trial 5 counts.
    rows = outcomes([1, 3, 2, 4, 9, 6], [True] * 4 + [False, True], [-1, -1, 0.1, -1, 0.1, 0.1], 2)
    found = upright("sobol", rows)
    assert (found.trials.mean, found.ended, found.runs) == (6, 1, 1)
    assert found.objective.mean == 6
    assert found.safety.mean == found.held.mean == pytest.approx(0.75)
    again = upright("sobol", rows.assign(safety_upright=[0.1, 0.1, -1, -1, -1, -1]))
    assert (again.trials.mean, again.ended) == (2, 0)  # so it was among the initial policies, and lost
    never = upright("sobol", rows.assign(safety_upright=-1.0))
    assert (never.trials.mean, never.ended) == (6, 0)
    only_unsafe = upright("sobol", rows.assign(safe=False, safety_upright=0.1))
    assert (only_unsafe.trials.mean, only_unsafe.ended) == (6, 0)


def test_comparison_is_among_safe_methods() -> None:
    safe = [True] * 20
    calm = upright("hdsafebo_local", outcomes([1.0] * 10 + [5.0] * 10, safe, [-1] * 10 + [0.1] * 10, 10))
    bold = upright("local_random", outcomes([9.0] * 20, [True] * 18 + [False] * 2, [0.1] * 20, 10))
    text = upright_finding([calm, bold])
    assert "HdSafeBO-local has the highest mean return (5.00)" in text
    assert "9.0" not in text
    assert "Fewest trials until upright: HdSafeBO-local (11.0)" in text
    tied = upright_finding([calm, replace(calm, method="sobol")])
    assert "Fewest trials until upright: HdSafeBO-local and Sobol search (11.0)" in tied
    assert isinstance(bold, Upright)
    assert not bold.safe_enough
    assert upright_finding([bold]) == "No method has a mean Safety of 0.95."


def blocks_of(root: Path) -> list:
    inputs = read_inputs(root, root / "data/runs")
    return hand_section(Results(read_runs(root / "data/runs")), inputs).blocks


def texts(blocks: list) -> str:
    return "\n".join(block.text for block in blocks if isinstance(block, Text))


def write_policies(root: Path, missing: str | None) -> None:
    folder = root / "data/policies"
    folder.mkdir(parents=True, exist_ok=True)
    policy = POLICY if missing is None else POLICY | {"picture": None}
    content = {"frames_at_s": [0.0, 2.4], "missing": missing, "policies": [policy]}
    (folder / "policies.json").write_text(json.dumps(content))
    if missing is None:
        (folder / "1_hdsafebo_local.png").write_bytes(b"\x89PNG strip")


def test_section_tells_difficulty_policies_and_who_is_upright(tmp_path: Path) -> None:
    (tmp_path / "data/synergies").mkdir(parents=True)
    (tmp_path / "data/synergies/random_policies.json").write_text(json.dumps(DIFFICULTY))
    write_policies(tmp_path, None)
    table = trial_table(0, [1.0, 2.0, 3.0], [0.0] * 3, n_initial=1, batch=1)
    path = write_run(tmp_path, "hand", "hdsafebo_local", [table], n_initial=1, batch=1)
    stored = pq.read_table(path)
    for name, values in {"safety_no_drop": [1.0] * 3, "safety_upright": [-1.0, 0.1, 0.1]}.items():
        stored = stored.append_column(name, pa.array(values))
    pq.write_table(stored, path)
    write_run(tmp_path, "hand", "sobol", [table], n_initial=1, batch=1)
    found = blocks_of(tmp_path)
    told = texts(found)
    assert "34 % drop the bottle" in told
    assert "2.5 % end upright" in told
    assert "does not end upright (tilt 2.86 rad)" in told
    assert "walks of 300 Gaussian steps" in told
    assert "In the informed setting every method models no_drop" in told
    assert "not in the run files of Sobol" in told
    strips = [block for block in found if isinstance(block, StoredPicture)]
    assert [strip.data for strip in strips] == [b"\x89PNG strip"]
    assert strips[0].title == "HdSafeBO-local, seed 3: return 423; upright, tilt at the end 0.120 rad"
    [who] = [block for block in found if isinstance(block, Table) and block.name == "upright_hand"]
    assert who.frame["trials"].tolist() == [2.0]
    assert who.frame["ended_upright"].tolist() == [1]


def test_without_a_renderer_the_section_says_what_is_missing(tmp_path: Path) -> None:
    write_policies(tmp_path, "pictures need an OpenGL renderer; apt-get install libosmesa6")
    told = texts(blocks_of(tmp_path))
    assert "No pictures: pictures need an OpenGL renderer; apt-get install libosmesa6." in told
    assert "return 423; upright" in told


def test_nothing_was_made(tmp_path: Path) -> None:
    assert read_hand(tmp_path, tmp_path) == HandInputs(None, None, {}, {})
    assert "Random policies: not run" in texts(blocks_of(tmp_path))


@pytest.mark.parametrize("content", ["{", "{}"])
def test_malformed_files_are_errors(tmp_path: Path, content: str) -> None:
    assert StoredDifficulty.model_validate(DIFFICULTY).policies == 200
    (tmp_path / "data/synergies").mkdir(parents=True)
    (tmp_path / "data/synergies/random_policies.json").write_text(content)
    with pytest.raises(DatasetError, match=r"random_policies\.json"):
        read_hand(tmp_path, tmp_path)
