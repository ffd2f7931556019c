"""A searched point, played again, does what the task evaluated."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from hdsafebo.errors import HandModelError
from hdsafebo.hand.filmstrip import frame_steps, seconds_of
from hdsafebo.hand.rollout import Scene
from hdsafebo.hand.synergies import Synergies, save_synergies, synergy_policies
from hdsafebo.params import HandProblem
from hdsafebo.params.hand import Hand, HandScene
from hdsafebo.problems.hand import SYNERGY_FILE, HandPolicies, safety_functions
from hdsafebo.problems.hand_replay import replay, scene_of
from hdsafebo.trials import Trials

HAND = Hand(scene=HandScene(variant="forearm", horizon=30))
SCENE = Scene("forearm", horizon=30)


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    directory = tmp_path_factory.mktemp("root")
    (directory / SYNERGY_FILE).parent.mkdir(parents=True)
    hand = SCENE.simulation().hand
    basis = np.linalg.qr(np.random.default_rng(0).standard_normal((43, 10)))[0].T
    shares = np.linspace(0.1, 1, 10)
    synergies = Synergies(np.full(43, 0.3), basis, shares, hand.muscles, hand.variant, hand.digest)
    save_synergies(directory / SYNERGY_FILE, synergies)
    return directory


def test_both_spaces_play_what_the_task_evaluates(root: Path) -> None:
    from hdsafebo.hand.synergies import load_synergies

    space = synergy_policies(SCENE, load_synergies(root / SYNERGY_FILE, SCENE.simulation().hand), 5)
    problem = HandPolicies(SCENE, space, 1.0, safety_functions(HandProblem(), 4.4, ["no_drop"]))
    z = np.random.default_rng(1).uniform(-1, 1, (1, space.dimension))
    x = problem.codec.decode(z)
    evaluation = problem.evaluate(Trials.pending(x, x, len(problem.safety)))
    latent = replay(HAND, z[0], latent=True, root=root)
    original = replay(HAND, x[0], latent=False, root=root)
    assert scene_of(HAND) == SCENE
    assert latent.total_reward == original.total_reward == evaluation.objective[0]
    assert latent.upright == (evaluation.safety[0, 3] >= 0)
    np.testing.assert_array_equal(latent.excitations, original.excitations)
    assert latent.excitations.shape[1] == 43


def test_wrong_sizes_and_missing_synergies_are_refused(root: Path, tmp_path: Path) -> None:
    with pytest.raises(HandModelError, match=r"policy of shape \(7,\); expected \(275,\)"):
        replay(HAND, np.zeros(7), latent=True, root=root)
    with pytest.raises(HandModelError, match=r"expected \(n, 2365\)"):
        replay(HAND, np.zeros(7), latent=False, root=root)
    with pytest.raises(HandModelError, match="cannot be read as synergies"):
        replay(HAND, np.zeros(275), latent=True, root=tmp_path)


def test_frames_of_an_episode() -> None:
    assert frame_steps(120) == (0, 15, 30, 60, 120)
    assert seconds_of(frame_steps(120)) == (0.0, 0.3, 0.6, 1.2, 2.4)
