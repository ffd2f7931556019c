"""From a recording of evoked muscle activity to the clinical selectivity index (paper, clinical experiment).

A trial stimulates for 800 ms at 10 Hz. The peak-to-peak value of each muscle is taken per pulse, averaged
over the pulses, and divided by a reference amplitude of that muscle: mu. The selectivity index is

    SI_i = mu_i / (1 + sum of mu_j over the other muscles j).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from hdsafebo.params import Block, Positive
from hdsafebo.session.errors import RecordingError
from hdsafebo.typing import FloatArray

_NEAR_RAIL = 0.999  # of the saturation level: converters clip a count or two below it
_RATE_TOLERANCE = 1e-3  # relative


class Emg(Block):
    """How the recordings are made.

    Attributes:
        muscles: names of the channels, one per muscle, in the order of the targets.
        ignored_channels: further channels a recording may hold (a trigger, say).
        rate_hz: sampling rate.
        pulse_rate_hz: of the stimulation; the paper's is 10.
        duration_s: of the stimulation; the paper's is 0.8.
        first_pulse_s: time of the first pulse from the start of the recording.
        window_ms: start and end of the response after each pulse (the start leaves the artefact out).
        reference_uv: peak-to-peak amplitude of each muscle that counts as mu = 1.
        saturation_uv: level at which the amplifier clips.
        flat_uv: a channel whose whole range is below it is a lost electrode.
    """

    muscles: Annotated[list[str], Field(min_length=1)]
    ignored_channels: list[str] = []
    rate_hz: Positive
    pulse_rate_hz: Positive = 10.0
    duration_s: Positive = 0.8
    first_pulse_s: Annotated[float, Field(ge=0)] = 0.0
    window_ms: Annotated[list[float], Field(min_length=2, max_length=2)] = [3.0, 60.0]
    reference_uv: dict[str, Positive]
    saturation_uv: Positive
    flat_uv: Positive

    @model_validator(mode="after")
    def _consistent(self) -> Emg:
        if len(set(self.muscles)) != len(self.muscles):
            raise ValueError(f"muscles holds a name twice: {self.muscles}")
        if set(self.reference_uv) != set(self.muscles):
            raise ValueError(
                f"reference_uv names {sorted(self.reference_uv)}, expected {sorted(self.muscles)}"
            )
        start, end = self.window_ms
        if not 0 <= start < end <= 1e3 / self.pulse_rate_hz:
            raise ValueError(f"window_ms {self.window_ms} does not lie within a pulse interval")
        if self.pulses < 1:
            raise ValueError(
                f"no pulse within duration_s ({self.duration_s}) at pulse_rate_hz ({self.pulse_rate_hz})"
            )
        if (end - start) * 1e-3 * self.rate_hz < 2:
            raise ValueError(
                f"rate_hz ({self.rate_hz}) gives fewer than two samples in window_ms {self.window_ms}"
            )
        return self

    @property
    def pulses(self) -> int:
        """Number of pulses of a trial; 8 in the paper."""
        return int(np.floor(self.duration_s * self.pulse_rate_hz + 1e-9))

    def windows(self) -> list[tuple[int, int]]:
        """First and last-plus-one sample of the response to each pulse."""
        start, end = (w * 1e-3 for w in self.window_ms)
        pulses = self.first_pulse_s + np.arange(self.pulses) / self.pulse_rate_hz
        return [(round((t + start) * self.rate_hz), round((t + end) * self.rate_hz)) for t in pulses]


@dataclass(frozen=True)
class Recording:
    """A recording as read from a file.

    Attributes:
        source: name of the file, for messages.
        channels: names of the columns.
        rate_hz: sampling rate, the same for all channels.
        samples_uv: (n, channels) in uV.
        labels: what the file says about itself (`session`, `trial`), where it says so.
    """

    source: str
    channels: tuple[str, ...]
    rate_hz: float
    samples_uv: FloatArray
    labels: dict[str, str] = field(default_factory=dict)


def peak_to_peak(recording: Recording, emg: Emg) -> FloatArray:
    """Mean peak-to-peak value of each muscle over the pulses, shape (muscles,), in uV.

    Raises:
        RecordingError: wrong channels or rate, too short, or a muscle's channel is not finite, flat or
            saturated within a response; the message names the file and the channel.
    """
    signal = _muscle_signals(recording, emg)
    windows = emg.windows()
    _check_length(recording, emg, windows)
    for name, trace in zip(emg.muscles, signal.T, strict=True):
        _check_trace(recording.source, name, trace, emg, windows)
    ranges = [np.ptp(signal[first:last], axis=0) for first, last in windows]
    return np.asarray(np.mean(ranges, axis=0))


def activation(recording: Recording, emg: Emg) -> FloatArray:
    """mu of each muscle: the mean peak-to-peak value over its reference, shape (muscles,)."""
    reference = np.array([emg.reference_uv[m] for m in emg.muscles])
    return peak_to_peak(recording, emg) / reference


def selectivity(mu: FloatArray) -> FloatArray:
    """Clinical selectivity index of every muscle from mu, both (..., muscles)."""
    return np.asarray(mu / (1.0 + mu.sum(axis=-1, keepdims=True) - mu))


def _muscle_signals(recording: Recording, emg: Emg) -> FloatArray:
    """(n, muscles) the muscles' channels in order."""
    have = recording.channels
    where = f"{recording.source}: channels"
    repeated = sorted({c for c in have if have.count(c) > 1})
    if repeated:
        raise RecordingError(f"{where} {', '.join(repeated)} appear twice")
    missing = [m for m in emg.muscles if m not in have]
    if missing:
        raise RecordingError(f"{where} {', '.join(missing)} are missing; it has {', '.join(have) or 'none'}")
    unknown = [c for c in have if c not in emg.muscles and c not in emg.ignored_channels]
    if unknown:
        raise RecordingError(f"{where} {', '.join(unknown)} are unknown; expected {', '.join(emg.muscles)}")
    if abs(recording.rate_hz - emg.rate_hz) > _RATE_TOLERANCE * emg.rate_hz:
        raise RecordingError(
            f"{recording.source}: sampled at {recording.rate_hz:g} Hz, expected {emg.rate_hz:g} Hz"
        )
    return recording.samples_uv[:, [have.index(m) for m in emg.muscles]]


def _check_length(recording: Recording, emg: Emg, windows: list[tuple[int, int]]) -> None:
    need, have = windows[-1][1], len(recording.samples_uv)
    if have < need:
        raise RecordingError(
            f"{recording.source}: {have / emg.rate_hz:.3f} s long, expected at least "
            f"{need / emg.rate_hz:.3f} s ({emg.pulses} pulses at {emg.pulse_rate_hz:g} Hz)"
        )


def _check_trace(
    source: str, name: str, trace: NDArray[np.float64], emg: Emg, windows: list[tuple[int, int]]
) -> None:
    bad = np.flatnonzero(~np.isfinite(trace))
    if len(bad):
        raise RecordingError(
            f"{source}: channel {name}: sample {bad[0] + 1} is {trace[bad[0]]}, expected a number"
        )
    if np.ptp(trace) < emg.flat_uv:
        raise RecordingError(
            f"{source}: channel {name} is flat: its range is {np.ptp(trace):.3g} uV, "
            f"expected {emg.flat_uv:g} uV or more"
        )
    for pulse, (first, last) in enumerate(windows, start=1):
        largest = float(np.abs(trace[first:last]).max())
        if largest >= _NEAR_RAIL * emg.saturation_uv:
            raise RecordingError(
                f"{source}: channel {name} is saturated in the response to pulse {pulse}: {largest:g} uV "
                f"of {emg.saturation_uv:g} uV"
            )
