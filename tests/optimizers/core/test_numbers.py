"""Columns are found by their names; what is no array of numbers, or of unknown order, is refused."""

from types import MappingProxyType

import numpy as np
import pytest

from hdsafebo.errors import TrialError
from hdsafebo.optimizers.controls.sobol import Sobol
from hdsafebo.problem import FunctionProblem, Safety

X = np.random.default_rng(0).random((3, 2))
FORCE, HEAT = np.array([1.0, 2.0, 3.0]), np.array([-1.0, -2.0, -3.0])


@pytest.fixture
def made() -> Sobol:
    safety = [Safety("force", 0.0), Safety("heat", -5.0)]
    return Sobol(FunctionProblem(lambda x: (x[:, 0], x), np.array([[0.0] * 2, [1.0] * 2]), safety))


def tables() -> dict[str, object]:
    pd = pytest.importorskip("pandas")
    swapped = pd.DataFrame({"heat": HEAT, "force": FORCE})
    return {
        "frame": swapped,
        "mapping": {"heat": HEAT, "force": list(FORCE)},
        "read-only mapping": MappingProxyType({"heat": HEAT, "force": FORCE}),
        "columns of a frame": {"heat": swapped["heat"], "force": swapped["force"]},
        "frame without names": pd.DataFrame(np.column_stack([FORCE, HEAT])),
        "array": np.column_stack([FORCE, HEAT]),
    }


@pytest.mark.parametrize("kind", tables())
@pytest.mark.parametrize("call", ["tell", "observe"])
def test_safety_by_name(made: Sobol, kind: str, call: str) -> None:
    if call == "tell":
        made.tell(made.ask(3), FORCE, tables()[kind])
    else:
        made.observe(X, FORCE, tables()[kind])
    np.testing.assert_array_equal(made.trials.safety, np.column_stack([FORCE, HEAT]))


@pytest.mark.parametrize(
    ("columns", "message"),
    [
        ({"heat": HEAT}, r"columns \['heat'\]; expected exactly \['force', 'heat'\]"),
        ({"heat": HEAT, "force": FORCE, "more": FORCE}, "expected exactly"),
        ({"Force": FORCE, "heat": HEAT}, "expected exactly"),
        ({"force": FORCE, "heat": HEAT[:2]}, "columns of the shapes"),
        ({"force": FORCE, "heat": ["a"] * 3}, "safety 'heat' is not an array of numbers"),
        ({1: FORCE, 0: HEAT}, "expected exactly"),
    ],
)
def test_other_columns_are_refused(made: Sobol, columns, message: str) -> None:
    with pytest.raises(TrialError, match=message):
        made.observe(X, FORCE, columns)
    assert len(made.trials) == 0


@pytest.mark.parametrize("kind", ["str", "string", "object", "category"])
def test_columns_of_text_are_no_numbers(made: Sobol, kind: str) -> None:
    pd = pytest.importorskip("pandas")
    text = pd.Series(["1.5", "1_000", "2"]).astype(kind)
    for objective, safety in ((text, tables()["array"]), (FORCE, {"force": text, "heat": HEAT})):
        with pytest.raises(TrialError, match="not an array of numbers: it has"):
            made.observe(X, objective, safety)
    assert len(made.trials) == 0


def test_columns_in_an_order_of_their_own_are_refused_where_nothing_has_names(made: Sobol) -> None:
    pd = pytest.importorskip("pandas")
    for arguments in (
        (pd.DataFrame(X, columns=["b", "a"]), FORCE, tables()["array"]),
        (X, pd.DataFrame({"y": FORCE}), tables()["array"]),
        (pd.DataFrame(X)[[1, 0]], FORCE, tables()["array"]),
        (X, FORCE, pd.DataFrame(np.column_stack([FORCE, HEAT]))[[1, 0]]),
    ):
        with pytest.raises(TrialError, match="has the columns"):
            made.observe(*arguments)
    assert len(made.trials) == 0


def test_columns_that_were_sorted_apart_are_refused(made: Sobol) -> None:
    pd = pytest.importorskip("pandas")
    table = pd.DataFrame({"y": FORCE, "force": FORCE, "heat": HEAT}, index=[7, 8, 9])
    with pytest.raises(TrialError, match=r"rows of safety are labelled \[9, 8, 7\].*objective \[7, 8, 9\]"):
        made.observe(X, table["y"], table.sort_values("heat")[["force", "heat"]])
    made.observe(X, table["y"], table[["heat", "force"]])
    np.testing.assert_array_equal(made.trials.safety[:, 1], HEAT)


def test_tensors_with_and_without_gradients(made: Sobol) -> None:
    torch = pytest.importorskip("torch")
    objective = torch.tensor(FORCE, requires_grad=True)
    safety = torch.stack([objective, torch.tensor(HEAT, dtype=torch.float32)], dim=1)
    made.observe(
        torch.tensor(X, requires_grad=True), objective, safety, status=torch.ones(3, dtype=torch.uint8)
    )
    made.observe(X, [2 * value for value in objective], [list(row) for row in safety])
    np.testing.assert_array_equal(made.trials.objective, [*FORCE, *(2 * FORCE)])
    np.testing.assert_array_equal(made.trials.safety[3:], np.column_stack([FORCE, HEAT]))
