"""Pages on the pipeline: every stage of dvc.yaml and what it costs, and every setting of params.yaml."""

from __future__ import annotations

import json
from collections import defaultdict
from pathlib import Path
from typing import Any

from hdsafebo.embeddings.registry import embedding_class, embedding_names
from hdsafebo.errors import ParamsError
from hdsafebo.files.yaml import read_mapping
from hdsafebo.params.model import Params
from tools.docs.docstrings import text
from tools.docs.settings import Setting, settings_of, table

COSTS = Path("reports/reference/benchmarks/standard_stage_costs.json")


def parts(root: Path) -> dict[tuple[str, str], str]:
    """Parts of pages, by path and name of the marks."""
    return {
        ("docs/reproduction/stages.md", "stages"): _stages(root),
        ("docs/reproduction/params.md", "settings"): _params(),
    }


def stages_of(root: Path) -> dict[str, dict[str, Any]]:
    """The stages of dvc.yaml by name."""
    stages: dict[str, dict[str, Any]] = read_mapping(root / "dvc.yaml", ParamsError)["stages"]
    return stages


def params_settings() -> list[Setting]:
    """Every setting of params.yaml."""
    return settings_of(Params)


def _stages(root: Path) -> str:
    costs = _costs(root)
    lines = [
        "| stage | what it does | parameters | minutes | peak GB |",
        "|---|---|---|---|---|",
    ]
    for name, stage in stages_of(root).items():
        params = ", ".join(f"`{p}`" for p in stage.get("params", []) if isinstance(p, str)).replace("${", "{")
        cost = costs.get(name)
        minutes, memory = ("–", "–") if cost is None else (f"{cost[0] / 60:.1f}", f"{cost[1] / 1000:.1f}")
        lines.append(f"| `{name}` | {stage['desc']} | {params} | {minutes} | {memory} |")
    return "\n".join(lines)


def _params() -> str:
    blocks: dict[str, list[Setting]] = defaultdict(list)
    for setting in params_settings():
        blocks[setting.name.split(".")[0]].append(setting)
    parts = []
    for name, settings in blocks.items():
        kind = Params.model_fields[name].annotation
        summary = (getattr(kind, "__doc__", "") or "").strip().split("\n")[0] if len(settings) > 1 else ""
        parts += [f"## {name}", summary, table(settings)]
        if name == "embeddings":
            parts += [_embedding(embedding) for embedding in embedding_names()]
    return "\n\n".join(part for part in parts if part)


def _embedding(name: str) -> str:
    """What a block under `embeddings.models` may set."""
    kind = embedding_class(name)
    settings = settings_of(kind.Settings)
    return "\n\n".join(
        [f"### {name}", text(kind.__doc__), table(settings) if settings else "It has no settings."]
    )


def _family(task: str) -> str:
    """The family of tasks of a task, such as `scs` of `scs_st_informed`."""
    return task.split("_")[0]


def _costs(root: Path) -> dict[str, tuple[float, float]]:
    """Seconds and peak megabytes of each stage, its items added up."""
    seconds: dict[str, float] = defaultdict(float)
    peak: dict[str, float] = defaultdict(float)
    for cost in json.loads((root / COSTS).read_text(encoding="utf-8")):
        stage = cost["stage"] if cost["stage"] != "optimize" else f"optimize_{_family(cost['item'][0])}"
        seconds[stage] += cost["seconds"]
        peak[stage] = max(peak[stage], cost["peak_mb"])
    return {name: (seconds[name], peak[name]) for name in seconds}
