"""A stream is recorded as a file would be: the same samples, the same values, the same refusals."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from hdsafebo.session.definition import StimulationDefinition, parse_definition
from hdsafebo.session.errors import RecordingError
from hdsafebo.session.measuring.emg import Emg, peak_to_peak
from hdsafebo.session.measuring.live import record_stream
from hdsafebo.session.measuring.recordings import read_recording
from hdsafebo.session.measuring.trigger import Trigger
from tests.session.browser import wait_for
from tests.session.measuring.outlets import Amplifier, Marker
from tests.session.small import small_definition

LABELS = {"session": "abc", "trial": "7"}


@pytest.fixture(scope="module")
def emg() -> Emg:
    definition = parse_definition(small_definition())
    assert isinstance(definition, StimulationDefinition)
    return definition.emg


def trial(emg: Emg) -> np.ndarray:
    """(n, 9) one second: responses of 100 uV times the muscle's number, then the trigger; rest is quiet."""
    t = np.arange(round(1.2 * emg.rate_hz)) / emg.rate_hz
    since = (t % 0.1) * (t < 0.8)
    response = np.sin(2 * np.pi * 50 * since) * (since > 0.01) * (since < 0.03)
    trigger = ((t < 0.8) & (t % 0.1 < 0.002)) * 5.0
    quiet = 0.5 * np.sin(2 * np.pi * 7 * t)[:, None]
    return np.c_[quiet + response[:, None] * 50 * (np.arange(8) + 1), trigger]


def expected(emg: Emg) -> np.ndarray:
    """What the trial gives, read from its first sample on."""
    windows = emg.windows(emg.clock_pulses(), 0.0, emg.rate_hz)
    return np.mean([np.ptp(trial(emg)[a:b, :8], axis=0) for a, b in windows], axis=0)


def amplifier(emg: Emg, **changes: Any) -> Amplifier:
    return Amplifier(trial(emg), [*emg.muscles, "TRIG"], ["microvolts"] * 8 + ["none"], **changes)


def test_a_trigger_channel_of_the_stream_places_the_pulses(emg: Emg) -> None:
    triggered = emg.model_copy(update={"trigger": Trigger(channel="TRIG", threshold=2.5)})
    with amplifier(emg) as device:
        content = record_stream("EMG", 1.6, triggered, LABELS, on_start=device.deliver)
    recording = read_recording(content, "live.csv", triggered)
    assert recording.labels == LABELS
    assert len(recording.channels[0].values) == 3200
    np.testing.assert_allclose(peak_to_peak(recording, triggered), expected(emg), rtol=1e-9)


def test_a_stream_of_markers_places_the_pulses(emg: Emg) -> None:
    """The marker comes from another stream, so that both clocks and both delays are in between."""
    marked = emg.model_copy(update={"trigger": Trigger(annotation="Stim 3"), "ignored_channels": ["TRIG"]})
    marker = Marker("Events")
    with amplifier(emg) as device:

        def deliver() -> None:
            device.deliver()
            wait_for(lambda: device.delivered_at, "the trial", seconds=5)
            marker.mark("Stim 3", device.delivered_at)

        content = record_stream("EMG", 1.6, marked, LABELS, markers="Events", on_start=deliver)
    recording = read_recording(content, "live.csv", marked)
    assert [a.text for a in recording.annotations] == ["Stim 3"]
    assert [c.name for c in recording.channels] == list(emg.muscles)
    np.testing.assert_allclose(peak_to_peak(recording, marked), expected(emg), rtol=1e-9)


def test_lost_samples_are_no_recording(emg: Emg) -> None:
    with (
        amplifier(emg, lost=slice(700, 800)) as device,
        pytest.raises(RecordingError, match=r"EMG: its time stamps stray 0\.05"),
    ):
        record_stream("EMG", 1.0, emg, LABELS, on_start=device.deliver)


def test_another_rate_than_the_nominal_one_is_noticed(emg: Emg) -> None:
    """The stream says 2,000 Hz where its samples come at 1,900."""
    with (
        amplifier(emg, lost=slice(0, None, 20)) as device,
        pytest.raises(RecordingError, match="the rate is another one"),
    ):
        record_stream("EMG", 1.0, emg, LABELS, on_start=device.deliver)


def test_a_stream_that_stops_is_an_error(emg: Emg) -> None:
    with (
        amplifier(emg) as device,
        pytest.raises(RecordingError, match=r"EMG: (no sample|the stream does not)"),
    ):
        record_stream("EMG", 30.0, emg, LABELS, on_start=device.stop)


def test_what_is_wrong_with_a_stream_is_said_before_the_trial(emg: Emg) -> None:
    begun: list[int] = []

    def record(name: str, **changes: Any) -> None:
        record_stream(name, 1.0, emg, LABELS, on_start=lambda: begun.append(1), **changes)

    labels, samples = [*emg.muscles, "TRIG"], trial(emg)
    with (
        Amplifier(samples, None, name="bare"),
        Amplifier(samples, labels, name="no units"),
        Amplifier(samples, labels, ["uV"] * 9, name="twin"),
        Amplifier(samples, labels, ["uV"] * 9, name="twin"),
    ):
        marker = Marker("Events")
        for name, message in {
            "absent": "no stream is named 'absent'; the network has 'Events', 'bare', 'no units', 'twin'",
            "twin": "2 streams are named 'twin'",
            "bare": "bare: its channels have no labels",
            "no units": "no units: channel IL_left has no unit, expected uV, mV or V",
            "Events": "Events: is a stream of events",
        }.items():
            with pytest.raises(RecordingError, match=message):
                record(name)
        for seconds in (0.0, -1.0, np.nan, 1e9):
            with pytest.raises(RecordingError, match="expected more than 0"):
                record_stream("EMG", seconds, emg, LABELS)
        del marker
    assert begun == []
