"""The stage that plays the best policies again, with and without a renderer."""

from __future__ import annotations

import importlib.util
import json
from argparse import Namespace
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
from report.run_files import trial_table, write_run

from hdsafebo.errors import RenderingUnavailableError
from hdsafebo.hand.render import SceneRenderer
from hdsafebo.hand.rollout import Scene
from hdsafebo.hand.synergies import Synergies, save_synergies
from hdsafebo.params.hand import Hand, HandScene
from hdsafebo.pictures import offscreen
from hdsafebo.pipeline.stage import Stage
from hdsafebo.pipeline.tracking import Tracker
from hdsafebo.problems.hand import SYNERGY_FILE

HAND = Hand(scene=HandScene(variant="forearm", horizon=8))
RUNS = {
    "sobol": ([1.0, 5.0], [True, True]),
    "hdsafebo_local": ([3.0, 2.0], [True, True]),
    "cmaes": ([4.0, 9.0], [True, True]),
    "hdsafebo": ([2.0, 8.0], [False, False]),  # nothing safe, so it is not shown
    "local_random": ([0.0, 1.0], [True, True]),
}


@pytest.fixture(scope="module")
def script(project_root: Path) -> ModuleType:
    path = project_root / "stages/replay_policies.py"
    spec = importlib.util.spec_from_file_location("replay_policies", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def stage(tmp_path: Path) -> Stage:
    """A project with run files of two proposed trials each."""
    (tmp_path / SYNERGY_FILE).parent.mkdir(parents=True)
    hand = Scene("forearm", horizon=8).simulation().hand
    basis = np.eye(43)[:10]
    synergies = Synergies(
        np.full(43, 0.3), basis, np.linspace(0.1, 1, 10), hand.muscles, hand.variant, hand.digest
    )
    save_synergies(tmp_path / SYNERGY_FILE, synergies)
    z = 0.1 * np.random.default_rng(0).standard_normal((3, 275))
    for method, (objective, safe) in RUNS.items():
        safety = [1.0 if known else -1.0 for known in (True, *safe)]
        trials = trial_table(0, [-9.0, *objective], safety, n_initial=1, batch=1)
        write_run(tmp_path, "hand_informed", method, [trials], n_initial=1, batch=1, z=z.tolist())
    task = SimpleNamespace(tasks=["hand", "hand_informed"], methods=list(RUNS))
    params = SimpleNamespace(hand=HAND, tasks=SimpleNamespace(hand=task))
    tracker = Tracker("replay_policies", {}, tmp_path, enabled=False)
    return Stage("replay_policies", params, tmp_path, Namespace(), tracker)  # type: ignore[arg-type]


def policies(stage: Stage) -> dict:
    return json.loads((stage.root / "data/policies/policies.json").read_text())


def test_three_policies_are_drawn(script: ModuleType, stage: Stage) -> None:
    try:
        SceneRenderer(Scene("forearm", horizon=8).simulation().model, 64, 48).close()
    except RenderingUnavailableError as error:
        pytest.skip(str(error))
    script.main(stage)
    content = policies(stage)
    shown = [(entry["method"], entry["trial"], entry["picture"]) for entry in content["policies"]]
    assert shown == [
        ("hdsafebo_local", 1, "1_hdsafebo_local.png"),
        ("cmaes", 2, "2_cmaes.png"),
        ("sobol", 2, "3_sobol.png"),
    ]
    assert content["missing"] is None
    for _, _, name in shown:
        assert (stage.root / "data/policies" / name).read_bytes()[1:4] == b"PNG"
    assert (stage.root / "data/policies/best_policy.mp4").stat().st_size > 1000


def test_without_a_renderer_a_notice_says_what_to_install(
    script: ModuleType, stage: Stage, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(offscreen, "find_library", lambda name: None)
    script.main(stage)
    assert "NOTICE [replay_policies]: no pictures of the best policies" in caplog.text
    content = policies(stage)
    assert "apt-get install libosmesa6" in content["missing"]
    assert [entry["picture"] for entry in content["policies"]] == [None] * 3
    assert all(np.isfinite(entry["replayed"]) for entry in content["policies"])
