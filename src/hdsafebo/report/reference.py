"""Committed evidence in `reports/reference`: kept from a finished pipeline, and made a report again."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

from hdsafebo.errors import DatasetError
from hdsafebo.files.atomic import write_json
from hdsafebo.files.bounded import read_text
from hdsafebo.params import load_params
from hdsafebo.report.build import build_report
from hdsafebo.report.data.evidence import INPUTS, PARAMS, RUNS, keep_evidence, read_provenance
from hdsafebo.report.data.json_files import read_json
from hdsafebo.report.data.outside import IN_EVIDENCE
from hdsafebo.report.data.planned import planned_runs
from hdsafebo.report.data.results import Uncertainty
from hdsafebo.report.published import publish

COSTS = ".journal/stage_costs.jsonl"
REBUILT = ("tables", "curves", "figures")


def keep_reference(root: Path) -> tuple[Path, list[str]]:
    """Keep the evidence of the project's runs; write its report, and the results in README.md and docs/.

    The costs of the stages are kept beside it. The report says of what is missing that it was not run.

    Args:
        root: the project's directory, in which the pipeline has run.

    Returns:
        The folder of the reference, and the names of the runs that the parameters name and nobody has made.

    Raises:
        DatasetError: there is no run, or one is malformed; the message names it.
    """
    folder = root / "reports" / "reference"
    missing = keep_evidence(root, folder)
    for name in REBUILT:
        shutil.rmtree(folder / name, ignore_errors=True)
    report_from(folder, folder)
    publish(root)
    costs = folder / "stage_costs.json"
    profile = load_params(folder / PARAMS).profile
    write_json(costs, stage_costs(root / COSTS, profile, read_json(costs) or []), DatasetError)
    return folder, missing


def report_from(evidence: Path, output: Path) -> dict[str, Any]:
    """Build the report from kept evidence alone: no optimiser runs, and nothing of the pipeline is needed.

    Args:
        evidence: folder of `data.evidence`.
        output: folder of the report.

    Returns:
        The content of `summary.json`.

    Raises:
        DatasetError: the folder holds no evidence, or a file of it is malformed.
    """
    if not (evidence / PARAMS).is_file() or not (evidence / RUNS).is_dir():
        raise DatasetError(
            f"{evidence}: expected {PARAMS} and {RUNS}/, as `hdsafebo keep-reference` writes them"
        )
    params = load_params(evidence / PARAMS)
    output.mkdir(parents=True, exist_ok=True)
    return build_report(
        evidence / INPUTS,
        profile=params.profile,
        git_revision=read_provenance(evidence).get("revision"),
        planned=planned_runs(params),
        isometry_points=params.isometry.points,
        settings=Uncertainty(**params.report.model_dump()),
        runs=evidence / RUNS,
        outside=evidence / IN_EVIDENCE,
        output=output,
    )


def stage_costs(path: Path, profile: str, kept: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """The last cost of every stage item under a profile, in the order in which the items first ran.

    Args:
        path: of the costs, one per line, as stages write them.
        profile: of the runs.
        kept: costs from before, perhaps of another machine.
    """
    latest: dict[tuple[str, ...], dict[str, Any]] = {}
    lines = read_text(path).splitlines() if path.exists() else []
    for cost in [*kept, *map(json.loads, lines)]:
        if cost["profile"] == profile:
            latest[(cost["stage"], *cost["item"])] = cost
    return list(latest.values())
