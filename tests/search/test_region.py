"""Algorithm 2 as a state machine."""

import pytest

from hdsafebo.search.region import TrustRegion, TrustRegionRule, safe_update

RULE = TrustRegionRule(initial=0.8, least=0.1, most=1.6, successes=2, failures=3)


def run(outcomes: str) -> TrustRegion:
    region = TrustRegion(0.8)
    for outcome in outcomes:
        region = safe_update(region, outcome == "s", RULE)
    return region


@pytest.mark.parametrize(
    ("outcomes", "expected"),
    [
        ("s", TrustRegion(0.8, successes=1)),
        ("f", TrustRegion(0.8, failures=1)),
        ("sf", TrustRegion(0.8, failures=1)),  # lines 2 and 4: one kind of outcome clears the other's counter
        ("ffs", TrustRegion(0.8, successes=1)),
        ("ss", TrustRegion(1.6)),  # line 7
        ("ssss", TrustRegion(1.6)),  # l_max
        ("fff", TrustRegion(0.4)),  # line 9
        ("ffffff", TrustRegion(0.2)),
        ("fff" * 3, TrustRegion(0.8)),  # 0.8, 0.4, 0.2, then l_min = 0.1 is reached: lines 10 to 12
        ("sfsfsf", TrustRegion(0.8, failures=1)),
    ],
)
def test_algorithm_2(outcomes: str, expected: TrustRegion) -> None:
    assert run(outcomes) == expected


def test_paper_constants_take_seven_halvings_to_restart() -> None:
    rule = TrustRegionRule(0.8, 2.0**-7, 1.6, 10, 5)
    region, lengths = TrustRegion(0.8), []
    for _ in range(7 * 5):
        region = safe_update(region, False, rule)
        lengths.append(region.length)
    assert lengths[::5][1:] == pytest.approx([0.8 / 2**k for k in range(1, 7)])
    assert region == TrustRegion(0.8)


def test_without_restart_the_smallest_length_stays() -> None:
    rule = TrustRegionRule(0.3, 0.02, 1.0, 3, 1, factor=1.5, restart=False)
    region = TrustRegion(0.3)
    for _ in range(50):
        region = safe_update(region, False, rule)
    assert region.length == 0.02
