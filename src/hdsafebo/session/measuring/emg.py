"""From a recording of evoked muscle activity to the clinical selectivity index (paper, clinical experiment).

A trial stimulates for 800 ms at 10 Hz. The peak-to-peak value of each muscle is taken per pulse, averaged
over the pulses, and divided by a reference amplitude of that muscle: mu. The selectivity index is

    SI_i = mu_i / (1 + sum of mu_j over the other muscles j).
"""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import Field, model_validator

from hdsafebo.params import Block, Positive
from hdsafebo.session.errors import RecordingError
from hdsafebo.session.measuring.channel_checks import check_saturation, check_trace
from hdsafebo.session.measuring.recording import Channel, Recording, content_digest, in_microvolts
from hdsafebo.session.measuring.trigger import Trigger, pulse_times
from hdsafebo.typing import FloatArray

_RATE_TOLERANCE = 1e-3  # relative


class Emg(Block):
    """How the recordings are made.

    Attributes:
        muscles: names of the channels, one per muscle, in the order of the targets.
        ignored_channels: further channels a recording may hold; whatever they hold, nobody looks at them.
        rate_hz: sampling rate.
        pulse_rate_hz: of the stimulation; the paper's is 10.
        duration_s: of the stimulation; the paper's is 0.8.
        trigger: what marks the stimulation in a recording; None: its clock alone does.
        first_pulse_s: time of the first pulse on the recording's own clock (the time column of a CSV file;
            seconds after the start time of an EDF header), or after its trigger.
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
    trigger: Trigger | None = None
    first_pulse_s: float = 0.0
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
        if self.trigger is not None and self.trigger.channel in self.muscles:
            raise ValueError(f"trigger.channel {self.trigger.channel} is a muscle, too")
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

    @property
    def unread_channels(self) -> frozenset[str]:
        """Channels of a recording that need not be read."""
        used = {*self.muscles, self.trigger.channel if self.trigger is not None else None}
        return frozenset(self.ignored_channels) - used

    def clock_pulses(self) -> FloatArray:
        """(pulses,) times of the pulses where nothing but the clock tells them, in s."""
        return self.first_pulse_s + np.arange(self.pulses) / self.pulse_rate_hz

    def windows(self, pulses_s: FloatArray, start_s: float, rate_hz: float) -> list[tuple[int, int]]:
        """First and last-plus-one sample of the response to each pulse.

        Args:
            pulses_s: (pulses,) times of the pulses.
            start_s: time of the first sample on the same clock.
            rate_hz: of the samples.
        """
        start, end = (w * 1e-3 for w in self.window_ms)
        since = pulses_s - start_s
        return [(round((t + start) * rate_hz), round((t + end) * rate_hz)) for t in since.tolist()]


def muscle_channels(recording: Recording, emg: Emg) -> list[Channel]:
    """The channels of the muscles in their order, in uV.

    Raises:
        RecordingError: channels are missing, unknown or repeated, or one has another rate or no unit of
            voltage; the message names the file and the channel.
    """
    expected = {*emg.muscles, *emg.ignored_channels}
    if emg.trigger is not None and emg.trigger.channel is not None:
        expected.add(emg.trigger.channel)
    have = [c.name for c in recording.channels]
    where = f"{recording.source}: channels"
    repeated = sorted({c for c in have if have.count(c) > 1 and c not in emg.unread_channels})
    if repeated:
        raise RecordingError(f"{where} {', '.join(repeated)} appear twice")
    missing = [m for m in emg.muscles if m not in have]
    if missing:
        raise RecordingError(f"{where} {', '.join(missing)} are missing; it has {', '.join(have) or 'none'}")
    unknown = [c for c in have if c not in expected]
    if unknown:
        raise RecordingError(f"{where} {', '.join(unknown)} are unknown; expected {', '.join(emg.muscles)}")
    channels = [recording.channel(m) for m in emg.muscles]
    for channel in channels:
        if not abs(channel.rate_hz - emg.rate_hz) <= _RATE_TOLERANCE * emg.rate_hz:
            raise RecordingError(
                f"{recording.source}: channel {channel.name} is sampled at {channel.rate_hz:g} Hz, "
                f"expected {emg.rate_hz:g} Hz"
            )
    return [in_microvolts(channel, recording.source) for channel in channels]


def peak_to_peak(recording: Recording, emg: Emg) -> FloatArray:
    """Mean peak-to-peak value of each muscle over the pulses, shape (muscles,), in uV.

    Raises:
        RecordingError: as `muscle_channels` and `pulse_times`; the recording does not hold every response,
            or a muscle's channel is not finite, flat, or saturated within a response; the message names the
            file and the channel.
    """
    channels = muscle_channels(recording, emg)
    pulses_s = pulse_times(
        recording,
        emg.trigger,
        pulses=emg.pulses,
        rate_hz=emg.pulse_rate_hz,
        first_s=emg.first_pulse_s,
    )
    return np.array([_mean_range(recording.source, channel, pulses_s, emg) for channel in channels])


def activation(recording: Recording, emg: Emg) -> FloatArray:
    """mu of each muscle: the mean peak-to-peak value over its reference, shape (muscles,)."""
    reference = np.array([emg.reference_uv[m] for m in emg.muscles])
    return peak_to_peak(recording, emg) / reference


def selectivity(mu: FloatArray) -> FloatArray:
    """Clinical selectivity index of every muscle from mu, both (..., muscles)."""
    return np.asarray(mu / (1.0 + mu.sum(axis=-1, keepdims=True) - mu))


def samples_digest(recording: Recording, emg: Emg) -> str:
    """SHA-256 of what was measured of the muscles: a recording is known by it whatever its comments say."""
    return content_digest(muscle_channels(recording, emg))


def _mean_range(source: str, channel: Channel, pulses_s: FloatArray, emg: Emg) -> float:
    """Mean peak-to-peak value of one muscle, in uV, after all checks."""
    windows = emg.windows(pulses_s, channel.start_s, channel.rate_hz)
    _check_covered(source, channel, pulses_s, windows, emg)
    check_trace(channel, source, emg.flat_uv)
    responses = [channel.values[first:last] for first, last in windows]
    for pulse, response in enumerate(responses, start=1):
        check_saturation(channel, response, f"{source}: channel {channel.name}", pulse, emg.saturation_uv)
    return float(np.mean([np.ptp(response) for response in responses]))


def _check_covered(
    source: str, channel: Channel, pulses_s: FloatArray, windows: list[tuple[int, int]], emg: Emg
) -> None:
    """The recording holds the response to every pulse, from its first sample to its last."""
    if windows[0][0] < 0:
        raise RecordingError(
            f"{source}: begins at {channel.start_s:.4g} s, after the response to the pulse at "
            f"{pulses_s[0]:.4g} s has begun"
        )
    need, have = windows[-1][1], len(channel.values)
    if have < need:
        raise RecordingError(
            f"{source}: {have / channel.rate_hz:.3f} s long, expected at least "
            f"{need / channel.rate_hz:.3f} s ({emg.pulses} pulses at {emg.pulse_rate_hz:g} Hz)"
        )
