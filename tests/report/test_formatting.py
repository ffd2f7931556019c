"""Numbers as they appear on the page."""

from __future__ import annotations

import pytest

from hdsafebo.report.data.paper import paper_size, paper_value
from hdsafebo.report.formatting import number, paper_text, signed, with_error
from hdsafebo.report.stats.statistics import Estimate

NAN = float("nan")


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (3.14159, "3.14"),
        (0.9999999, "1.00"),
        (-12.345, "−12.3"),
        (123456.0, "123000"),
        (0.00123, "0.00123"),
        (2e-7, "2.0e−07"),
        (0.0, "0"),
        (NAN, "–"),
    ],
)
def test_number(value: float, text: str) -> None:
    assert number(value) == text


@pytest.mark.parametrize(
    ("estimate", "text"),
    [
        (Estimate(3.9567, 0.15, 10), "3.96 ± 0.15"),
        (Estimate(-512.3, 12.4, 10), "−512 ± 12"),
        (Estimate(0.81234, 0.00021, 10), "0.8123 ± 0.0002"),
        (Estimate(2.0, NAN, 1), "2.00"),
        (Estimate(1.0, 0.0, 5), "1.00 ± 0"),
        (Estimate(NAN, NAN, 0), "–"),
    ],
)
def test_mean_and_error(estimate: Estimate, text: str) -> None:
    assert with_error(estimate) == text


def test_signed() -> None:
    assert signed(0.5) == "+0.500"
    assert signed(-0.5) == "−0.500"


def test_values_of_the_paper() -> None:
    value = paper_value("synthetic", "hdsafebo", "objective")
    assert paper_text(value) == "paper 3.96 ± 0.15"
    assert paper_text(paper_value("digits", "scbo", "violation")) == "paper 52.01 ± 20.28 (sd)"
    assert paper_value("synthetic", "scbo_original", "objective").value == 2.97  # type: ignore[union-attr]
    assert paper_value("scs_st", "baxus", "objective").value == 0.24  # type: ignore[union-attr]
    assert paper_value("scs_il", "hdsafebo", "objective") is None
    assert paper_value("hand", "hdsafebo", "objective") is None


def test_sizes_of_the_paper() -> None:
    assert paper_size("synthetic").runs == 100  # type: ignore[union-attr]
    assert paper_size("scs_ga").trials == 1000  # type: ignore[union-attr]
    assert paper_size("scs_il") is None
    assert paper_size("toy") is None
