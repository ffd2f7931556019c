"""The drawing of the package's layers, from their contract in pyproject.toml."""

from __future__ import annotations

import textwrap
import tomllib
from importlib import import_module
from pathlib import Path
from xml.sax.saxutils import escape

WIDTH, MARGIN, GAP, LINE = 960, 16, 8, 15
_STYLE = (
    "text{font-family:system-ui,sans-serif;fill:#1b1b1b} .name{font:bold 13px ui-monospace,monospace}"
    " .about{font-size:11.5px;fill:#444} .card{fill:#fff} .room{fill:#eef4f8;stroke:#7a9db5}"
    " @media (prefers-color-scheme:dark){text{fill:#e6e6e6} .about{fill:#b8b8b8} .card{fill:#16181d}"
    " .room{fill:#1d2730;stroke:#4d6a7d}}"
)


def write(root: Path) -> dict[str, str]:
    """Texts by path below the project's root."""
    return {"docs/rooms.svg": _drawing(layers(root))}


def layers(root: Path) -> list[list[str]]:
    """Names of rooms, those of a layer together, the highest layer first."""
    contracts = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["importlinter"]
    found = next(c for c in contracts["contracts"] if c.get("containers") == ["hdsafebo"])
    return [[room.strip() for room in layer.split("|")] for layer in found["layers"]]


def _drawing(rows: list[list[str]]) -> str:
    parts, y = [], MARGIN
    for row in rows:
        width = (WIDTH - 2 * MARGIN - GAP * (len(row) - 1)) / len(row)
        texts = [textwrap.wrap(_about(room), max(12, int((width - 20) / 6.1))) for room in row]
        height = 28 + LINE * max(map(len, texts))
        for i, (room, lines) in enumerate(zip(row, texts, strict=True)):
            x = MARGIN + i * (width + GAP)
            parts.append(
                f'<rect class="room" x="{x:.1f}" y="{y}" width="{width:.1f}" height="{height}" rx="5"/>'
            )
            parts.append(f'<text class="name" x="{x + 10:.1f}" y="{y + 19}">{escape(room)}</text>')
            parts += [
                f'<text class="about" x="{x + 10:.1f}" y="{y + 20 + LINE * (n + 1)}">{escape(line)}</text>'
                for n, line in enumerate(lines)
            ]
        y += height + GAP
    height = y - GAP + MARGIN
    head = (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {height}" width="{WIDTH}" '
        f'height="{height}" role="img">\n<title>Layers of the package, the highest first: each imports only '
        f'from those below it</title>\n<style>{_STYLE}</style>\n<rect class="card" width="{WIDTH}" '
        f'height="{height}" rx="8"/>\n'
    )
    return head + "\n".join(parts) + "\n</svg>\n"


def _about(room: str) -> str:
    """First sentence of a room's docstring."""
    text = (import_module(f"hdsafebo.{room}").__doc__ or "").strip().split("\n\n")[0].replace("\n", " ")
    return text.split(": `")[0].rstrip(".").replace("`", "")
