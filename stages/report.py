"""Page, figures, tables, curves and summary from the result files."""

from __future__ import annotations

from hdsafebo.pipeline.provenance import git_state
from hdsafebo.pipeline.stage import Stage, run_stage
from hdsafebo.report.build import build_report
from hdsafebo.report.data.planned import planned_runs
from hdsafebo.report.data.results import Uncertainty


def main(stage: Stage) -> None:
    """Write the report."""
    revision = git_state(stage.root)
    content = build_report(
        stage.root,
        profile=stage.params.profile,
        git_revision=None if revision is None else revision[0],
        planned=planned_runs(stage.params),
        isometry_points=stage.params.isometry.points,
        settings=Uncertainty(**stage.params.report.model_dump()),
    )
    stage.log_metrics(_flat(content))
    for name in ("index.html", "summary.json", "figures", "tables"):
        stage.log_artifact(stage.path(f"reports/{name}"))


def _flat(content: object, prefix: str = "") -> dict[str, float]:
    """Numbers of nested objects under dotted names."""
    if isinstance(content, dict):
        parts = (_flat(value, f"{prefix}{key}.") for key, value in content.items())
        return {name: number for part in parts for name, number in part.items()}
    if isinstance(content, int | float):
        return {prefix[:-1]: float(content)}
    return {}


if __name__ == "__main__":
    run_stage("report", main, blocks=["report"])
