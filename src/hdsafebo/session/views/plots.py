"""Two small pictures as SVG text: calibration, and the course of a target. No plotting library is needed."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

from hdsafebo.session.session import Session
from hdsafebo.session.views.summary import CalibrationBin, calibration
from hdsafebo.session.words import shown

_WIDTH, _HEIGHT = 420, 260
_LEFT, _RIGHT, _TOP, _BOTTOM = 52, 12, 14, 40
_INK, _GREY, _SAFE, _UNSAFE = "#1b1f24", "#8a919a", "#0b5fa5", "#b3261e"


def calibration_svg(session: Session) -> str:
    """Share of recommended trials that were safe over the safe probability predicted for them."""
    bins = calibration(session)
    if not bins:
        return _frame("calibration", [_text(_WIDTH / 2, _HEIGHT / 2, "no recommended trial has a score yet")])
    axes = _Axes((0.0, len(bins)), (0.0, 1.0))
    parts = [*axes.vertical([0, 0.25, 0.5, 0.75, 1.0], "share that was safe")]
    for i, b in enumerate(bins):
        parts += _bin(axes, i + 0.5, b)
    parts.append(
        _text(_LEFT + axes.width / 2, _HEIGHT - 4, "predicted safe probability (bar) and number of trials")
    )
    return _frame("calibration", parts)


def course_svg(session: Session, target: str) -> str:
    """Outcomes of a target over the trials while it was the target, and the best safe one so far."""
    trials = [t for t in session.state.trials if t.outcomes is not None and t.safety is not None]
    shown = [t for t in trials if t.target == target or t.origin == "initial"]
    if not shown:
        return _frame("course", [_text(_WIDTH / 2, _HEIGHT / 2, "no trial with an outcome yet")])
    values = [(t.outcomes or {})[target] for t in shown]
    low, high = min(values), max(values)
    room = 0.05 * (high - low) or 1.0
    axes = _Axes((0.0, float(len(shown))), (low - room, high + room))
    parts = axes.vertical([low, (low + high) / 2, high], target)
    best: list[tuple[float, float]] = []
    for i, (trial, value) in enumerate(zip(shown, values, strict=True)):
        safe = session.space.safe(trial.safety or {})
        if safe:
            best.append((i + 0.5, max(value, best[-1][1] if best else value)))
        fill = _GREY if trial.origin == "initial" else _SAFE
        parts.append(axes.dot(i + 0.5, value, fill if safe else _UNSAFE))
    parts.append(axes.line(best))
    legend = "grey: initial, blue: later, red: unsafe, line: best safe"
    parts.append(_text(_LEFT + axes.width / 2, _HEIGHT - 6, legend))
    return _frame("course", parts)


class _Axes:
    """Data coordinates to pixels."""

    def __init__(self, x: tuple[float, float], y: tuple[float, float]) -> None:
        self.x, self.y = x, y
        self.width, self.height = _WIDTH - _LEFT - _RIGHT, _HEIGHT - _TOP - _BOTTOM

    def px(self, x: float) -> float:
        return _LEFT + self.width * (x - self.x[0]) / (self.x[1] - self.x[0])

    def py(self, y: float) -> float:
        return _TOP + self.height * (1 - (y - self.y[0]) / (self.y[1] - self.y[0]))

    def vertical(self, ticks: Sequence[float], label: str) -> list[str]:
        """Grid lines with numbers, and the axis' label."""
        parts = []
        for tick in ticks:
            y = self.py(tick)
            parts.append(
                f'<line x1="{_LEFT}" x2="{_WIDTH - _RIGHT}" y1="{y:.1f}" y2="{y:.1f}" stroke="#dfe3e8"/>'
            )
            parts.append(_text(_LEFT - 6, y + 4, f"{tick:.3g}", anchor="end"))
        middle = _TOP + self.height / 2
        parts.append(
            f'<text transform="translate(12 {middle:.0f}) rotate(-90)" text-anchor="middle" fill="{_INK}">'
            f"{escape(label)}</text>"
        )
        return parts

    def dot(self, x: float, y: float, fill: str) -> str:
        """A point."""
        return f'<circle cx="{self.px(x):.1f}" cy="{self.py(y):.1f}" r="2.6" fill="{fill}"/>'

    def line(self, points: Sequence[tuple[float, float]]) -> str:
        """A polyline."""
        path = " ".join(f"{self.px(x):.1f},{self.py(y):.1f}" for x, y in points)
        return f'<polyline points="{path}" fill="none" stroke="{_INK}" stroke-width="1.5"/>'


def _bin(axes: _Axes, x: float, b: CalibrationBin) -> list[str]:
    """Observed share with its interval, predicted probability as a bar, and the numbers below."""
    low, high = axes.py(b.interval[0]), axes.py(b.interval[1])
    centre, y = axes.px(x), axes.py(b.predicted)
    return [
        _stroke((centre, low), (centre, high), _SAFE),
        axes.dot(x, b.observed, _SAFE),
        _stroke((centre - 12, y), (centre + 12, y), _INK),
        _text(centre, _HEIGHT - 27, f"{b.low:g}-{b.high:g}"),
        _text(centre, _HEIGHT - 16, f"n = {b.trials}"),
    ]


def _stroke(start: tuple[float, float], end: tuple[float, float], colour: str) -> str:
    places = f'x1="{start[0]:.1f}" y1="{start[1]:.1f}" x2="{end[0]:.1f}" y2="{end[1]:.1f}"'
    return f'<line {places} stroke="{colour}" stroke-width="2"/>'


def _text(x: float, y: float, text: str, anchor: str = "middle") -> str:
    return f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}" fill="{_INK}">{escape(shown(text))}</text>'


def _frame(name: str, parts: Sequence[str]) -> str:
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {_WIDTH} {_HEIGHT}" role="img" '
        f'aria-label="{name}" '
        f'font-family="system-ui, sans-serif" font-size="10">{"".join(parts)}</svg>'
    )
