"""A page with the programs of `examples/` as they stand."""

from __future__ import annotations

import ast
from pathlib import Path

ORDER = (
    "arm_gains", "gripper_mixed", "crane_payload", "own_black_box", "any_environment", "compare_methods",
    "read_runs", "plants", "session_robots",
)  # fmt: skip


def write(root: Path) -> dict[str, str]:
    """Texts by path below the project's root."""
    names = sorted((root / "examples").glob("*.py"), key=_place)
    parts = [
        "# Examples",
        "Whole programs, in the folder `examples` of a clone. The tests run each of them.",
        *(_part(path) for path in names),
    ]
    return {"docs/examples.md": "\n\n".join(parts) + "\n"}


def _place(path: Path) -> tuple[int, str]:
    """Those that ORDER names, then all others."""
    return (ORDER.index(path.stem) if path.stem in ORDER else len(ORDER), path.stem)


def _part(path: Path) -> str:
    source = path.read_text(encoding="utf-8")
    title = (ast.get_docstring(ast.parse(source)) or "").split("\n")[0].rstrip(".")
    return f'## {path.stem}\n\n{title}.\n\n```python title="examples/{path.name}"\n{source.strip()}\n```'
