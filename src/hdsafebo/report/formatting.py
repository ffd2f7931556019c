"""How numbers are written on the page."""

from __future__ import annotations

import math

from hdsafebo.report.data.paper import PaperValue
from hdsafebo.report.stats.statistics import Comparison, Estimate


def number(value: float, digits: int = 3) -> str:
    """A number to so many significant digits, in scientific notation only below 0.0001."""
    if not math.isfinite(value):
        return "–"
    if value == 0:
        return "0"
    value = float(f"{value:.{digits}g}")  # rounded first, so that 0.9999 has the magnitude of 1
    magnitude = math.floor(math.log10(abs(value)))
    if magnitude < -4:
        return f"{value:.1e}".replace("-", "−")
    return f"{value:.{max(0, digits - 1 - magnitude)}f}".replace("-", "−")


def with_error(e: Estimate) -> str:
    """Mean ± standard error, the mean to the decimals of the error's first two digits."""
    if e.runs == 0:
        return "–"
    if not math.isfinite(e.se):
        return number(e.mean)
    if e.se == 0:
        return f"{number(e.mean)} ± 0"
    decimals = min(4, max(0, 1 - math.floor(math.log10(e.se))))
    return f"{e.mean:.{decimals}f} ± {e.se:.{decimals}f}".replace("-", "−")


def paper_text(value: PaperValue | None) -> str:
    """The paper's number as printed."""
    if value is None:
        return ""
    spread = "" if value.spread is None else f" ± {value.spread:g}{' (sd)' if value.kind == 'std' else ''}"
    return f"paper {value.value:g}{spread}"


def signed(value: float) -> str:
    """A difference, with its sign."""
    return f"+{number(value)}" if value > 0 else number(value)


def interval(c: Comparison) -> str:
    """Interval, p value and number of pairs of a comparison."""
    low, high = c.interval
    parts = [f"{number(low)} to {number(high)}"] if math.isfinite(low + high) else []
    parts += ["p < 0.0001" if c.p_value < 1e-4 else f"p = {c.p_value:.2g}", f"{c.pairs} pairs"]
    if c.infinite:
        parts.append(f"in {c.infinite} of them only one method found anything safe")
    return ", ".join(parts)
