"""A saved state: any damage is detected, and it goes on only with the problem that it belongs to."""

import json
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hdsafebo.errors import StateFileError, TrialError
from hdsafebo.optimizers.core.state_file import read_state, write_state
from hdsafebo.optimizers.hdsafebo import HdSafeBO
from hdsafebo.problem import FunctionProblem, Safety
from hdsafebo.trials import Status
from optimizers.toy import Halving, Rows, bowl, bowl_problem, observe_initial, rows_problem, run_rounds


@pytest.fixture(scope="module")
def content(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    path = tmp_path_factory.mktemp("saved") / "state"
    made = HdSafeBO(bowl_problem(), candidates=200)
    observe_initial(made)
    run_rounds(made, 2)
    made.save(path)
    return path.read_bytes()


def test_every_changed_byte_is_detected(content: bytes, tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    path = tmp_path / "state"
    header = 8 + int.from_bytes(content[:8], "little")
    places = np.concatenate([rng.integers(header, size=500), rng.integers(len(content), size=500)])
    for place in places:
        damaged = bytearray(content)
        damaged[place] ^= int(rng.integers(1, 256))
        path.write_bytes(damaged)
        with pytest.raises(StateFileError):
            HdSafeBO.load(path, bowl_problem())
    path.write_bytes(content)
    assert len(HdSafeBO.load(path, bowl_problem()).trials) == 20


@pytest.mark.parametrize(
    ("column", "value", "message"),
    [
        ("objective", np.inf, "trials.objective"),
        ("objective", np.nan, "trials.objective"),
        ("safety", -np.inf, "trials.safety"),
        ("status", 7, "trials.status"),
        ("status", 0, "trials.objective"),
        ("x", np.nan, "trials.x"),
        ("candidate", 0, "trials.candidate"),
        ("candidate", -2, "trials.candidate"),
        ("round", -1, "trials.round"),
        ("round", 99, "trials.round"),
        ("id", 5, "trials.id"),
        ("predicted_safe_probability", 1.5, "trials.predicted"),
        ("violation_bound", -1.0, "trials.violation_bound"),
        ("trust_region_length", -1.0, "trials.trust_region"),
    ],
)
def test_values_that_no_trial_can_have(
    content: bytes, tmp_path: Path, column: str, value: float, message: str
) -> None:
    path = tmp_path / "state"
    path.write_bytes(content)
    state, arrays = read_state(path)
    arrays.setdefault("trials.z", arrays["trials.x"].copy())  # a file need not hold what equals the inputs
    arrays["trials." + column][3] = value
    write_state(path, state, arrays)
    with pytest.raises(StateFileError, match=message):
        HdSafeBO.load(path, bowl_problem())


def test_codes_that_are_no_numbers(tmp_path: Path) -> None:
    path = tmp_path / "state"
    made = HdSafeBO(bowl_problem(), embedding=Halving(), candidates=200)
    observe_initial(made)
    made.save(path)
    state, arrays = read_state(path)
    arrays["trials.z"][3] = np.inf
    write_state(path, state, arrays)
    with pytest.raises(StateFileError, match=r"trials\.z"):
        HdSafeBO.load(path, bowl_problem(), Halving())


@pytest.mark.parametrize("column", ["objective", "status", "x", "marked_unsafe"])
def test_columns_of_another_type_or_length(content: bytes, tmp_path: Path, column: str) -> None:
    path = tmp_path / "state"
    path.write_bytes(content)
    for change in (lambda a: a.astype(np.float32), lambda a: a[:-1], lambda a: a[:, None]):
        state, arrays = read_state(path)
        path.write_bytes(content)
        arrays["trials." + column] = change(arrays["trials." + column])
        write_state(path, state, arrays)
        with pytest.raises(StateFileError, match=f"trials.{column} has type"):
            HdSafeBO.load(path, bowl_problem())
        path.write_bytes(content)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("round", -1),
        ("round", 1.5),
        ("round", True),
        ("round", "2"),
        ("settings", {"beta": "2"}),
        ("settings", []),
        ("generator", {}),
        ("fits", {"start": {"objective": {}}}),
        ("method_state", {"width": 1.0}),
    ],
)
def test_state_of_another_type(content: bytes, tmp_path: Path, key: str, value: object) -> None:
    path = tmp_path / "state"
    path.write_bytes(content)
    state, arrays = read_state(path)
    write_state(path, state | {key: value}, arrays)
    with pytest.raises(StateFileError):
        HdSafeBO.load(path, bowl_problem())


def test_hyperparameters_out_of_range(content: bytes, tmp_path: Path) -> None:
    path = tmp_path / "state"
    path.write_bytes(content)
    state, arrays = read_state(path)
    for name, value in (("length_scale", 0.0), ("noise_ratio", -1.0), ("fits", -1), ("reference", "far")):
        fits = json.loads(json.dumps(state["fits"]))
        fits["next_start" if fits["start"] is None else "start"]["objective"][name] = value
        write_state(path, state | {"fits": fits}, arrays)
        with pytest.raises(StateFileError, match="damaged state"):
            HdSafeBO.load(path, bowl_problem())


def test_numbers_of_numpys_own_types(tmp_path: Path) -> None:
    """Wherever they come from: thresholds, settings, what a method remembers."""
    safety = Safety("distance", np.float32(0.0), modelled=np.bool_(True), reported=np.True_)
    problem = FunctionProblem(bowl, bowl_problem().bounds, [safety])
    made = HdSafeBO(problem, beta=np.float64(-2.0), seed=np.int64(3), candidates=200)
    observe_initial(made)
    run_rounds(made, 1)
    made.region = replace(made.region, length=np.float64(0.5), failures=np.int64(1))
    made.save(tmp_path / "state")
    again = HdSafeBO.load(tmp_path / "state", problem)
    assert again.region == made.region
    np.testing.assert_array_equal(made.ask(3).x, again.ask(3).x)


# --- permissions and links


def test_a_new_state_has_the_permissions_of_any_new_file(content: bytes, tmp_path: Path) -> None:
    made = HdSafeBO(bowl_problem())
    before = os.umask(0o027)
    try:
        made.save(tmp_path / "state")
    finally:
        os.umask(before)
    assert (tmp_path / "state").stat().st_mode & 0o777 == 0o640


# --- whose state it is


def reordered(problem: FunctionProblem, rows: np.ndarray) -> FunctionProblem:
    problem.candidates = Rows(problem.candidates.features[rows])
    return problem


@pytest.mark.parametrize("total", [60, 9000])
def test_another_list_of_the_same_length(tmp_path: Path, total: int) -> None:
    made = HdSafeBO(rows_problem(total), candidates=200)
    observe_initial(made)
    run_rounds(made, 2)
    made.save(tmp_path / "state")
    HdSafeBO.load(tmp_path / "state", rows_problem(total))
    untried = np.setdiff1d(np.arange(total), made.taken)
    swapped, changed = np.arange(total), rows_problem(total)
    swapped[untried[[-2, -1]]] = untried[[-1, -2]]
    changed.candidates.features[untried[-1]] += 1e-4
    rounding = rows_problem(total)
    rounding.candidates.features *= 1 + 1e-15
    HdSafeBO.load(tmp_path / "state", rounding)
    for other in (
        reordered(rows_problem(total), np.arange(total)[::-1]),
        reordered(rows_problem(total), swapped),
        changed,
        rows_problem(total, seed=1),
    ):
        with pytest.raises(StateFileError, match="candidates of problem 'bowl' are not those"):
            HdSafeBO.load(tmp_path / "state", other)


def test_the_same_features_of_other_inputs(tmp_path: Path) -> None:
    class Shown(Rows):
        def inputs(self, rows):
            return 1.0 - self.features[rows]

    made = HdSafeBO(rows_problem(60), candidates=200)
    observe_initial(made)
    made.save(tmp_path / "state")
    other = rows_problem(60)
    other.candidates = Shown(other.candidates.features)
    with pytest.raises(StateFileError, match="not the inputs of their candidate rows"):
        HdSafeBO.load(tmp_path / "state", other)


def test_another_transform_or_feature_map(tmp_path: Path) -> None:
    def problem(transform, features) -> FunctionProblem:
        made = FunctionProblem(bowl, bowl_problem().bounds, [Safety("distance", 0.0, transform=transform)])
        made.features = features
        return made

    made = HdSafeBO(problem(np.arctan, lambda x: x[:, :2]))
    observe_initial(made)
    made.save(tmp_path / "state")
    HdSafeBO.load(tmp_path / "state", problem(np.arctan, lambda x: x[:, :2]))
    for other, message in (
        (problem(np.tanh, lambda x: x[:, :2]), "transforms of safety functions"),
        (problem(np.arctan, lambda x: x[:, 1:3]), "features of problem"),
        (problem(np.arctan, lambda x: x[:, :3]), "features of problem"),
        (problem(np.arctan, None), "saved with features"),
    ):
        with pytest.raises(StateFileError, match=message):
            HdSafeBO.load(tmp_path / "state", other)


def test_rows_that_are_not_the_inputs() -> None:
    made = HdSafeBO(rows_problem(60))
    x = made.problem.candidates.inputs(np.array([3, 4]))
    with pytest.raises(TrialError, match=r"inputs number \[1\] differ .* candidate rows \[5\]"):
        made.observe(x, *bowl(x), candidate=[3, 5])
    assert len(made.trials) == 0
    made.observe(x, *bowl(x), candidate=[3, -1])
    assert made.trials.candidate.tolist() == [3, -1]


def test_an_embedding_is_none_of_the_problem(tmp_path: Path) -> None:
    made = HdSafeBO(rows_problem(60), embedding=Halving(), candidates=200)
    observe_initial(made)
    made.ask(3)
    made.save(tmp_path / "state")
    again = HdSafeBO.load(tmp_path / "state", rows_problem(60), Halving())
    assert (again.trials.status[-3:] == Status.PENDING).all()
