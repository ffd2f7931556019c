"""Numbers in README.md and the documentation, each written between marks from the kept evidence."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from hdsafebo.report.data.outside import OUTSIDE
from hdsafebo.report.headline import headline_markdown
from hdsafebo.report.marked import write_marked
from hdsafebo.report.results_page import (
    claims_markdown,
    growth_markdown,
    outside_markdown,
    runs_markdown,
    wide_markdown,
)

EVIDENCE = "reports/reference"
_BENCHMARKS = f"{EVIDENCE}/benchmarks"
PUBLISHED: dict[tuple[str, str], Callable[[Path], str]] = {
    ("README.md", "headline"): headline_markdown,
    ("docs/reproduction/results.md", "runs"): lambda root: runs_markdown(root / EVIDENCE),
    ("docs/reproduction/results.md", "outside"): lambda root: outside_markdown(root / OUTSIDE),
    ("docs/local.md", "growth"): lambda root: growth_markdown(root / _BENCHMARKS / "constrained_time.json"),
    ("docs/local.md", "wide"): lambda root: wide_markdown(root / _BENCHMARKS / "wide_rounds.json"),
    ("docs/reproduction/claims.md", "claims"): lambda root: claims_markdown(root / EVIDENCE),
}
"""File and name of the marks, and what is written between them, given the project's directory."""


def publish(root: Path) -> None:
    """Write every part that the project's files have.

    Args:
        root: the project's directory.

    Raises:
        DatasetError: a file lacks its marks, or a file of the evidence is malformed.
    """
    for (file, name), write in PUBLISHED.items():
        if (root / file).is_file():
            write_marked(root / file, name, write(root))
