"""The whole report: exact summary, self-contained page, working links, same bytes every time."""

from __future__ import annotations

import json
import re
import struct
import time
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from markupsafe import escape
from scipy.stats import norm

from hdsafebo.errors import DatasetError
from hdsafebo.report.build import build_report
from hdsafebo.report.data.departures import read_departures
from hdsafebo.report.data.inputs import StoredPicture
from hdsafebo.report.data.results import Uncertainty
from report.full_size import write_everything
from report.run_files import trial_table, write_run

QUICK = Uncertainty(bootstrap_samples=200)


def build(root: Path) -> dict:
    return build_report(root, profile="test", git_revision="abc", settings=QUICK)


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two methods on the synthetic task, with known numbers, and a report of them."""
    root = tmp_path_factory.mktemp("small")
    for method, gain in (("hdsafebo", 2.0), ("sobol", 1.0)):
        tables = []
        for seed in range(8):
            objective = [0.5, 0.0, gain + seed, 0.0]
            safety = [0.0, 0.0, 0.0, -2.0 if method == "sobol" else 0.0]
            tables.append(
                trial_table(
                    seed, objective, safety, n_initial=2, batch=1, threshold=-0.75, probability=0.9, bound=0.5
                )
            )
        extra: dict[str, object] = {}
        if method == "hdsafebo":
            counts = {"fits": 4, "jitters": 1, "fallbacks": 2, "marked": 2, "missing": 5, "abstained": "why"}
            extra = {"beta": 2.0, "guaranteed_alpha": float(norm.sf(2.0)), "counts": [counts] * 8}
        write_run(root, "synthetic", method, tables, n_initial=2, batch=1, thresholds=[-0.75], **extra)
    build(root)
    return root


def page(root: Path) -> str:
    return (root / "reports/index.html").read_text(encoding="utf-8")


def test_summary_is_exact(small: Path) -> None:
    summary = json.loads((small / "reports/summary.json").read_text())
    assert (summary["profile"], summary["git_revision"]) == ("test", "abc")
    found = summary["synthetic"]["hdsafebo"]
    assert found["objective"]["mean"] == pytest.approx(2 + 3.5)
    assert found["objective"]["se"] == pytest.approx(np.std(range(8), ddof=1) / np.sqrt(8))
    assert found["objective"]["runs"] == 8
    assert found["safety"] == {"mean": 1.0, "se": 0.0, "runs": 8}
    assert summary["synthetic"]["sobol"]["safety"]["mean"] == 0.5
    assert summary["synthetic"]["sobol"]["violation"]["mean"] == pytest.approx(1.25)
    assert found["seconds_per_round"]["mean"] == 0.5
    assert found["counts"] == {"fits": 32, "jitters": 8, "fallbacks": 16, "marked": 16, "missing": 40}


def test_tables_and_curves(small: Path) -> None:
    table = pd.read_csv(small / "reports/tables/metrics_synthetic.csv").set_index("method")
    assert table.loc["hdsafebo", "paper_objective"] == 3.96
    assert bool(table.loc["hdsafebo", "objective_significantly_best"])
    assert not bool(table.loc["hdsafebo", "seconds_per_round_significantly_best"]), (
        "equal times: nobody is best"
    )
    curves = pd.read_csv(small / "reports/curves/synthetic.csv")
    last = curves[curves["method"] == "sobol"].iloc[-1]
    assert (last["trials"], last["best_safe_objective"], last["safety_ratio"]) == (4, 4.5, 0.5)
    assert last["cumulative_violation"] == pytest.approx(1.25)


def test_page_says_what_the_numbers_say(small: Path) -> None:
    text = page(small)
    assert "<b>5.50 ± 0.87</b><small>paper 3.96 ± 0.15</small>" in text
    assert "Objective: HdSafeBO leads with 5.50 ± 0.87, significantly better than the other method" in text
    assert "Its guarantee of 0.0228 is vacuous" in text
    assert "<td>16<small>40 trials not made</small></td><td>24<small>of 32</small></td>" in text
    assert "below the paper&#39;s size" in text
    assert "random search has Safety 0.773" in text
    assert "Muscle synergies: not run in this profile." in text
    assert "Musculoskeletal hand: not run in this profile." in text
    assert "Clinical experiment: not run." in text


def test_page_needs_no_network_and_its_links_work(small: Path) -> None:
    text = page(small)
    assert not re.search(r"""(?:src|href)=["']?(?:https?:)?//""", text)
    assert "@import" not in text
    pictures = set(re.findall(r"url\(([^)]+)\)", text))
    assert pictures
    assert all(name.startswith("figures/") and (small / "reports" / name).is_file() for name in pictures)
    targets = set(re.findall(r' id="([^"]+)"', text))
    identifiers = re.findall(r' id="([^"]+)"', text)
    assert len(identifiers) == len(targets), "identifiers are unique"
    links = re.findall(r'href="([^"]+)"', text)
    assert links
    for link in links:
        if link.startswith("#"):
            assert link[1:] in targets, link
        else:
            assert (small / "reports" / link).exists(), link


def test_pictures_are_small_png_files(small: Path) -> None:
    folder = small / "reports/figures"
    assert {p.suffix for p in folder.iterdir()} == {".png"}
    names = {p.stem for p in folder.iterdir()}
    assert {"workflow", "final_synthetic", "curves_synthetic_free", "calibration_synthetic"} <= names
    assert max(p.stat().st_size for p in folder.iterdir()) < 150_000


def test_same_files_same_bytes(small: Path) -> None:
    def content() -> dict[str, bytes]:
        return {str(p): p.read_bytes() for p in sorted((small / "reports").rglob("*")) if p.is_file()}

    before = content()
    build(small)
    assert content() == before


def test_runs_that_the_parameters_do_not_name_are_left_out_and_listed(tmp_path: Path) -> None:
    write_everything(tmp_path, seeds_divided_by=10, only=(("scs_st",), ("hdsafebo", "scbo", "sobol")))
    (tmp_path / "data/runs/scs_ga-cei.parquet").write_bytes(b"of no concern")
    summary = build_report(
        tmp_path,
        profile="test",
        git_revision=None,
        planned=[("scs_st", "hdsafebo"), ("scs_st", "sobol"), ("hand", "sobol")],
        settings=QUICK,
    )
    assert sorted(summary["scs_st"]) == ["hdsafebo", "sobol"]
    text = page(tmp_path)
    assert "do not name their task and method: scs_ga-cei.parquet, scs_st-scbo.parquet." in text
    assert "scbo" not in (tmp_path / "reports/tables/metrics_scs_st.csv").read_text()


def test_a_wide_picture_can_be_scrolled_on_a_phone() -> None:
    def png(width: int, height: int) -> bytes:
        return b"\x89PNG\r\n\x1a\n" + struct.pack(">I4sII", 13, b"IHDR", width, height)

    assert StoredPicture("wide", png(1400, 1000)).is_wide
    assert not StoredPicture("square", png(1000, 1000)).is_wide
    assert not StoredPicture("no picture", b"").is_wide


def test_sizes_of_the_isometry_check_and_the_random_embeddings(tmp_path: Path) -> None:
    write_everything(tmp_path, seeds_divided_by=10, only=(("scs_st",), ("hdsafebo", "hesbo", "sobol")))
    checks = {"distance_correlation": 0.9, "gp_mean_difference": 0.1, "gp_variance_difference": 0.1}
    (tmp_path / "reports").mkdir(exist_ok=True)
    (tmp_path / "reports/isometry.json").write_text(json.dumps({"irvae": checks}))
    build_report(
        tmp_path,
        profile="test",
        git_revision=None,
        isometry_points=2000,
        settings=QUICK,
    )
    text = page(tmp_path)
    assert "Size: 2,000 field maps. Paper: 10,000" in text
    assert "This is below the paper&#39;s size" in text
    table = pd.read_csv(tmp_path / "reports/tables/random_embeddings_scs_st.csv")
    assert set(table["method"]) == {"hdsafebo", "hesbo", "sobol"}
    paper = table.set_index("method")["paper_objective"]
    assert (paper["hdsafebo"], paper["hesbo"]) == (0.26, 0.23)
    assert (table["unconstrained"] >= table["objective"]).all()


def test_nothing_was_run(tmp_path: Path) -> None:
    summary = build_report(tmp_path, profile="smoke", git_revision=None, settings=QUICK)
    assert summary == {"profile": "smoke", "git_revision": None}
    text = page(tmp_path)
    for what in (
        "No optimisation runs",
        "Isometry check",
        "Synthetic functions",
        "Stimulation, ST",
        "Run times",
    ):
        assert f"{what}: not run in this profile." in text


def test_every_experiment_at_a_small_size(tmp_path: Path) -> None:
    tasks = ("hand", "scs_st", "digits_0", "digits_1")
    methods = ("hdsafebo", "sobol", "hdsafebo_global", "hdsafebo_beta0", "hdsafebo_beta4")
    write_everything(tmp_path, seeds_divided_by=10, only=(tasks, methods))
    build(tmp_path)
    text = page(tmp_path)
    for name in (
        "figure-selectivity_distribution",
        "figure-pairwise_distances",
        "figure-learning_curve",
        "figure-field_map",
        "figure-beta_hand",
        "figure-components_hand",
        "figure-curves_digits_free",
        "figure-seconds_per_round",
    ):
        assert f'id="{name}"' in text
    assert "table-regret_scs_st" in text
    assert "table-isometry" in text
    assert "218,000 parameters" in text


@pytest.mark.parametrize(
    ("file", "content", "message"),
    [
        ("reports/isometry.json", "{", "cannot be read as JSON"),
        ("reports/isometry.json", '{"vae": {}}', "distance_correlation: Field required"),
        ("reports/isometry_pairs.parquet", "x", "cannot be read as parquet"),
        ("models/synergies/pca.json", "{}", "variance_accounted_for"),
        ("data/rollouts/learning_curve.parquet", "x", "cannot be read as parquet"),
        ("data/spinal/selectivity.json", "x", "cannot be read as JSON"),
        ("data/spinal/selectivity.json", '{"rows": 1}', "threshold: Field required"),
        ("data/spinal/traversal.json", "{}", "seconds"),
    ],
)
def test_malformed_inputs_are_errors(tmp_path: Path, file: str, content: str, message: str) -> None:
    path = tmp_path / file
    path.parent.mkdir(parents=True)
    path.write_text(content)
    with pytest.raises(DatasetError, match=message) as error:
        build(tmp_path)
    assert str(path) in str(error.value)


@pytest.mark.slow
def test_largest_profile_within_a_minute_and_15_mb(tmp_path: Path) -> None:
    write_everything(tmp_path)
    start = time.process_time()
    build_report(tmp_path, profile="reference", git_revision=None)
    assert time.process_time() - start <= 60
    assert (tmp_path / "reports/index.html").stat().st_size <= 15e6


def test_pictures_of_the_hand_are_shown(tmp_path: Path) -> None:
    folder = tmp_path / "data/rollouts"
    folder.mkdir(parents=True)
    (folder / "start_pose.png").write_bytes(b"\x89PNG picture")
    build(tmp_path)
    (name,) = re.findall(r'<img src="(figures/frame_\w+\.png)" alt="start pose">', page(tmp_path))
    assert (tmp_path / "reports" / name).read_bytes() == b"\x89PNG picture"


def test_settings_are_never_compared_with_each_other(tmp_path: Path) -> None:
    tasks = ("scs_st", "scs_st_informed", "digits_0", "digits_0_informed")
    write_everything(tmp_path, seeds_divided_by=2, only=(tasks, ("hdsafebo", "hdsafebo_local", "sobol")))
    build(tmp_path)
    leaders = pd.read_csv(tmp_path / "reports/tables/leaders.csv")
    assert leaders["task"].tolist() == ["scs_st", "scs_st_informed", "digits", "digits_informed"]
    assert (leaders["methods"] == 3).all()
    for path in (tmp_path / "reports/tables").glob("*.csv"):
        table = pd.read_csv(path)
        if "task" in table and path.stem not in ("leaders", "seconds_per_round"):
            assert table["task"].nunique() == 1, path.name
    text = page(tmp_path)
    assert "Stimulation, ST, informed: with the same information as every other method" in text


def test_the_page_says_what_every_method_was_given(tmp_path: Path) -> None:
    given = {"candidate_rows": "218,000 rows", "safety": "g, its logarithm"}
    for method, unused in (("hdsafebo_local", []), ("scbo", ["candidate_rows"])):
        table = trial_table(0, [0.0, 1.0], [1.0, 1.0], n_initial=1, batch=1)
        write_run(tmp_path, "scs_st", method, [table], n_initial=1, batch=1, given=given, unused=unused)
    build(tmp_path)
    text = page(tmp_path)
    assert (
        "What every method was given. Candidate rows: 218,000 rows; safety functions that are modelled"
        in text
    )
    assert "Not used: candidate rows by SCBO." in text


def test_every_departure_is_on_the_page(small: Path) -> None:
    text = page(small)
    for entry in read_departures():
        assert escape(entry.where) in text
        assert escape(entry.changes) in text
