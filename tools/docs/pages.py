"""All that is written from the code, by path."""

from __future__ import annotations

from pathlib import Path

from hdsafebo.report.sections.departures import departures_markdown
from tools.docs import api, curves, examples, methods, pipeline, rooms


def whole(root: Path) -> dict[str, str]:
    """Whole files."""
    written = {"docs/departures.md": departures_markdown()}
    for part in (api, examples, methods, rooms):
        written |= part.write(root)
    return written


def parts(root: Path) -> dict[tuple[str, str], str]:
    """Parts of files that people write, by path and name of the marks."""
    return {("docs/methods/index.md", "methods"): methods.method_table()} | pipeline.parts(root)


def stale(root: Path) -> list[Path]:
    """Pages and pictures of methods that are no more."""
    known = {*methods.write(root), "docs/methods/index.md"}
    found = [*(root / "docs/methods").glob("*.md"), *(root / curves.FOLDER).glob("*")]
    return [path for path in found if path.relative_to(root).as_posix() not in known]
