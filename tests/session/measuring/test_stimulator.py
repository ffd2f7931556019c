"""Hard limits against formulas written out by hand, and a session that does not start without them."""

from __future__ import annotations

import math
from copy import deepcopy

import numpy as np
import pytest

from hdsafebo.session.definition import StimulationDefinition, parse_definition
from hdsafebo.session.errors import DefinitionError
from hdsafebo.session.measuring.stimulator import Envelope
from tests.session.small import small_definition


def envelope(split: str = "single_contact", **limits: float) -> Envelope:
    data = small_definition()
    data["stimulator"]["current_split"] = split
    data["limits"] |= limits
    definition = parse_definition(data)
    assert isinstance(definition, StimulationDefinition)
    return Envelope(definition.stimulator, definition.limits)


def polarity(cathodes: list[int], anodes: list[int]) -> np.ndarray:
    row = np.zeros(16, np.int8)
    row[[c - 1 for c in cathodes]] = -1
    row[[a - 1 for a in anodes]] = 1
    return row


def allowed_by_hand(row: np.ndarray, current: float, last: float | None, e: Envelope) -> bool:
    """The limits again, contact by contact, from their definitions."""
    facts, limits = e.stimulator, e.limits
    cathodes, anodes = [i for i in range(16) if row[i] < 0], [i for i in range(16) if row[i] > 0]
    if not cathodes or not anodes or not current > 0 or not math.isfinite(current):
        return False
    ceiling = limits.restart_current_ma if last is None else last + limits.max_step_ma
    ok = current <= min(limits.max_current_ma, ceiling) * (1 + 1e-9)
    ok &= len(cathodes) <= limits.max_cathodes and len(anodes) <= limits.max_anodes
    drop = 0.0
    for pole in (cathodes, anodes):
        share = current if facts.current_split == "single_contact" else current / len(pole)
        charge = share * 1e-3 * facts.pulse_width_us * 1e-6 * 1e6
        density = charge / (facts.contact_area_mm2 / 100)
        ok &= charge <= limits.max_charge_per_phase_uc * (1 + 1e-9)
        ok &= density <= limits.max_charge_density_uc_cm2 * (1 + 1e-9)
        ok &= math.log10(charge) + math.log10(density) <= limits.max_shannon_k + 1e-9
        ok &= all(facts.impedance_ohm[i] <= limits.max_impedance_ohm for i in pole)
        drop += max(share * 1e-3 * facts.impedance_ohm[i] for i in pole)
    return bool(ok and drop <= facts.compliance_v * (1 + 1e-9))


@pytest.mark.parametrize("split", ["single_contact", "equal"])
def test_same_verdict_as_the_formulas_written_out(split: str) -> None:
    e = envelope(split, max_shannon_k=0.4, max_charge_per_phase_uc=0.3, max_charge_density_uc_cm2=9.0)
    rng = np.random.default_rng(0)
    rows = rng.choice(np.array([-1, 0, 0, 0, 1], np.int8), (4000, 16))
    currents = rng.choice([0.05, 0.15, 0.3, 0.8, 2.0, 2.5, -1.0, np.nan], 4000)
    verdicts = []
    for last in (None, 0.2, 1.9):
        fast = e.permitted(rows, currents, last)
        slow = [allowed_by_hand(r, float(c), last, e) for r, c in zip(rows, currents, strict=True)]
        assert fast.tolist() == slow
        assert [not e.breaches(r, float(c), last) for r, c in zip(rows, currents, strict=True)] == slow
        verdicts += slow
    assert 0.01 < np.mean(verdicts) < 0.99


def test_shannon_k_of_the_textbook_case() -> None:
    """1 uC per phase over 1 mm2 is 100 uC/cm2 per phase: k = log10(1 * 100) = 2."""
    data = small_definition()
    data["stimulator"] |= {"pulse_width_us": 1000.0, "contact_area_mm2": 1.0}
    definition = parse_definition(data)
    assert isinstance(definition, StimulationDefinition)
    loads = Envelope(definition.stimulator, definition.limits).loads(
        polarity([1], [2])[None], np.array([1.0]), 1.0
    )
    values = {load.name: load.value[0] for load in loads}
    assert values["charge per phase of a contact"] == pytest.approx(1.0)
    assert values["charge density of a contact"] == pytest.approx(100.0)
    assert values["Shannon's k of a contact"] == pytest.approx(2.0)


def test_every_limit_is_named_when_exceeded() -> None:
    e = envelope(max_shannon_k=-1.0, max_impedance_ohm=500.0)
    text = "; ".join(e.breaches(polarity([1, 2, 3], [4, 5, 6, 7]), 20.0, 0.1))
    for word in (
        "current is 20",
        "after 0.1 mA",
        "cathodes",
        "anodes",
        "charge per phase",
        "density",
        "Shannon",
        "voltage",
        "impedance",
    ):
        assert word in text


def test_rounding_does_not_forbid_the_limit_itself() -> None:
    e = envelope(
        max_step_ma=0.1, max_charge_per_phase_uc=5.0, max_charge_density_uc_cm2=500.0, max_shannon_k=1.8
    )
    assert not e.breaches(polarity([1], [2]), 0.8, 0.7)
    assert e.breaches(polarity([1], [2]), 0.801, 0.7)


@pytest.mark.parametrize("block", ["limits", "stimulator"])
def test_no_limit_has_a_default(block: str) -> None:
    for key in small_definition()[block]:
        data = deepcopy(small_definition())
        del data[block][key]
        with pytest.raises(DefinitionError, match=f"{block}.{key}: is missing and has no default"):
            parse_definition(data)
    data = small_definition()
    del data[block]
    with pytest.raises(DefinitionError, match=f"{block}: is missing"):
        parse_definition(data)


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        (("limits", "max_shannon_k"), 1.85, "max_shannon_k"),
        (("limits", "max_step_ma"), 0.0, "max_step_ma"),
        (("limits", "max_current_ma"), float("inf"), "max_current_ma"),
        (("limits", "restart_current_ma"), 3.0, "restart_current_ma"),
        (("limits", "restart_current_ma"), 0.01, "no first trial is possible"),
        (("stimulator", "impedance_ohm"), [900.0] * 15, "impedance_ohm"),
        (("stimulator", "current_split"), "some", "current_split"),
        (("scores", "threshold"), 11.0, "threshold"),
        (("priors", "currents_ma"), [0.2, 0.1], "must increase"),
        (("emg", "reference_uv"), {"IL_left": 1.0}, "reference_uv"),
        (("emg", "rate_hz"), 10.0, "rate_hz"),
        (("target",), "GA_left", "no muscle"),
        (("kind",), "laser", "expected one of stimulation, box, list"),
        (("surprise",), 1, "surprise: unknown key"),
    ],
)
def test_bad_values_are_named(path: tuple[str, ...], value: object, message: str) -> None:
    data = small_definition()
    block = data
    for key in path[:-1]:
        block = block[key]
    block[path[-1]] = value
    with pytest.raises(DefinitionError, match=message):
        parse_definition(data)
