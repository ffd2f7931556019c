"""The two hands: their size, the moment arms of what was added, and stability."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import mujoco
import numpy as np
import pytest

from hdsafebo.errors import HandModelError, UnknownNameError
from hdsafebo.hand.scene.extension_table import JOINTS, MUSCLES, REATTACHED
from hdsafebo.hand.scene.model import HandModel, hand_model


def moment_arms(hand: HandModel, samples: int = 0) -> np.ndarray:
    """(1 + samples, muscles, joints) in mm, the zero pose first, then random poses within the joint ranges.

    Positive: the muscle drives the joint towards positive angles.
    """
    model, joints = hand.mj, len(hand.joints)
    data = mujoco.MjData(model)
    rng = np.random.default_rng(0)
    arms = np.empty((1 + samples, model.nu, joints))
    dense = np.zeros((model.nu, model.nv))
    for row in range(1 + samples):
        lower, upper = model.jnt_range[:joints].T
        data.qpos[:joints] = rng.uniform(lower, upper) if row else 0.0
        mujoco.mj_forward(model, data)
        mujoco.mju_sparse2dense(
            dense,
            data.actuator_moment.reshape(-1),
            data.moment_rownnz,
            data.moment_rowadr,
            data.moment_colind.reshape(-1),
        )
        arms[row] = -1e3 * dense[:, :joints]
    return arms


@pytest.fixture(scope="module")
def extended() -> HandModel:
    return hand_model("extended")


@pytest.fixture(scope="module")
def arms(extended: HandModel) -> np.ndarray:
    return moment_arms(extended, samples=300)


def test_sizes_are_those_of_the_paper() -> None:
    forearm, extended = hand_model("forearm"), hand_model("extended")
    assert (len(forearm.muscles), len(forearm.joints)) == (43, 23)
    assert (len(extended.muscles), len(extended.joints)) == (55, 28)
    assert extended.muscles[:43] == forearm.muscles
    assert set(forearm.joints) < set(extended.joints)


def test_digest_names_the_model() -> None:
    assert hand_model("extended").digest == hand_model.__wrapped__("extended").digest
    digests = {
        hand_model("extended").digest,
        hand_model("forearm").digest,
        hand_model("extended", 1.0).digest,
    }
    assert len(digests) == 3


def test_myo_sim_is_left_as_it_was() -> None:
    from myo_sim.build import hand as myo_hand

    before = myo_hand.RIGHT_HAND_ACTUATORS
    hand_model.__wrapped__("forearm")
    assert before is myo_hand.RIGHT_HAND_ACTUATORS


def test_threads_build_the_same_hand() -> None:
    with ThreadPoolExecutor(4) as executor:
        hands = list(executor.map(hand_model.__wrapped__, ["forearm"] * 4))
    assert {hand.digest for hand in hands} == {hand_model("forearm").digest}


def test_unknown_variant_lists_the_valid_ones() -> None:
    with pytest.raises(UnknownNameError, match=r"forty.*extended, forearm"):
        hand_model("forty")  # type: ignore[arg-type]


@pytest.mark.parametrize("roll", [-0.1, 2.0, np.nan])
def test_roll_out_of_range_is_refused(roll: float) -> None:
    with pytest.raises(HandModelError, match=r"roll is .*expected 0 to 1\.57"):
        hand_model("forearm", roll)


def test_every_addition_carries_its_source() -> None:
    assert len(MUSCLES) == 12
    assert len(JOINTS) == 5
    for added in (*MUSCLES, *JOINTS):
        assert any(char.isdigit() for char in added.source) or "assumption" in added.source, added.name
    for muscle in MUSCLES:
        assert (muscle.area is None) != (muscle.parent is None), muscle.name


def test_second_heads_leave_the_sum_of_forces() -> None:
    forearm, extended = hand_model("forearm"), hand_model("extended")

    def force(hand: HandModel, name: str) -> float:
        return float(hand.mj.actuator(f"{name}_r").gainprm[2])

    for muscle in MUSCLES:
        if muscle.parent is not None:
            total = force(extended, muscle.name) + force(extended, muscle.parent)
            assert total == pytest.approx(force(forearm, muscle.parent))
    thenar = sum(force(extended, name) for name in ("OP", "APB", "FPBs", "FPBd", "ADPo", "ADPt"))
    assert thenar == pytest.approx(force(forearm, "OP"), rel=0.1)  # MyoHand's OP stands for the whole group


# Signs in MyoHand: thumb flexion is negative, abduction positive; finger and wrist flexion positive;
# mcp5 abduction is negative towards the ulna, mcp2 abduction positive towards the thumb; pronation positive.
# Thumb: "the abductor pollicis brevis was mainly an abductor, the adductor pollicis was a major flexor as
# well as an adductor", flexor pollicis brevis a flexor (Smutz et al., J Biomech 31:565-570, 1998).
ROLES = [
    ("APB", "cmc_abduction", +1, (4, 20)),
    ("APB", "mp_abduction", +1, (4, 15)),
    ("FPBs", "cmc_flexion", -1, (5, 25)),
    ("FPBd", "cmc_flexion", -1, (5, 25)),
    ("FPBd", "mp_flexion", -1, (3, 15)),
    ("ADPo", "cmc_flexion", -1, (5, 35)),
    ("ADPt", "cmc_flexion", -1, (5, 35)),
    ("ADPt", "cmc_abduction", -1, (4, 35)),
    ("ADPo", "mp_flexion", -1, (3, 15)),
    ("ADM", "mcp5_abduction", -1, (1, 15)),
    ("ADM", "cmc5_flexion", +1, (3, 15)),
    ("FDMB", "mcp5_flexion", +1, (3, 15)),
    ("FDMB", "cmc5_flexion", +1, (3, 15)),
    ("ODM", "cmc5_flexion", +1, (3, 15)),
    ("ODM", "cmc5_rotation", +1, (1, 10)),
    ("DI1b", "mcp2_flexion", +1, (1, 12)),
    ("FCUu", "flexion", +1, (8, 25)),
    ("FCUu", "deviation", -1, (4, 20)),
]


@pytest.mark.parametrize(("muscle", "joint", "sign", "limits"), ROLES, ids=lambda value: str(value))
def test_added_muscles_act_as_published(
    extended: HandModel, arms: np.ndarray, muscle: str, joint: str, sign: int, limits: tuple[float, float]
) -> None:
    """The sign holds over the whole range of the joints; the size is between limits, mm."""
    values = sign * arms[:, extended.muscles.index(muscle), extended.joints.index(joint)]
    assert values.min() > min(limits[0], 1.0), values.min()
    assert limits[0] <= np.median(values)
    assert values.max() <= limits[1]


def test_adductor_is_a_stronger_flexor_than_the_other_thenar_muscles(
    extended: HandModel, arms: np.ndarray
) -> None:
    flexion = -arms[0, :, extended.joints.index("cmc_flexion")]
    torque = {
        name: flexion[i] * extended.mj.actuator(f"{name}_r").gainprm[2]
        for i, name in enumerate(extended.muscles)
    }
    assert min(torque["ADPo"], torque["ADPt"]) > max(torque[name] for name in ("APB", "FPBs", "FPBd", "OP"))


@pytest.mark.parametrize(("head", "parent"), [("PTu", "PT"), ("FCUu", "FCU"), ("PQd", "PQ")])
def test_second_heads_of_the_forearm_follow_the_first(
    extended: HandModel, arms: np.ndarray, head: str, parent: str
) -> None:
    one, other = (arms[:, extended.muscles.index(name)] for name in (head, parent))
    assert np.abs(one - other).max() < 2.5


def test_first_dorsal_interosseus_pulls_the_index_towards_the_thumb(
    extended: HandModel, arms: np.ndarray
) -> None:
    """Both heads abduct the straight index finger (Infantolino & Challis, J Anat 216:463-469, 2010)."""
    abduction = arms[0, :, extended.joints.index("mcp2_abduction")]
    for name in ("DI1b", "RI2"):
        assert 3 < abduction[extended.muscles.index(name)] < 12


def test_finger_tendons_cross_only_the_joints_of_their_own_ray(extended: HandModel, arms: np.ndarray) -> None:
    flexion4, flexion5 = (arms[:, :, extended.joints.index(f"cmc{ray}_flexion")] for ray in (4, 5))
    at = extended.muscles.index
    for own, flexion, other in (
        (("FDS4", "FDP4"), flexion4, flexion5),
        (("FDS5", "FDP5"), flexion5, flexion4),
    ):
        for name in own:
            assert flexion[:, at(name)].min() > 2
            assert np.abs(other[:, at(name)]).max() < 1e-9
    for name in ("RI4", "LU_RB4", "UI_UB4", "RI5", "LU_RB5", "UI_UB5"):
        assert np.abs(flexion4[:, at(name)]).max() < 1e-9
        assert np.abs(flexion5[:, at(name)]).max() < 1e-9
    for name in ("EDC5", "EDM"):
        assert flexion5[:, at(name)].max() < 0


def test_reattached_points_stay_in_place(extended: HandModel) -> None:
    forearm = hand_model("forearm")
    lengths = []
    for hand in (forearm, extended):
        data = mujoco.MjData(hand.mj)
        mujoco.mj_forward(hand.mj, data)
        lengths.append({name: data.actuator(f"{name}_r").length[0] for name in forearm.muscles})
    assert REATTACHED
    for name in forearm.muscles:
        assert lengths[1][name] == pytest.approx(lengths[0][name], abs=1e-9), name


def test_length_ranges_cover_the_poses(extended: HandModel) -> None:
    """Normalised lengths of the added muscles stay near MuJoCo's working range 0.75 to 1.05."""
    model = extended.mj
    data = mujoco.MjData(model)
    rng = np.random.default_rng(5)
    joints = len(extended.joints)
    for _ in range(200):
        data.qpos[:joints] = rng.uniform(*model.jnt_range[:joints].T)
        mujoco.mj_forward(model, data)
        for muscle in MUSCLES:
            shortest, longest = model.actuator(f"{muscle.name}_r").lengthrange
            slack = 0.1 * (longest - shortest)
            assert shortest - slack <= data.actuator(f"{muscle.name}_r").length[0] <= longest + slack


def simulate_random_activations(hand: HandModel, seconds: float) -> float:
    """Largest joint speed, rad/s, under excitations that jump to random values every 0.1 s."""
    model = hand.mj
    data = mujoco.MjData(model)
    rng = np.random.default_rng(1)
    fastest = 0.0
    for _ in range(round(seconds / 0.1)):
        data.ctrl[:] = rng.random(model.nu)
        for _ in range(10):
            mujoco.mj_step(model, data, nstep=5)
            fastest = max(fastest, float(np.abs(data.qvel[:-6]).max()))
        data.qpos[-5], data.qvel[-6:] = 3.0, 0.0  # the bottle is kept out of the way
    assert all(warning.number == 0 for warning in data.warning)
    joints = len(hand.joints)
    lower, upper = model.jnt_range[:joints].T
    assert (data.qpos[:joints] > lower - 0.3).all()
    assert (data.qpos[:joints] < upper + 0.3).all()
    return fastest


@pytest.mark.parametrize("variant", ["forearm", "extended"])
def test_random_activations_are_stable(variant: str) -> None:
    """A minute of simulated time; the fastest joint stays far below what divergence looks like."""
    assert 1.0 < simulate_random_activations(hand_model(variant), 60.0) < 100.0  # type: ignore[arg-type]
