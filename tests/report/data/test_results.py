"""Comparisons, leaders and the pooled digits."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from hdsafebo.errors import ParamsError
from hdsafebo.files.yaml import parse_mapping
from hdsafebo.params import load_params, parse_params
from hdsafebo.pipeline.profiles import profile_text
from hdsafebo.report.data.methods import beta_of_ablation, by_family, order, style
from hdsafebo.report.data.planned import planned_runs
from hdsafebo.report.data.results import DIGITS, Results, Uncertainty
from hdsafebo.report.figures.curves import spread_out
from hdsafebo.report.page import MARKER_SHAPES
from hdsafebo.report.sections.findings import same_trials_findings
from hdsafebo.report.tables.results import comparison_table, metrics_table
from hdsafebo.runs.read import read_runs
from report.run_files import trial_table, write_run


def runs(root: Path, task: str, method: str, values: list[float], **metadata: object) -> None:
    tables = [trial_table(s, [0.0, v], [1.0, 1.0], n_initial=1, batch=1) for s, v in enumerate(values)]
    write_run(root, task, method, tables, n_initial=1, batch=1, **metadata)


def load(root: Path) -> Results:
    return Results(read_runs(root / "data/runs"), Uncertainty(bootstrap_samples=200))


def test_comparison_is_the_same_both_ways_and_every_time(tmp_path: Path) -> None:
    runs(tmp_path, "toy", "scbo", [1.0, 2.0, 4.0])
    runs(tmp_path, "toy", "cei", [0.5, 2.5, 1.0])
    first, again = load(tmp_path), load(tmp_path)
    c = first.compare("toy", "scbo", "cei", "objective")
    assert c == first.compare("toy", "cei", "scbo", "objective").reversed()
    assert c == again.compare("toy", "scbo", "cei", "objective")
    assert c.difference == pytest.approx(1.0)


def test_our_methods_are_compared_in_either_space(tmp_path: Path) -> None:
    methods = ["hdsafebo_local", "hdsafebo_local_original", "cmaes_original"]
    for k, method in enumerate(methods):
        algorithm = "cmaes" if "cmaes" in method else "hdsafebo_local"
        runs(tmp_path, "toy", method, [1.0 + k, 2.0 + k], algorithm=algorithm)
    table = comparison_table(load(tmp_path), "toy", methods).frame
    assert sorted(set(table["method"])) == ["hdsafebo_local", "hdsafebo_local_original"]
    row = table.set_index(["method", "against"]).loc[("hdsafebo_local_original", "cmaes_original")]
    assert row["objective_advantage"] == pytest.approx(-1.0)
    assert row["objective_pairs"] == 2


def test_runs_that_found_nothing_safe_are_worse_and_counted(tmp_path: Path) -> None:
    runs(tmp_path, "toy", "hdsafebo", [3.0 + 0.1 * k for k in range(8)])
    unsafe = [trial_table(s, [0.0, 9.0], [-1.0, -1.0], n_initial=1, batch=1) for s in range(8)]
    write_run(tmp_path, "toy", "hesbo", unsafe, n_initial=1, batch=1)
    results = load(tmp_path)
    c = results.compare("toy", "hdsafebo", "hesbo", "objective")
    assert (c.better, c.pairs, c.infinite) == (True, 8, 8)
    table = metrics_table(results, "toy", ["hdsafebo", "hesbo"], "caption", "name")
    details = [row[2].small for row in table.rows]
    assert details == ["", "nothing safe in 8 runs"]


def test_methods_with_the_same_trials_are_named(tmp_path: Path) -> None:
    for method, values in {
        "hdsafebo": [1.0, 2.0],
        "hdsafebo_beta0": [1.0, 2.0],
        "config": [1.0, 2.5],
    }.items():
        runs(tmp_path, "toy", method, values)
    (found,) = same_trials_findings(load(tmp_path), "toy", ["hdsafebo", "hdsafebo_beta0", "config"])
    assert "every run: HdSafeBO; HdSafeBO, β = 0." in found.text
    assert same_trials_findings(load(tmp_path), "toy", ["hdsafebo", "config"]) == []


def test_leader(tmp_path: Path) -> None:
    runs(tmp_path, "toy", "hdsafebo", [3.0 + 0.1 * k for k in range(8)])
    runs(tmp_path, "toy", "scbo", [2.0 + 0.1 * k for k in range(8)])
    runs(tmp_path, "toy", "cei", [1.0 + 0.1 * k for k in range(8)])
    leader = load(tmp_path).leader("toy", "objective")
    assert leader is not None
    assert (leader.method, leader.runner_up, leader.significant) == ("hdsafebo", "scbo", True)
    assert leader.not_beaten == []
    tie = load(tmp_path).leader("toy", "safety")
    assert tie is not None
    assert not tie.significant
    assert load(tmp_path).leader("toy", "objective", ["cei"]).significant is False  # type: ignore[union-attr]


def test_digits_are_averaged_over_seeds_and_then_are_the_units(tmp_path: Path) -> None:
    for digit in range(3):
        runs(tmp_path, f"digits_{digit}", "scbo", [digit, digit + 2.0])
    runs(tmp_path, "digits_0", "cei", [5.0])
    results = load(tmp_path)
    assert results.experiments == [DIGITS]
    assert results.methods(DIGITS) == ["scbo"], "a method that lacks a digit is not averaged"
    table = results.metrics(DIGITS, "scbo")
    assert table.index.tolist() == ["digits_0", "digits_1", "digits_2"]
    assert table["objective"].tolist() == [1.0, 2.0, 3.0]
    e = results.estimate(DIGITS, "scbo", "objective")
    assert (e.mean, e.runs) == (2.0, 3)
    assert e.se == pytest.approx(1 / np.sqrt(3))
    np.testing.assert_allclose(results.series(DIGITS, "scbo").objective[:, -1], [1, 2, 3])


@pytest.mark.parametrize("profile", ["reference", "paper"])
def test_every_method_has_a_look_of_its_own_in_its_panel(profile: str, project_root: Path) -> None:
    data = parse_mapping(profile_text(project_root, profile), profile, ParamsError)
    methods: dict[str, list[str]] = {}
    for task, method in planned_runs(parse_params(data)):
        methods.setdefault(task, []).append(method)
    for task, names in methods.items():
        for family, together in by_family(names).items():
            markers = [style(m).marker for m in together]
            assert len(set(markers)) == len(markers), f"{task}, {family}: markers must do without colour"


@pytest.mark.parametrize(
    ("heights", "expected"),
    [
        ([0.9, 0.5], [0.9, 0.5]),
        ([0.5, 0.45], [0.5, 0.4]),
        ([1.2, 0.99], [0.95, 0.85]),
        ([0.08, 0.06, 0.0], [0.25, 0.15, 0.05]),
        ([0.3] * 20, [0.975 - 0.05 * i for i in range(20)]),
        ([], []),
    ],
)
def test_names_beside_points_do_not_overlap(heights: list[float], expected: list[float]) -> None:
    assert spread_out(heights, 0.1) == pytest.approx(expected)


def test_every_marker_has_its_shape_in_legends(project_root: Path) -> None:
    """Of every method that a block names, run so far or not."""
    methods = load_params(project_root / "params.yaml").methods
    assert {style(name).marker for name in methods} <= MARKER_SHAPES.keys()


def test_order_and_names() -> None:
    assert order(["sobol", "hdsafebo_local", "cei_original", "hdsafebo"]) == [
        "hdsafebo",
        "hdsafebo_local",
        "sobol",
        "cei_original",
    ]
    assert order(["hdsafebo_beta16", "hdsafebo_beta4"]) == ["hdsafebo_beta4", "hdsafebo_beta16"]
    assert beta_of_ablation("hdsafebo_beta0.5") == 0.5
    assert beta_of_ablation("hdsafebo_better") is None
    assert style("hdsafebo_beta4").label == "HdSafeBO, β = 4"
    assert style("something_new").label == "something_new"
