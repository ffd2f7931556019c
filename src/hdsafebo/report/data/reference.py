"""Keep a finished report as committed evidence in `reports/reference`."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

from hdsafebo.errors import DatasetError

KEPT = ("index.html", "summary.json", "isometry.json", "tables", "curves", "figures")
COSTS = ".journal/stage_costs.jsonl"


def keep_reference(root: Path) -> Path:
    """Copy the report and the costs of its stages.

    Args:
        root: the project's directory, in which the pipeline has finished.

    Returns:
        The folder of the reference.

    Raises:
        DatasetError: a part of the report is missing; the message names it.
    """
    source, target = root / "reports", root / "reports" / "reference"
    missing = [name for name in KEPT if not (source / name).exists()]
    if missing:
        raise DatasetError(f"{source}: {', '.join(missing)} missing; run the pipeline first (dvc repro)")
    target.mkdir(exist_ok=True)
    for name in KEPT:
        if (source / name).is_dir():
            shutil.rmtree(target / name, ignore_errors=True)
            shutil.copytree(source / name, target / name)
        else:
            shutil.copyfile(source / name, target / name)
    profile = json.loads((source / "summary.json").read_text(encoding="utf-8"))["profile"]
    costs = json.dumps(stage_costs(root / COSTS, profile), indent=1) + "\n"
    (target / "stage_costs.json").write_text(costs, encoding="utf-8")
    return target


def stage_costs(path: Path, profile: str) -> list[dict[str, object]]:
    """The last cost of every stage item under a profile, in the order in which the items first ran."""
    latest: dict[tuple[str, ...], dict[str, object]] = {}
    for line in path.read_text(encoding="utf-8").splitlines() if path.exists() else []:
        cost = json.loads(line)
        if cost["profile"] == profile:
            latest[(cost["stage"], *cost["item"])] = cost
    return list(latest.values())
