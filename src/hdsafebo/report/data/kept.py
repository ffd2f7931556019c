"""The runs of the committed evidence, as the pages of the documentation and README.md read them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from hdsafebo.params import load_params
from hdsafebo.report.data.evidence import PARAMS, RUNS
from hdsafebo.report.data.planned import planned_runs, read_planned
from hdsafebo.report.data.results import Results, Uncertainty


@dataclass(frozen=True)
class KeptRuns:
    """What is kept, and what is to be.

    Attributes:
        results: of the runs that are kept.
        planned: every task and method that the evidence's parameters run.
        profile: of the parameters.
    """

    results: Results
    planned: list[tuple[str, str]]
    profile: str


def read_kept(evidence: Path) -> KeptRuns | None:
    """The kept runs; None while no run is kept.

    Args:
        evidence: folder of `data.evidence`.

    Raises:
        DatasetError: a file of the evidence is missing or malformed.
    """
    if not (evidence / RUNS).is_dir():
        return None
    params = load_params(evidence / PARAMS)
    planned = planned_runs(params)
    runs, _ = read_planned(evidence / RUNS, planned)
    return KeptRuns(Results(runs, Uncertainty(**params.report.model_dump())), planned, params.profile)
