"""The stimulator's electrical facts, and the limits that no trial of a session may exceed.

The charge per phase of one contact is Q = I t, its charge density D = Q / A. Shannon's model of safe levels
is log10 D = k - log10 Q, so k = log10(D Q), with Q in uC per phase and D in uC/cm2 per phase (Shannon 1992,
IEEE Trans Biomed Eng 39:424). Tissue damage was seen from k = 1.85 up (McCreery et al. 1990, IEEE Trans
Biomed Eng 37:996, as drawn by Shannon), so a limit must lie below it; which limit is right is the user's
to say, and no default is offered for any of them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from hdsafebo.params import Block, Count, Positive
from hdsafebo.typing import FloatArray

CONTACTS = 16
SHANNON_DAMAGE_SEEN = 1.85
_ROUNDING = 1e-9  # relative: currents such as 0.7 + 0.1 must not miss a limit of 0.8

Polarity = NDArray[np.int8]


class Stimulator(Block):
    """What the stimulator and the electrode are.

    Attributes:
        pulse_width_us: width of one phase.
        contact_area_mm2: geometric area of a contact.
        current_split: `equal` when every contact of a pole has a current source of its own that carries
            an equal share; `single_contact` when the split is unknown, so that any one contact may
            carry the whole current.
        impedance_ohm: of each contact with the tissue, as measured.
        compliance_v: largest voltage of the stimulator.
    """

    pulse_width_us: Positive
    contact_area_mm2: Positive
    current_split: Literal["equal", "single_contact"]
    impedance_ohm: Annotated[list[Positive], Field(min_length=CONTACTS, max_length=CONTACTS)]
    compliance_v: Positive


class StimulationLimits(Block):
    """Hard limits, checked before and after any model; all are required.

    Attributes:
        max_current_ma: of a trial, summed over its cathodes.
        max_step_ma: largest rise above the current delivered last.
        restart_current_ma: largest current of the first trial after a start or a pause.
        max_cathodes, max_anodes: contact counts.
        max_charge_per_phase_uc: of one contact.
        max_charge_density_uc_cm2: of one contact, per phase.
        max_shannon_k: Shannon's k of one contact; below 1.85, where damage was seen.
        max_impedance_ohm: a contact above it counts as broken and is not used.
    """

    max_current_ma: Positive
    max_step_ma: Positive
    restart_current_ma: Positive
    max_cathodes: Count
    max_anodes: Count
    max_charge_per_phase_uc: Positive
    max_charge_density_uc_cm2: Positive
    max_shannon_k: Annotated[float, Field(lt=SHANNON_DAMAGE_SEEN, allow_inf_nan=False)]
    max_impedance_ohm: Positive

    @model_validator(mode="after")
    def _consistent(self) -> StimulationLimits:
        if self.restart_current_ma > self.max_current_ma:
            raise ValueError(
                f"restart_current_ma ({self.restart_current_ma}) must not exceed "
                f"max_current_ma ({self.max_current_ma})"
            )
        return self


@dataclass(frozen=True)
class Load:
    """One limited quantity of n stimulations: `value` (n,) must not exceed `limit`."""

    name: str
    unit: str
    value: FloatArray
    limit: float

    def within(self) -> NDArray[np.bool_]:
        """(n,) True where the limit holds; never where the value is NaN."""
        return np.asarray(self.value <= self.limit + _ROUNDING * abs(self.limit))


class Envelope:
    """The limits of one stimulator: which stimulations may be delivered.

    Args:
        stimulator: electrical facts.
        limits: hard limits.
    """

    def __init__(self, stimulator: Stimulator, limits: StimulationLimits) -> None:
        self.tighten(stimulator, limits)

    def tighten(self, stimulator: Stimulator, limits: StimulationLimits) -> None:
        """Let other facts and limits hold from now on."""
        self.stimulator = stimulator
        self.limits = limits

    def loads(self, polarity: Polarity, current_ma: FloatArray, last_ma: float | None) -> list[Load]:
        """Every limited quantity of n stimulations.

        Args:
            polarity: (n, 16), -1 cathode, 0 off, +1 anode.
            current_ma: (n,) total current.
            last_ma: current delivered last; None at a start or after a pause.
        """
        facts, limits = self.stimulator, self.limits
        cathodes, anodes = (polarity < 0).sum(axis=1), (polarity > 0).sum(axis=1)
        cathode_ma, anode_ma = self._shares(cathodes, current_ma), self._shares(anodes, current_ma)
        charge_uc = np.maximum(cathode_ma, anode_ma) * facts.pulse_width_us * 1e-3
        density = charge_uc / (facts.contact_area_mm2 * 1e-2)
        impedance = np.asarray(facts.impedance_ohm, float)
        worst_cathode = np.where(polarity < 0, impedance, 0.0).max(axis=1)
        worst_anode = np.where(polarity > 0, impedance, 0.0).max(axis=1)
        voltage = (cathode_ma * worst_cathode + anode_ma * worst_anode) * 1e-3
        with np.errstate(divide="ignore"):
            shannon = np.log10(density * charge_uc)
        return [
            Load("current", "mA", current_ma, limits.max_current_ma),
            self.step(current_ma, last_ma),
            Load("number of cathodes", "", cathodes.astype(float), limits.max_cathodes),
            Load("number of anodes", "", anodes.astype(float), limits.max_anodes),
            Load("charge per phase of a contact", "uC", charge_uc, limits.max_charge_per_phase_uc),
            Load("charge density of a contact", "uC/cm2", density, limits.max_charge_density_uc_cm2),
            Load("Shannon's k of a contact", "", shannon, limits.max_shannon_k),
            Load("voltage", "V", voltage, facts.compliance_v),
            Load(
                "impedance of a contact",
                "ohm",
                np.maximum(worst_cathode, worst_anode),
                limits.max_impedance_ohm,
            ),
        ]

    def step(self, current_ma: FloatArray, last_ma: float | None) -> Load:
        """The only limit that depends on the trial before; see `loads`."""
        if last_ma is None:
            return Load("current after a start or a pause", "mA", current_ma, self.limits.restart_current_ma)
        return Load(f"current after {last_ma:g} mA", "mA", current_ma, last_ma + self.limits.max_step_ma)

    def permitted(
        self, polarity: Polarity, current_ma: FloatArray, last_ma: float | None
    ) -> NDArray[np.bool_]:
        """(n,) True where a stimulation is well formed and within every limit."""
        ok = self.well_formed(polarity, current_ma)
        for load in self.loads(polarity, current_ma, last_ma):
            ok &= load.within()
        return ok

    def breaches(self, polarity: Polarity, current_ma: float, last_ma: float | None) -> list[str]:
        """What is wrong with one stimulation (polarity (16,)), in words; empty when it may be delivered."""
        table, current = polarity[None], np.array([float(current_ma)])
        if not self.well_formed(table, current)[0]:
            return [
                "expected polarities -1, 0 or 1, at least one cathode and one anode, and a positive current"
            ]
        return [
            f"{load.name} is {load.value[0]:.4g} {load.unit}".rstrip() + f", the limit {load.limit:.4g}"
            for load in self.loads(table, current, last_ma)
            if not load.within()[0]
        ]

    def _shares(self, contacts: NDArray[np.int_], current_ma: FloatArray) -> FloatArray:
        """(n,) largest current of one contact of a pole with so many contacts."""
        if self.stimulator.current_split == "single_contact":
            return current_ma
        return current_ma / np.maximum(contacts, 1)

    @staticmethod
    def well_formed(polarity: Polarity, current_ma: FloatArray) -> NDArray[np.bool_]:
        """(n,) True for polarities -1, 0, 1 with a cathode and an anode, and a positive finite current."""
        known = np.isin(polarity, (-1, 0, 1)).all(axis=1)
        poles = (polarity < 0).any(axis=1) & (polarity > 0).any(axis=1)
        return np.asarray(known & poles & np.isfinite(current_ma) & (current_ma > 0))
