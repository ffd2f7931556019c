"""EMG: exact values on signals that are known, and every malformed recording refused by name."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyedflib
import pytest

from hdsafebo.session.definition import StimulationDefinition, parse_definition
from hdsafebo.session.errors import RecordingError
from hdsafebo.session.measuring.emg import Emg, Recording, activation, peak_to_peak, selectivity
from hdsafebo.session.measuring.recordings import read_recording
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


def write_edf(path: Path, samples: np.ndarray, names: list[str], rates: list[int], unit: str = "uV") -> bytes:
    with pyedflib.EdfWriter(str(path), len(names), file_type=pyedflib.FILETYPE_EDFPLUS) as writer:
        for i, (name, rate) in enumerate(zip(names, rates, strict=True)):
            header = {
                "label": name,
                "dimension": unit,
                "sample_frequency": rate,
                "physical_max": 6000.0,
                "physical_min": -6000.0,
                "digital_max": 32767,
                "digital_min": -32768,
                "transducer": "",
                "prefilter": "",
            }
            writer.setSignalHeader(i, header)
        writer.setRecordingAdditional("session=abc;trial=7")
        writer.writeSamples([np.ascontiguousarray(samples[:rate, i]) for i, rate in enumerate(rates)])
    return path.read_bytes()


def test_edf_gives_what_csv_gives(emg: Emg, tmp_path: Path) -> None:
    one_second = signal(emg, 1.0)
    content = write_edf(tmp_path / "a.edf", one_second, list(emg.muscles), [2000] * 8)
    recording = read_recording(content, "a.edf")
    assert recording.labels == {"session": "abc", "trial": "7"}
    expected = peak_to_peak(read_recording(csv(emg, one_second), "a.csv"), emg)
    np.testing.assert_allclose(
        peak_to_peak(recording, emg), expected, atol=0.4
    )  # two counts of 12000 / 65536 uV


def test_edf_in_millivolts_is_converted(emg: Emg, tmp_path: Path) -> None:
    content = write_edf(tmp_path / "a.edf", signal(emg, 1.0) / 1000, list(emg.muscles), [2000] * 8, "mV")
    assert read_recording(content, "a.edf").samples_uv.max() == pytest.approx(signal(emg, 1.0).max(), rel=0.5)


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


def test_malformed_edf_is_refused(emg: Emg, tmp_path: Path) -> None:
    good = write_edf(tmp_path / "a.edf", signal(emg, 1.0), list(emg.muscles), [2000] * 8)
    for content in (good[:100], b"", b"0" * 5000, good[: len(good) // 2]):
        with pytest.raises(RecordingError, match=r"x\.edf"):
            peak_to_peak(read_recording(content, "x.edf"), emg)
    mixed = write_edf(tmp_path / "b.edf", signal(emg, 1.0), list(emg.muscles), [2000] * 7 + [1000])
    with pytest.raises(RecordingError, match="differ in rate"):
        read_recording(mixed, "x.edf")
    unit = write_edf(tmp_path / "c.edf", signal(emg, 1.0), list(emg.muscles), [2000] * 8, "mmHg")
    with pytest.raises(RecordingError, match="unit 'mmHg'"):
        read_recording(unit, "x.edf")


def test_other_files_are_refused(emg: Emg) -> None:
    with pytest.raises(RecordingError, match=r"\.pkl, expected \.csv or \.edf"):
        read_recording(b"x", "a.pkl")
    with pytest.raises(RecordingError, match="expected at most"):
        read_recording(bytes(33 * 2**20), "a.csv")


def test_not_finite_samples_are_refused_whatever_the_reader(emg: Emg) -> None:
    samples = signal(emg)
    samples[5, 2] = np.inf
    with pytest.raises(RecordingError, match="channel TA_left: sample 6 is inf"):
        peak_to_peak(Recording("made", tuple(emg.muscles), emg.rate_hz, samples), emg)
