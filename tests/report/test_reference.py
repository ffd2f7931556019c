"""Kept evidence: small, with provenance, and enough to build the whole report again."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from hdsafebo.campaign.run_spec import code_digest
from hdsafebo.cli import main
from hdsafebo.errors import DatasetError
from hdsafebo.params import load_params
from hdsafebo.pipeline.profiles import profile_text
from hdsafebo.pipeline.stage import COSTS_FILE
from hdsafebo.problems.registry import family_of
from hdsafebo.report.build import build_report
from hdsafebo.report.claims.base import Claim, Verdict
from hdsafebo.report.data.evidence import keep_evidence, rounded
from hdsafebo.report.data.kept import read_kept
from hdsafebo.report.data.planned import planned_runs
from hdsafebo.report.data.results import Uncertainty
from hdsafebo.report.headline import _own, _runs
from hdsafebo.report.marked import write_marked
from hdsafebo.report.reference import COSTS, keep_reference, report_from
from hdsafebo.report.results_page import NO_RUN, claims_markdown, runs_markdown
from hdsafebo.runs.read import read_run
from hdsafebo.runs.schema import run_name
from report.full_size import write_inputs
from report.run_files import random_runs


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory, project_root: Path) -> Path:
    """A project with random results in place of those of the smoke profile, and its reference."""
    root = tmp_path_factory.mktemp("project")
    (root / "params.yaml").write_text(profile_text(project_root, "smoke"))
    rng = np.random.default_rng(0)
    params = load_params(root / "params.yaml")
    for task, method in planned_runs(params):
        sizes = {"n_initial": 10, "n_trials": 40, "batch": 5, "gain": 1.0, "safe_share": 0.8}
        origin = this_code(task, params.methods[method].algorithm)
        random_runs(root, task, method, seeds=2, rng=rng, profile="smoke", **sizes, **origin)
    write_inputs(root, rng)
    (root / "data/rollouts/start.png").write_bytes(b"\x89PNG picture")
    costs = [
        {"profile": "standard", "stage": "report", "item": [], "seconds": 1.0, "peak_mb": 1},
        {"profile": "smoke", "stage": "report", "item": [], "seconds": 2.0, "peak_mb": 1},
        {"profile": "smoke", "stage": "report", "item": [], "seconds": 3.0, "peak_mb": 1},
    ]
    (root / COSTS).parent.mkdir()
    (root / COSTS).write_text("".join(json.dumps(cost) + "\n" for cost in costs))
    keep_reference(root)
    return root


def this_code(task: str, algorithm: str) -> dict[str, str]:
    """What a run file says about the code of the present."""
    return {"algorithm": algorithm, "code": code_digest(family_of(task), algorithm)}


def reference(root: Path) -> Path:
    return root / "reports/reference"


def content(folder: Path) -> dict[str, bytes]:
    """Every file of a report."""
    files = [folder / "index.html", folder / "summary.json", *sorted((folder / "tables").iterdir())]
    files += [*sorted((folder / "curves").iterdir()), *sorted((folder / "figures").iterdir())]
    return {str(path.relative_to(folder)): path.read_bytes() for path in files}


def test_the_report_is_built_again_from_the_evidence_alone(project: Path, tmp_path: Path) -> None:
    alone = tmp_path / "evidence"
    for name in ("runs", "inputs"):
        shutil.copytree(reference(project) / name, alone / name)
    for name in ("params.yaml", "provenance.json"):
        shutil.copyfile(reference(project) / name, alone / name)
    main(["report", "--from", str(alone), "--to", str(tmp_path / "built")])
    assert content(tmp_path / "built") == content(reference(project))


def test_its_numbers_are_those_of_the_run_files(project: Path, tmp_path: Path) -> None:
    params = load_params(project / "params.yaml")
    settings = Uncertainty(**params.report.model_dump())
    whole = build_report(
        project,
        profile="smoke",
        git_revision=None,
        planned=planned_runs(params),
        settings=settings,
        output=tmp_path,
    )
    kept = json.loads((reference(project) / "summary.json").read_text())
    assert whole.keys() == kept.keys()
    for task, method in planned_runs(params):
        for metric in ("objective", "safety", "violation", "seconds_per_round"):
            mean = whole[task][method][metric]["mean"]
            assert kept[task][method][metric]["mean"] == pytest.approx(mean, rel=1e-3, abs=1e-3)


def test_evidence_is_compact_and_keeps_what_was_safe(project: Path) -> None:
    for path in sorted((reference(project) / "runs").iterdir()):
        source = project / "data/runs" / path.name
        assert path.stat().st_size < source.stat().st_size
        ours, theirs = read_run(path), read_run(source)
        assert ours.meta == theirs.meta
        pd.testing.assert_series_equal(ours.trials["safe"], theirs.trials["safe"])
        for column in ("objective", "safety", "predicted_safe_probability"):
            np.testing.assert_allclose(ours.trials[column], theirs.trials[column], rtol=2e-4)


def test_rounding_keeps_four_digits() -> None:
    values = np.array([0.0, -1.0, np.nan, 1 / 3, 1e-12, -123456.0])
    np.testing.assert_allclose(rounded(values), values, rtol=1.3e-4)
    assert len(np.unique(rounded(np.linspace(1, 1.001, 1000)))) < 20


def test_provenance_names_every_file_and_stays_where_nothing_changed(project: Path) -> None:
    path = reference(project) / "provenance.json"
    before = json.loads(path.read_text())
    names = {path.stem for path in (reference(project) / "runs").iterdir()}
    assert set(before["runs"]) == names
    assert all(len(run["source_sha256"]) == 64 and run["seeds"] == [0, 1] for run in before["runs"].values())
    before["runs"]["hand-sobol"]["revision"] = "an earlier one"
    path.write_text(json.dumps(before))
    (reference(project) / "runs/synthetic-gone.parquet").write_bytes(b"of another profile")
    keep_reference(project)
    after = json.loads(path.read_text())
    assert after["runs"]["hand-sobol"]["revision"] == "an earlier one"
    assert not (reference(project) / "runs/synthetic-gone.parquet").exists()


def test_runs_are_of_modified_code_only_where_code_was_modified(project: Path, tmp_path: Path) -> None:
    """A profile rewrites the parameters, which are tracked, so they cannot be what counts."""
    shutil.copytree(project / "data", tmp_path / "data")
    shutil.copyfile(project / "params.yaml", tmp_path / "params.yaml")
    for name in ("src", "stages"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "module.py").write_text("x = 1\n")
    git = ["git", "-C", str(tmp_path), "-c", "user.name=test", "-c", "user.email=test@example.org"]
    for command in (["init", "-q"], ["add", "params.yaml", "src", "stages"], ["commit", "-qm", "code"]):
        subprocess.run([*git, *command], check=True)

    def kept(folder: str) -> list[tuple[str, bool]]:
        keep_evidence(tmp_path, tmp_path / folder)
        runs = json.loads((tmp_path / folder / "provenance.json").read_text())["runs"]
        return [(run["revision"], run["modified"]) for run in runs.values()]

    revision = subprocess.run([*git, "rev-parse", "HEAD"], check=True, capture_output=True, text=True).stdout
    (tmp_path / "params.yaml").write_text((tmp_path / "params.yaml").read_text() + "# of a profile\n")
    assert set(kept("before")) == {(revision.strip(), False)}
    (tmp_path / "stages" / "module.py").write_text("x = 2\n")
    assert set(kept("after")) == {(revision.strip(), True)}


def test_costs_are_the_last_of_the_profile(project: Path) -> None:
    costs = json.loads((reference(project) / "stage_costs.json").read_text())
    assert [cost["seconds"] for cost in costs] == [3.0]
    assert COSTS == COSTS_FILE


def test_runs_are_kept_one_after_another(project: Path, tmp_path: Path) -> None:
    """What is not here stays as it was kept before; what nobody has made is named."""
    runs, folder = tmp_path / "data/runs", tmp_path / "kept"
    shutil.copytree(project / "data", tmp_path / "data")
    shutil.copyfile(project / "params.yaml", tmp_path / "params.yaml")
    (runs / "hand-sobol.parquet").rename(tmp_path / "later")
    assert keep_evidence(tmp_path, folder) == ["hand-sobol"]
    assert not (folder / "runs/hand-sobol.parquet").exists()
    shutil.rmtree(runs)
    runs.mkdir()
    (tmp_path / "later").rename(runs / "hand-sobol.parquet")
    assert keep_evidence(tmp_path, folder) == []
    planned = {run_name(*run) for run in planned_runs(load_params(project / "params.yaml"))}
    assert {path.stem for path in (folder / "runs").iterdir()} == planned
    provenance = json.loads((folder / "provenance.json").read_text())["runs"]
    assert set(provenance) == planned
    assert all(len(run["source_sha256"]) == 64 for run in provenance.values())
    inputs = sorted(path.name for path in (folder / "inputs").rglob("*") if path.is_file())
    shutil.rmtree(tmp_path / "data")
    assert keep_evidence(tmp_path, folder) == []
    assert sorted(path.name for path in (folder / "inputs").rglob("*") if path.is_file()) == inputs
    with pytest.raises(DatasetError, match=r"no run of params.yaml; run the pipeline"):
        keep_evidence(tmp_path, tmp_path / "elsewhere")


def test_what_another_profile_has_left_is_no_evidence(project: Path, tmp_path: Path) -> None:
    """DVC leaves run files of the last profile in their place until their items are run again."""
    shutil.copytree(project / "data", tmp_path / "data")
    text = (project / "params.yaml").read_text()
    (tmp_path / "params.yaml").write_text(text.replace("profile: smoke", "profile: reference"))
    with pytest.raises(DatasetError, match=r"no run of params.yaml; run the pipeline"):
        keep_evidence(tmp_path, tmp_path / "kept")
    sizes = {"n_initial": 10, "n_trials": 40, "batch": 5, "gain": 1.0, "safe_share": 0.8}
    rng = np.random.default_rng(0)
    origin = this_code("synthetic", "sobol")
    random_runs(tmp_path, "synthetic", "sobol", seeds=2, rng=rng, profile="reference", **sizes, **origin)
    missing = keep_evidence(tmp_path, tmp_path / "kept")
    assert "hand-sobol" in missing
    assert [path.stem for path in (tmp_path / "kept/runs").iterdir()] == ["synthetic-sobol"]


@pytest.mark.parametrize("code", [None, "of an earlier revision"])
def test_runs_of_other_code_are_not_kept_under_this_revision(
    project: Path, tmp_path: Path, code: str | None
) -> None:
    shutil.copyfile(project / "params.yaml", tmp_path / "params.yaml")
    sizes = {"n_initial": 10, "n_trials": 40, "batch": 5, "gain": 1.0, "safe_share": 0.8}
    rng = np.random.default_rng(0)
    random_runs(tmp_path, "synthetic", "sobol", seeds=2, rng=rng, profile="smoke", **sizes, code=code)
    with pytest.raises(DatasetError, match=r"synthetic-sobol.parquet: computed by code other than"):
        keep_evidence(tmp_path, tmp_path / "kept")
    assert not (tmp_path / "kept").exists()


def test_a_folder_without_evidence_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stopped:
        main(["report", "--from", str(tmp_path)])
    assert stopped.value.code == 1
    assert "expected params.yaml and runs/" in capsys.readouterr().err


def test_the_committed_page_has_the_numbers_of_the_committed_evidence(
    project_root: Path, tmp_path: Path
) -> None:
    committed = project_root / "reports/reference"
    if not (committed / "runs").is_dir():
        pytest.skip("reports/reference is older than kept evidence")
    report_from(committed, tmp_path)
    assert json.loads((tmp_path / "summary.json").read_text()) == json.loads(
        (committed / "summary.json").read_text()
    )
    tables = sorted((committed / "tables").glob("*.csv"))
    assert {path.name for path in tables} == {path.name for path in (tmp_path / "tables").iterdir()}
    assert "outside.csv" in {path.name for path in tables}
    for path in tables:
        ours, theirs = pd.read_csv(tmp_path / "tables" / path.name), pd.read_csv(path)
        pd.testing.assert_frame_equal(ours, theirs, check_exact=False, rtol=1e-9)


def test_the_document_of_departures_is_the_list(
    project_root: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    main(["departures"])
    assert (project_root / "docs/departures.md").read_text(encoding="utf-8") == capsys.readouterr().out


def test_the_documentation_is_written_from_the_evidence(project: Path) -> None:
    page = project / "docs/reproduction/results.md"
    page.parent.mkdir(parents=True)
    page.write_text("before\n<!-- runs: written -->\nold\n<!-- end of runs -->\nafter\n")
    write_marked(page, "runs", runs_markdown(reference(project)))
    text = page.read_text()
    assert text.startswith("before\n<!-- runs: written -->\nProfile `smoke`")
    assert text.endswith("<!-- end of runs -->\nafter\n")
    assert "old" not in text
    summary = json.loads((reference(project) / "summary.json").read_text())
    mean = summary["synthetic"]["sobol"]["violation"]["mean"]
    (row,) = re.findall(r"\| Sobol search \(`sobol`\) \|([^\n]*)\| 2 \|", text[: text.index("**Musc")])
    assert float(row.split("|")[2].split("±")[0]) == pytest.approx(mean, rel=0.1)


def test_keeping_a_reference_writes_what_is_published(project: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    written: list[Path] = []
    for name in ("keep_evidence", "report_from"):
        monkeypatch.setattr(f"hdsafebo.report.reference.{name}", lambda source, target: None)
    monkeypatch.setattr("hdsafebo.report.reference.publish", written.append)
    keep_reference(project)
    assert written == [project]


def test_claims_are_listed_with_their_verdicts(project: Path) -> None:
    text = claims_markdown(reference(project))
    assert text.startswith("### Of this project's own method")
    counted = _runs(reference(project))[-1][1]
    total = sum(int(n) for n in re.findall(r": (\d+)", counted))
    assert text[text.index("### Of the paper") :].count("\n- ") == total > 5


def test_without_runs_the_pages_say_so(tmp_path: Path) -> None:
    assert runs_markdown(tmp_path) == claims_markdown(tmp_path) == NO_RUN
    (row,) = _runs(tmp_path)
    assert row[1] == "not graded: no run is kept"


def test_the_first_screen_says_how_much_has_been_run(project: Path) -> None:
    evidence = reference(project)
    kept = read_kept(evidence)
    assert kept is not None
    rows = {asked.split("?")[0]: answer for asked, answer, _ in _runs(evidence)}
    answer = rows["What of the comparison has been run"]
    counted = {name: (int(n), int(of)) for name, n, of in re.findall(r"(\w+): (\d+) of (\d+)", answer)}
    assert sum(n for n, _ in counted.values()) == len(kept.results.runs) > 0
    assert sum(of for _, of in counted.values()) == len(kept.planned)
    assert {task.split("_")[0].replace("scs", "stimulation") for task, _ in kept.planned} == counted.keys()
    body = next(answer for asked, answer in rows.items() if asked.startswith("Does a whole body"))
    for count, method in ((1, "hdsafebo_local"), (0, "cmaes_gains")):
        share = 100 * kept.results.estimate("body", method, "safety").mean
        assert f"`{method}` {count} of 1, {share:.1f} %" in body


def test_a_task_of_one_method_has_no_table_of_pairs(project: Path, tmp_path: Path) -> None:
    """A table without rows would be a file that no program reads."""
    evidence = tmp_path / "evidence"
    shutil.copytree(reference(project), evidence)
    others = [p for p in (evidence / "runs").glob("body-*") if p.stem != "body-hdsafebo_local"]
    assert others
    for path in others:
        path.unlink()
    report_from(evidence, tmp_path / "report")
    tables = {path.stem: pd.read_csv(path) for path in (tmp_path / "report/tables").glob("*.csv")}
    assert "metrics_body" in tables
    assert "comparisons_body" not in tables


def test_tasks_are_named_by_the_verdict_on_this_projects_method() -> None:
    statuses = {"scs_st": "partly", "scs_ga_informed": "reproduced", "scs_ta": "partly", "hand": "not run"}
    claims = [
        Claim(f"own_{task}", "", "", "", "", {"": Verdict(status, "")}) for task, status in statuses.items()
    ]
    ((_, answer, _),) = _own(claims, "")
    assert answer == "partly: Stimulation, ST; Stimulation, TA. holds: Stimulation, GA, informed"
    assert _own(claims[-1:], "") == []
