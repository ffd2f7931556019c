"""When the pulses of a trial came: by a trigger channel, by annotations, or by the recording's clock."""

from __future__ import annotations

import numpy as np
from pydantic import model_validator

from hdsafebo.params import Block, Count
from hdsafebo.session.errors import RecordingError
from hdsafebo.session.measuring.recording import Channel, Recording
from hdsafebo.typing import FloatArray

_INTERVAL_TOLERANCE = 0.02  # relative: stimulator and amplifier have clocks of their own
_LARGEST_CODE = 2**53  # whole numbers beyond it have no bits of their own in a float
_SHOWN = 5  # annotations that a message lists


class Trigger(Block):
    """What marks the stimulation in a recording: one mark of the whole trial, or one of each pulse.

    Attributes:
        channel: the channel whose rises are the marks; it is no muscle and needs no unit of voltage.
        threshold: in the channel's own unit; a rise goes from below the threshold to it or above.
        bits: instead of a threshold, for a channel of codes (`Status` of BioSemi): a rise goes from none of
            these bits to any. 255 is the lowest eight.
        annotation: instead of a channel, the text of the annotations that are the marks.
    """

    channel: str | None = None
    threshold: float | None = None
    bits: Count | None = None
    annotation: str | None = None

    @model_validator(mode="after")
    def _one_kind(self) -> Trigger:
        if (self.channel is None) == (self.annotation is None):
            raise ValueError("expected either channel or annotation")
        given = [name for name in ("threshold", "bits") if getattr(self, name) is not None]
        if self.channel is not None and len(given) != 1:
            raise ValueError("expected threshold or bits with channel")
        if self.annotation is not None and given:
            raise ValueError(f"{given[0]} belongs to a channel, not to an annotation")
        return self

    def marks(self, recording: Recording) -> FloatArray:
        """(k,) times of the marks on the recording's clock, in s.

        Raises:
            RecordingError: the trigger channel is missing or repeated, or nothing is marked.
        """
        if self.channel is not None:
            channel = recording.channel(self.channel)
            marks = channel.start_s + self._rises(channel) / channel.rate_hz
            nothing = f"channel {self.channel} never rises ({self._rise_of(channel)})"
        else:
            marks = np.array([a.time_s for a in recording.annotations if a.text == self.annotation])
            texts = sorted({a.text for a in recording.annotations})
            have = ", ".join(map(repr, texts[:_SHOWN])) or "none"
            nothing = f"no annotation {self.annotation!r}; it has {have}"
        if not len(marks):
            raise RecordingError(f"{recording.source}: no trigger: {nothing}")
        return np.sort(marks)

    def _rises(self, channel: Channel) -> FloatArray:
        """(k,) indices of the first samples of the rises; a channel that begins high has not risen."""
        if self.bits is not None:
            codes = np.clip(channel.values, -_LARGEST_CODE, _LARGEST_CODE).astype(np.int64)
            high = (codes & self.bits) != 0
        else:
            assert self.threshold is not None
            high = channel.values >= self.threshold
        return np.asarray(np.flatnonzero(high[1:] & ~high[:-1]) + 1, float)

    def _rise_of(self, channel: Channel) -> str:
        if self.bits is not None:
            return f"to any of the bits {self.bits}"
        low, high = (np.min(channel.values), np.max(channel.values)) if len(channel.values) else (np.nan,) * 2
        return f"to {self.threshold:g}: its values are {low:g} to {high:g}"


def pulse_times(
    recording: Recording, trigger: Trigger | None, *, pulses: int, rate_hz: float, first_s: float
) -> FloatArray:
    """(pulses,) times of the pulses on the recording's clock, in s.

    Args:
        recording: with trigger channel or annotations, where `trigger` asks for them.
        trigger: what marks them; None: the clock alone does.
        pulses: how many a trial has.
        rate_hz: of the pulses.
        first_s: of the first pulse on the recording's clock, or after its mark.

    Raises:
        RecordingError: no mark, or as many as fit neither the trial nor its pulses, or another pulse rate.
    """
    train = np.arange(pulses) / rate_hz
    if trigger is None:
        return first_s + train
    marks = trigger.marks(recording)
    if len(marks) == 1:
        return marks[0] + first_s + train
    if len(marks) != pulses:
        raise RecordingError(
            f"{recording.source}: {len(marks)} triggers, expected 1 (of the "
            f"trial) or {pulses} (of its pulses)"
        )
    intervals = np.diff(marks)
    off = np.flatnonzero(np.abs(intervals * rate_hz - 1.0) > _INTERVAL_TOLERANCE)
    if len(off):
        raise RecordingError(
            f"{recording.source}: trigger {off[0] + 2} comes {intervals[off[0]]:.4g} s after the one before, "
            f"expected {1.0 / rate_hz:.4g} s"
        )
    return marks + first_s
