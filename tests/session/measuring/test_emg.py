"""EMG: exact values on signals that are known, and every malformed recording refused by name."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from hdsafebo.session.definition import StimulationDefinition, parse_definition
from hdsafebo.session.errors import DefinitionError, RecordingError
from hdsafebo.session.measuring.emg import Emg, activation, peak_to_peak, samples_digest, selectivity
from hdsafebo.session.measuring.recording import Annotation, Channel, Recording
from hdsafebo.session.measuring.recordings import read_recording
from hdsafebo.session.measuring.trigger import Trigger
from tests.session.small import small_definition


@pytest.fixture(scope="module")
def emg() -> Emg:
    definition = parse_definition(small_definition())
    assert isinstance(definition, StimulationDefinition)
    return definition.emg


def signal(emg: Emg, seconds: float = 0.8) -> np.ndarray:
    """Sines of 50 Hz, peak-to-peak 20 uV times the number of the muscle times that of the pulse."""
    t = np.arange(round(seconds * emg.rate_hz)) / emg.rate_hz
    pulse = np.floor(t * emg.pulse_rate_hz + 1e-9) + 1
    return np.sin(2 * np.pi * 50 * t)[:, None] * pulse[:, None] * 10 * (np.arange(8) + 1)


def csv(
    emg: Emg,
    samples: np.ndarray,
    names: list[str] | None = None,
    rate: float | None = None,
    comment: str = "",
) -> bytes:
    rate = rate or emg.rate_hz
    rows = [f"{i / rate:.6f}," + ",".join(f"{v:.4f}" for v in row) for i, row in enumerate(samples)]
    return (comment + ",".join(["time_s", *(names or emg.muscles)]) + "\n" + "\n".join(rows) + "\n").encode()


def recorded(emg: Emg, samples: np.ndarray, start_s: float = 0.0, **changes: Any) -> Recording:
    """A recording of samples (n, muscles) in uV."""
    channels = [
        Channel(name, samples[:, i], emg.rate_hz, start_s, **changes) for i, name in enumerate(emg.muscles)
    ]
    return Recording("made", tuple(channels))


def test_peak_to_peak_is_the_mean_over_the_pulses(emg: Emg) -> None:
    found = peak_to_peak(read_recording(csv(emg, signal(emg)), "a.csv"), emg)
    expected = 2 * 10 * (np.arange(8) + 1) * np.mean(np.arange(1, 9))  # 8 pulses in 800 ms at 10 Hz
    np.testing.assert_allclose(found, expected, rtol=1e-5)
    np.testing.assert_allclose(
        activation(read_recording(csv(emg, signal(emg)), "a.csv"), emg), expected / 800.0, rtol=1e-5
    )


def test_artefact_before_the_window_does_not_count(emg: Emg) -> None:
    with_artefact = signal(emg)
    for pulse in range(8):
        with_artefact[int(pulse * 0.1 * emg.rate_hz) : int((pulse * 0.1 + 0.0025) * emg.rate_hz)] = 4999.0
    np.testing.assert_allclose(
        peak_to_peak(read_recording(csv(emg, with_artefact), "a.csv"), emg),
        peak_to_peak(read_recording(csv(emg, signal(emg)), "a.csv"), emg),
        rtol=1e-6,
    )


def test_selectivity_is_the_papers_formula() -> None:
    mu = np.array([0.5, 0.2, 0.1])
    np.testing.assert_allclose(selectivity(mu), [0.5 / 1.3, 0.2 / 1.6, 0.1 / 1.7])
    np.testing.assert_allclose(selectivity(np.stack([mu, 2 * mu]))[1], [1.0 / 1.6, 0.4 / 2.2, 0.2 / 2.4])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda e, s: csv(e, s[:, :7], e.muscles[:7]), "channels BF_right are missing"),
        (lambda e, s: csv(e, np.c_[s, s[:, 0]], [*e.muscles, "EKG"]), "channels EKG are unknown"),
        (lambda e, s: csv(e, np.c_[s, s[:, 0]], [*e.muscles, "IL_left"]), "IL_left appear twice"),
        (lambda e, s: csv(e, s, rate=1000.0), "sampled at 1000 Hz, expected 2000 Hz"),
        (lambda e, s: csv(e, s[:1000]), "0.500 s long, expected at least"),
        (lambda e, s: csv(e, s * [1, 1, 1, 0, 1, 1, 1, 1]), "channel BF_left is flat"),
        (lambda e, s: csv(e, np.clip(s * 20, -5000, 5000)), "saturated in the response to pulse"),
        (
            lambda e, s: csv(e, np.where(np.arange(len(s))[:, None] == 9, np.nan, s)),
            "line 11, column IL_left: nan",
        ),
        (lambda e, s: csv(e, s).replace(b"\n0.004500,", b"\n0.002500,"), "line 11: times out of order"),
        (
            lambda e, s: csv(e, s).replace(b"\n0.004500,", b"\n0.004500,oops,"),
            "line 11: 10 values, expected 9",
        ),
        (
            lambda e, s: csv(e, s).replace(b"\n0.004500,", b"\n0.00450x,"),
            "line 11, column time_s: '0.00450x' is no number",
        ),
        (lambda e, s: csv(e, np.delete(s, 40, axis=0)).replace(b"0.020000,", b"0.020300,"), "uneven"),
        (lambda e, s: b"", "no header"),
        (lambda e, s: b"a,b\n1,2\n", "header is 'a,b'"),
        (lambda e, s: b"\xff\xfe\x00", "no UTF-8"),
    ],
)
def test_malformed_csv_is_refused(emg: Emg, change: object, message: str) -> None:
    with pytest.raises(RecordingError, match=message):
        peak_to_peak(read_recording(change(emg, signal(emg)), "trial.csv"), emg)  # type: ignore[operator]


def test_other_files_are_refused(emg: Emg) -> None:
    with pytest.raises(RecordingError, match=r"\.pkl, expected \.csv, \.edf or \.bdf"):
        read_recording(b"x", "a.pkl")
    with pytest.raises(RecordingError, match="expected at most"):
        read_recording(bytes(33 * 2**20), "a.csv")


def test_not_finite_samples_are_refused_whatever_the_reader(emg: Emg) -> None:
    samples = signal(emg)
    samples[5, 2] = np.inf
    with pytest.raises(RecordingError, match="channel TA_left: sample 6 is inf"):
        peak_to_peak(recorded(emg, samples), emg)


@pytest.mark.parametrize("start_s", [-0.05, -0.0505, 0.0, 1.25])
@pytest.mark.parametrize("first_pulse_s", [0.0, 0.02, 1.3])
def test_the_pulse_is_looked_for_on_the_recordings_own_clock(
    emg: Emg, start_s: float, first_pulse_s: float
) -> None:
    """Whatever the first sample's time, the same responses give the same values; what is missing is said."""
    timed = emg.model_copy(update={"first_pulse_s": first_pulse_s})
    before = round((first_pulse_s - start_s) * emg.rate_hz)
    if before < 0:
        with pytest.raises(RecordingError, match=f"begins at {start_s:g} s, after the response"):
            peak_to_peak(recorded(emg, signal(emg), start_s), timed)
        return
    quiet = np.tile([[0.0], [2.5]], (before, 8))[:before]
    samples = np.vstack([quiet, signal(emg)])
    expected = peak_to_peak(recorded(emg, signal(emg)), emg)
    np.testing.assert_allclose(peak_to_peak(recorded(emg, samples, start_s), timed), expected)
    with pytest.raises(RecordingError, match="s long, expected at least"):
        peak_to_peak(recorded(emg, samples[:-200], start_s), timed)


def test_a_response_at_the_end_of_the_files_own_range_is_refused(emg: Emg) -> None:
    """Clipped to 40 uV, far below the amplifier's level: 80 would be measured for what is larger."""
    clipped = np.clip(signal(emg), -40.0, 40.0)
    with pytest.raises(
        RecordingError, match="channel IL_left is saturated in the response to pulse 4: it reach"
    ):
        peak_to_peak(recorded(emg, clipped, lowest=-40.0, highest=40.0), emg)
    in_mv = recorded(emg, clipped / 1000, lowest=-0.04, highest=0.04, unit="mV")
    with pytest.raises(RecordingError, match="reaches -40 uV"):
        peak_to_peak(in_mv, emg)
    wide = recorded(emg, signal(emg), lowest=-5000.0, highest=5000.0)
    np.testing.assert_array_equal(peak_to_peak(wide, emg), peak_to_peak(recorded(emg, signal(emg)), emg))


@pytest.mark.parametrize(
    ("unit", "factor"),
    [("uV", 1.0), ("µV", 1.0), ("μV", 1.0), (" UV ", 1.0), ("mV", 1e3), ("V", 1e6), ("nV", 1e-3)],
)
def test_units_of_voltage(emg: Emg, unit: str, factor: float) -> None:
    found = peak_to_peak(recorded(emg, signal(emg) / factor, unit=unit), emg)
    np.testing.assert_allclose(found, peak_to_peak(recorded(emg, signal(emg)), emg))


def test_what_nobody_asked_for_needs_no_unit_and_no_rate(emg: Emg) -> None:
    odd = Channel("ACC", np.zeros(3), 25.0, unit="g")
    recording = Recording("made", (*recorded(emg, signal(emg)).channels, odd, odd))
    with pytest.raises(RecordingError, match="channels ACC appear twice"):
        peak_to_peak(recording, emg)
    ignoring = emg.model_copy(update={"ignored_channels": ["ACC"]})
    np.testing.assert_array_equal(
        peak_to_peak(recording, ignoring), peak_to_peak(recorded(emg, signal(emg)), emg)
    )
    odd_one = tuple(_with_unit(c) for c in recorded(emg, signal(emg)).channels)
    with pytest.raises(RecordingError, match="channel TA_left: unit 'g', expected uV, mV or V"):
        peak_to_peak(Recording("made", odd_one), emg)


def _with_unit(channel: Channel) -> Channel:
    return Channel(
        channel.name, channel.values, channel.rate_hz, unit="g" if channel.name == "TA_left" else "uV"
    )


def test_a_recording_is_known_by_its_samples(emg: Emg) -> None:
    """Comments, the order of the columns and ignored channels are not what was measured."""
    plain = read_recording(csv(emg, signal(emg)), "a.csv", emg)
    labelled = read_recording(csv(emg, signal(emg), comment="# trial: 9\n# seen by ann\n"), "b.csv", emg)
    turned = csv(emg, signal(emg)[:, ::-1], emg.muscles[::-1])
    digests = {samples_digest(r, emg) for r in (plain, labelled, read_recording(turned, "c.csv", emg))}
    assert len(digests) == 1
    other = signal(emg)
    other[7, 3] += 0.01
    assert samples_digest(read_recording(csv(emg, other), "a.csv", emg), emg) not in digests


@pytest.mark.parametrize(
    ("trigger", "message"),
    [
        ({}, "expected either channel or annotation"),
        (
            {"channel": "TRIG", "threshold": 1.0, "annotation": "Stim"},
            "expected either channel or annotation",
        ),
        ({"channel": "TRIG"}, "expected threshold or bits with channel"),
        ({"channel": "TRIG", "threshold": 1.0, "bits": 1}, "expected threshold or bits with channel"),
        ({"annotation": "Stim", "threshold": 1.0}, "threshold belongs to a channel"),
        ({"channel": "TRIG", "bits": 0}, "trigger.bits"),
        ({"channel": "TRIG", "threshold": float("nan")}, "trigger.threshold"),
        ({"channel": "IL_left", "threshold": 1.0}, "trigger.channel IL_left is a muscle, too"),
    ],
)
def test_a_trigger_is_said_in_one_way(trigger: dict[str, Any], message: str) -> None:
    data = small_definition()
    data["emg"]["trigger"] = trigger
    with pytest.raises(DefinitionError, match=message):
        parse_definition(data)


def test_triggers_of_pulses_must_come_at_the_pulses_rate(emg: Emg) -> None:
    """A mark of each pulse counts for itself; marks at another rate are another protocol."""
    marked = emg.model_copy(update={"trigger": Trigger(annotation="Stim"), "first_pulse_s": 0.005})

    def measured(times: np.ndarray) -> np.ndarray:
        notes = tuple(Annotation(float(t), "Stim") for t in times[::-1])
        channels = recorded(emg, np.vstack([signal(emg), np.zeros((200, 8))])).channels
        return peak_to_peak(Recording("made", channels, notes), marked)

    marks = np.arange(8) / 10 - 0.005
    expected = peak_to_peak(recorded(emg, signal(emg)), emg)
    np.testing.assert_allclose(measured(marks), expected)
    np.testing.assert_allclose(measured(marks[:1]), expected)
    with pytest.raises(
        RecordingError, match=r"trigger 2 comes 0\.05 s after the one before, expected 0\.1 s"
    ):
        measured(np.arange(8) / 20)
    with pytest.raises(RecordingError, match=r"9 triggers, expected 1 \(of the trial\) or 8"):
        measured(np.arange(9) / 10)
