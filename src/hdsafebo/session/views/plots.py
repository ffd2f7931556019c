"""Small pictures as SVG text: calibration, the course of a target, slices. No plotting library is needed."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

from hdsafebo.session.session import Session
from hdsafebo.session.views.slices import Slice
from hdsafebo.session.views.summary import CalibrationBin, calibration
from hdsafebo.session.words import shown

_WIDTH, _HEIGHT = 420, 260
_LEFT, _RIGHT, _TOP, _BOTTOM = 52, 12, 14, 40
_SPLIT = 150
"""Where the upper half of a slice ends."""
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


def slice_svg(line: Slice) -> str:
    """Outcome (mean, two standard deviations) and below it the safe probability along one quantity."""
    xs = [b.at for b in line.beliefs]
    low = min([b.mean - 2 * b.deviation for b in line.beliefs] + [y for _, y, _ in line.trials])
    high = max([b.mean + 2 * b.deviation for b in line.beliefs] + [y for _, y, _ in line.trials])
    room = 0.05 * (high - low) or 1.0
    x, gap = (xs[0], xs[-1]), 14
    above = _Axes(x, (low - room, high + room), height=_SPLIT - _TOP)
    below = _Axes(x, (0.0, 1.0), top=_SPLIT + gap, height=_HEIGHT - _BOTTOM - _SPLIT - gap)
    parts = above.vertical([low, (low + high) / 2, high], line.target)
    parts += below.vertical([0.0, 0.5, 1.0], "safe prob.")
    upper = [(b.at, b.mean + 2 * b.deviation) for b in line.beliefs]
    lower = [(b.at, b.mean - 2 * b.deviation) for b in reversed(line.beliefs)]
    parts += [above.area([*upper, *lower]), above.line([(b.at, b.mean) for b in line.beliefs])]
    parts += [above.dot(at, y, _SAFE if safe else _UNSAFE) for at, y, safe in line.trials]
    parts.append(below.line([(b.at, b.safe_probability) for b in line.beliefs]))
    for axes in (above, below):
        ends = ((axes.px(line.centre), axes.py(axes.y[0])), (axes.px(line.centre), axes.py(axes.y[1])))
        parts.append(_stroke(*ends, _GREY))
    for value, anchor in ((xs[0], "start"), (xs[-1], "end")):
        parts.append(_text(below.px(value), _HEIGHT - 26, f"{value:.4g}", anchor=anchor))
    label = f"{line.name} (upright line: {line.centre:.4g})"
    parts.append(_text(_LEFT + above.width / 2, _HEIGHT - 10, label))
    return _frame(f"slice along {line.name}", parts)


class _Axes:
    """Data coordinates to pixels."""

    def __init__(
        self,
        x: tuple[float, float],
        y: tuple[float, float],
        *,
        top: float = _TOP,
        height: float = _HEIGHT - _TOP - _BOTTOM,
    ) -> None:
        self.x, self.y = x, y
        self.top, self.width, self.height = top, _WIDTH - _LEFT - _RIGHT, height

    def px(self, x: float) -> float:
        return _LEFT + self.width * (x - self.x[0]) / (self.x[1] - self.x[0])

    def py(self, y: float) -> float:
        return self.top + self.height * (1 - (y - self.y[0]) / (self.y[1] - self.y[0]))

    def vertical(self, ticks: Sequence[float], label: str) -> list[str]:
        """Grid lines with numbers, and the axis' label."""
        parts = []
        for tick in ticks:
            y = self.py(tick)
            parts.append(
                f'<line x1="{_LEFT}" x2="{_WIDTH - _RIGHT}" y1="{y:.1f}" y2="{y:.1f}" stroke="#dfe3e8"/>'
            )
            parts.append(_text(_LEFT - 6, y + 4, f"{tick:.3g}", anchor="end"))
        middle = self.top + self.height / 2
        parts.append(
            f'<text transform="translate(12 {middle:.0f}) rotate(-90)" text-anchor="middle" fill="{_INK}">'
            f"{escape(label)}</text>"
        )
        return parts

    def dot(self, x: float, y: float, fill: str) -> str:
        """A point."""
        return f'<circle cx="{self.px(x):.1f}" cy="{self.py(y):.1f}" r="2.6" fill="{fill}"/>'

    def area(self, points: Sequence[tuple[float, float]]) -> str:
        """A polygon."""
        path = " ".join(f"{self.px(x):.1f},{self.py(y):.1f}" for x, y in points)
        return f'<polygon points="{path}" fill="{_SAFE}" fill-opacity="0.18"/>'

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
