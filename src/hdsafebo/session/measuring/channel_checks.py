"""What makes a channel's samples no measurement: no numbers, a lost electrode, an end of the range."""

from __future__ import annotations

import numpy as np

from hdsafebo.session.errors import RecordingError
from hdsafebo.session.measuring.recording import Channel
from hdsafebo.typing import FloatArray

_NEAR_RAIL = 0.999  # of the saturation level: converters clip a count or two below it


def check_trace(channel: Channel, source: str, flat_uv: float) -> None:
    """All samples of a channel (in uV) are numbers, and they vary.

    Args:
        channel: of a muscle.
        source: name of the recording, for messages.
        flat_uv: smallest range of a channel whose electrode is in place.

    Raises:
        RecordingError: names the channel.
    """
    trace, where = channel.values, f"{source}: channel {channel.name}"
    bad = np.flatnonzero(~np.isfinite(trace))
    if len(bad):
        raise RecordingError(f"{where}: sample {bad[0] + 1} is {trace[bad[0]]}, expected a number")
    if np.ptp(trace) < flat_uv:
        raise RecordingError(
            f"{where} is flat: its range is {np.ptp(trace):.3g} uV, expected {flat_uv:g} uV or more"
        )


def check_saturation(
    channel: Channel, response: FloatArray, where: str, pulse: int, saturation_uv: float
) -> None:
    """Within a response, neither the amplifier nor the file's numbers are at an end of their range.

    Args:
        channel: of a muscle, in uV.
        response: its samples after one pulse.
        where: recording and channel, for messages.
        pulse: which pulse, from 1.
        saturation_uv: level at which the amplifier clips.

    Raises:
        RecordingError: the true value of a sample is unknown, since it may lie beyond the end.
    """
    largest = float(np.abs(response).max())
    if largest >= _NEAR_RAIL * saturation_uv:
        raise RecordingError(
            f"{where} is saturated in the response to pulse {pulse}: {largest:g} uV of {saturation_uv:g} uV"
        )
    span = channel.highest - channel.lowest  # infinite where the file gives no range
    if not np.isfinite(span):
        return
    for end, left in (
        (channel.lowest, response.min() - channel.lowest),
        (channel.highest, channel.highest - response.max()),
    ):
        if left <= 0.5 * (1.0 - _NEAR_RAIL) * span:
            raise RecordingError(
                f"{where} is saturated in the response to pulse {pulse}: it reaches {end:g} uV, the end of "
                "the range that the file gives it; where that range was fitted to the samples, write the "
                "file with the amplifier's own"
            )
