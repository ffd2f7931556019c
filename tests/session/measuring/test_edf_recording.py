"""EDF, EDF+, BDF and BDF+: what other programs write is read rightly, and every malformed file is named."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import edfio
import numpy as np
import pyedflib
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hdsafebo.session.errors import RecordingError
from hdsafebo.session.measuring.edf_recording import read_edf
from hdsafebo.session.measuring.emg import Emg, peak_to_peak
from hdsafebo.session.measuring.recordings import read_recording
from hdsafebo.session.measuring.trigger import Trigger
from tests.session.measuring.edf_files import EdfFile, Signal, signals_of

NAMES = ["left", "right"]
RATE = 1000
EMG = Emg(
    muscles=NAMES,
    rate_hz=float(RATE),
    pulse_rate_hz=10.0,
    duration_s=0.8,
    window_ms=[3.0, 60.0],
    reference_uv={"left": 100.0, "right": 100.0},
    saturation_uv=5000.0,
    flat_uv=1.0,
)
SIZES_UV = np.array([200.0, 80.0])
COUNT_UV = 12000 / 65535


def samples(seconds: int = 2, first_pulse_s: float = 0.0) -> np.ndarray:
    """(n, 2) responses of 200 and 80 uV from 10 to 20 ms after each pulse; quiet before the first one."""
    since = np.arange(seconds * RATE) / RATE - first_pulse_s
    phase = np.where(since > -1e-9, (since + 1e-9) % 0.1, 0.0)
    shape = np.where((phase >= 0.01) & (phase < 0.02), np.sin(phase * 200 * np.pi), 0.0)
    return (shape / np.ptp(shape))[:, None] * SIZES_UV


def measured(content: bytes, name: str = "a.edf", emg: Emg = EMG) -> np.ndarray:
    return peak_to_peak(read_recording(content, name, emg), emg)


def file(**changes: object) -> EdfFile:
    bdf = bool(changes.get("bdf", False))
    return replace(EdfFile(signals_of(samples(), NAMES, RATE, bdf)), **changes)


def close(found: np.ndarray) -> None:
    np.testing.assert_allclose(found, SIZES_UV, atol=2 * COUNT_UV)


@pytest.mark.parametrize("kind", ["EDF", "EDF+", "BDF", "BDF+"])
def test_files_of_pyedflib(kind: str, tmp_path: Path) -> None:
    path = tmp_path / f"a.{kind[:3].lower()}"
    types = {
        "EDF": pyedflib.FILETYPE_EDF,
        "EDF+": pyedflib.FILETYPE_EDFPLUS,
        "BDF": pyedflib.FILETYPE_BDF,
        "BDF+": pyedflib.FILETYPE_BDFPLUS,
    }
    limit = 2 ** (23 if kind.startswith("BDF") else 15)
    with pyedflib.EdfWriter(str(path), 2, file_type=types[kind]) as writer:
        for i, name in enumerate(NAMES):
            writer.setSignalHeader(
                i,
                {
                    "label": name,
                    "dimension": "mV",
                    "sample_frequency": RATE,
                    "physical_max": 6.0,
                    "physical_min": -6.0,
                    "digital_max": limit - 1,
                    "digital_min": -limit,
                    "transducer": "",
                    "prefilter": "",
                },
            )
        if kind.endswith("+"):
            writer.setRecordingAdditional("session=abc;trial=7")
            writer.writeAnnotation(0.3, -1, "Stim")
        writer.writeSamples([np.ascontiguousarray(column) / 1000 for column in samples().T])
    recording = read_recording(path.read_bytes(), path.name, EMG)
    close(peak_to_peak(recording, EMG))
    if kind.endswith("+"):
        assert recording.labels == {"session": "abc", "trial": "7"}
        assert [(a.time_s, a.text) for a in recording.annotations] == [(0.3, "Stim")]


@pytest.mark.parametrize("bdf", [False, True])
def test_files_of_edfio(bdf: bool) -> None:
    signal, whole = (edfio.BdfSignal, edfio.Bdf) if bdf else (edfio.EdfSignal, edfio.Edf)
    made = whole(
        [
            signal(column, RATE, label=name, physical_dimension="uV", physical_range=(-6000, 6000))
            for name, column in zip(NAMES, samples().T, strict=True)
        ],
        annotations=[edfio.EdfAnnotation(0.3, None, "Stim ä")],
    )
    recording = read_recording(made.to_bytes(), "a.bdf" if bdf else "a.edf", EMG)
    close(peak_to_peak(recording, EMG))
    assert [(a.time_s, a.text) for a in recording.annotations] == [(0.3, "Stim ä")]


@pytest.mark.parametrize("bdf", [False, True])
@pytest.mark.parametrize("unit", [b"uV", b"UV", "µV".encode(), "μV".encode(), "µV".encode("latin-1")])
def test_microvolts_in_every_spelling(bdf: bool, unit: bytes) -> None:
    signals = [replace(s, unit=unit) for s in signals_of(samples(), NAMES, RATE, bdf)]
    close(measured(EdfFile(signals, bdf=bdf).to_bytes(), "a.bdf" if bdf else "a.edf"))


@pytest.mark.parametrize("bdf", [False, True])
def test_a_file_is_the_same_in_one_piece_and_in_blocks(bdf: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    content = file(bdf=bdf).to_bytes()
    whole = read_edf(content, "a.edf").channels
    monkeypatch.setattr("hdsafebo.session.measuring.edf_recording._BLOCK", 6000)  # one record
    for first, second in zip(whole, read_edf(content, "a.edf").channels, strict=True):
        np.testing.assert_array_equal(first.values, second.values)


@pytest.mark.parametrize("start", [0.0, 0.327, -0.05, 3600.5])
def test_the_first_time_stamp_is_the_first_samples_time(start: float) -> None:
    pulse = round(start + 0.25, 3)
    emg = EMG.model_copy(update={"first_pulse_s": pulse})
    stamps = [f"{start + i:+.3f}" for i in range(2)]
    signals = signals_of(samples(first_pulse_s=0.25), NAMES, RATE)
    content = EdfFile(signals, reserved="EDF+C", stamps=stamps).to_bytes()
    close(measured(content, emg=emg))
    before = EMG.model_copy(update={"first_pulse_s": start - 0.1})
    with pytest.raises(RecordingError, match="after the response to the pulse"):
        measured(content, emg=before)


def test_a_discontinuous_file_without_a_gap_is_read_and_one_with_a_gap_is_not() -> None:
    whole = file(reserved="EDF+D", stamps=["+0", "+1"])
    close(measured(whole.to_bytes()))
    for reserved in ("EDF+D", "EDF+C"):
        for stamp in ("+1.0005", "+0.9995", "+5", "+0"):
            gap = replace(whole, reserved=reserved, stamps=["+0", stamp])
            with pytest.raises(
                RecordingError, match=r"a\.edf: data record 2 begins .*parts of the recording are"
            ):
                measured(gap.to_bytes())
    with pytest.raises(RecordingError, match=r"parts are missing \(EDF\+D\)"):
        measured(file(reserved="EDF+D").to_bytes())
    with pytest.raises(RecordingError, match="data record 2 has no time stamp"):
        measured(replace(whole, stamps=["+0", ""]).to_bytes())


def test_annotations_place_the_pulses() -> None:
    late = signals_of(samples(first_pulse_s=0.307), NAMES, RATE)
    marked = EMG.model_copy(update={"trigger": Trigger(annotation="Stim")})
    for notes in (["+0.807\x14Stim\x14other"], [f"+{0.807 + i / 10:.4f}\x150.01\x14Stim" for i in range(8)]):
        made = EdfFile(late, reserved="EDF+C", stamps=["+0.5", "+1.5"], annotations={0: notes})
        close(measured(made.to_bytes(), emg=marked))
    with pytest.raises(RecordingError, match="no trigger: no annotation 'Stim'; it has 'other'"):
        measured(replace(made, annotations={0: ["+0.8\x14other"]}).to_bytes(), emg=marked)
    with pytest.raises(RecordingError, match=r"2 triggers, expected 1 \(of the trial\) or 8"):
        measured(replace(made, annotations={0: ["+0.8\x14Stim", "+0.9\x14Stim"]}).to_bytes(), emg=marked)


@pytest.mark.parametrize("rate", [RATE, 4 * RATE])
def test_a_trigger_without_unit_and_at_another_rate_places_the_pulses(rate: int) -> None:
    rises = np.zeros((2, rate), int)
    for pulse in range(8):
        at = round((0.307 + pulse / 10) * rate)
        rises[at // rate, at % rate : at % rate + rate // 500] = 100
    trigger = Signal("TRIG", rises, unit=b"", physical=("-327.68", "327.67"))
    content = EdfFile([*signals_of(samples(first_pulse_s=0.307), NAMES, RATE), trigger]).to_bytes()
    marked = EMG.model_copy(update={"trigger": Trigger(channel="TRIG", threshold=0.5)})
    close(measured(content, emg=marked))
    with pytest.raises(RecordingError, match="channel TRIG never rises"):
        measured(content, emg=EMG.model_copy(update={"trigger": Trigger(channel="TRIG", threshold=5.0)}))
    with pytest.raises(RecordingError, match="channels TRIG are unknown"):
        measured(content)


def test_codes_of_a_status_channel_place_the_pulses() -> None:
    """BioSemi keeps triggers in the lower bits of a channel whose upper bits say how the amplifier is."""
    codes = np.full((2, RATE), -(2**23) | 0x10000)
    codes[0, 307:317] |= 4
    codes[0, 100:110] |= 64
    status = Signal("Status", codes, unit=b"Boolean", physical=("-8388608", "8388607"))
    content = EdfFile(
        [*signals_of(samples(first_pulse_s=0.307), NAMES, RATE, True), status], bdf=True
    ).to_bytes()
    close(measured(content, "a.bdf", EMG.model_copy(update={"trigger": Trigger(channel="Status", bits=4)})))


BROKEN = [
    Signal("ACC", np.zeros((2, 25), int), unit=b"g"),
    Signal("OFF", np.zeros((2, 50), int), range=("0", "0")),
    Signal("TURNED", np.zeros((2, 50), int), range=("100", "-100")),
    Signal("NONE", np.zeros((2, 50), int), range=("", "x")),
    Signal("STILL", np.zeros((2, 50), int), physical=("1", "1")),
    Signal("NAN", np.zeros((2, 50), int), physical=("nan", "1")),
    Signal("HUGE", np.zeros((2, 50), int), physical=("-1e300", "1e300")),
]


@pytest.mark.parametrize("broken", BROKEN, ids=lambda s: s.label)
def test_what_is_wrong_with_a_channel_is_named_unless_the_channel_is_ignored(broken: Signal) -> None:
    content = EdfFile([broken, *signals_of(samples(), NAMES, RATE), broken]).to_bytes()
    close(measured(content, emg=EMG.model_copy(update={"ignored_channels": [broken.label]})))
    with pytest.raises(RecordingError, match=broken.label):
        measured(content)
    if broken.label != "ACC":
        renamed = replace(broken, label="left", digital=np.zeros((2, RATE), int))
        wrong = EdfFile([renamed, signals_of(samples(), NAMES, RATE)[1]]).to_bytes()
        with pytest.raises(RecordingError, match=r"a\.edf: channel left: its (digital|physical)? ?range"):
            measured(wrong)


def test_samples_at_the_end_of_the_files_range_are_refused() -> None:
    """Clipped at 40 uV, which is far below the amplifier's level: 80 uV for 200."""
    step = 80 / 65535
    digital = np.round((np.clip(samples(), -40, 40) + 40) / step - 2**15).astype(int).reshape(2, RATE, 2)
    signals = [Signal(n, digital[:, :, i], physical=("-40", "40")) for i, n in enumerate(NAMES)]
    with pytest.raises(
        RecordingError, match="channel left is saturated in the response to pulse 1: it reaches"
    ):
        measured(EdfFile(signals).to_bytes())
    half = [replace(s, digital=s.digital // 2, physical=("-80", "80")) for s in signals]
    assert measured(EdfFile(half).to_bytes()) == pytest.approx(80.0, abs=0.1)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"duration": "0"}, "data records of '0' s, expected a duration above 0"),
        ({"duration": ""}, "data records of '' s"),
        ({"duration": "-1"}, "data records of '-1' s"),
        ({"duration": "nan"}, "data records of 'nan' s"),
        ({"duration": "1_0"}, "data records of '1_0' s"),
        ({"records": -1}, "was not closed"),
        ({"records": 0}, "0 data records"),
        ({"records": 3}, "its header says"),
        ({"duration": "0.5"}, "sampled at 2000 Hz, expected 1000 Hz"),
    ],
)
def test_malformed_headers_are_named(changes: dict[str, object], message: str) -> None:
    with pytest.raises(RecordingError, match=rf"^a\.edf: .*{message}"):
        measured(file(**changes).to_bytes())


def test_cut_and_foreign_files_are_named_without_any_path() -> None:
    good = file(reserved="EDF+C", stamps=["+0", "+1"]).to_bytes()
    for content in (good[:100], good[:300], b"", b"0" * 5000, good[:-1], good + b"\x00", b"\x00" * 300):
        with pytest.raises(RecordingError, match=r"^x\.edf: (?!.*/tmp)"):
            measured(content, "x.edf")


@settings(max_examples=600, derandomize=True, database=None, deadline=None)
@given(
    st.booleans(),
    st.lists(st.tuples(st.integers(0, 1500), st.binary(min_size=1, max_size=8)), min_size=1, max_size=4),
    st.integers(0, 50),
)
def test_six_hundred_spoilt_files_are_read_or_refused(
    bdf: bool, changes: list[tuple[int, bytes]], cut: int
) -> None:
    """No other exception and no warning, whatever stands in the header or the time stamps."""
    content = file(
        bdf=bdf, reserved="EDF+C", stamps=["+0", "+1"], annotations={0: ["+0.3\x14Stim"]}
    ).to_bytes()
    for at, put in changes:
        at = at if at < 1100 else len(content) - (at - 1100)
        content = content[:at] + put + content[at + len(put) :]
    content = content[: -cut or None] if cut < 5 else content
    values, refusal = np.zeros(2), "a.edf"
    try:
        values = measured(content)
    except RecordingError as error:
        refusal = str(error)
    assert refusal.startswith("a.edf")
    assert np.isfinite(values).all()


@pytest.mark.parametrize("bdf", [False, True])
@pytest.mark.parametrize(
    ("field", "values"),
    [("physical", ("-6_000", "6000")), ("physical", ("-6000", "6_000")), ("range", ("-3_2768", "32767"))],
)
def test_ends_of_a_range_are_decimal_digits(bdf: bool, field: str, values: tuple[str, str]) -> None:
    """Python reads 6_000 as 6000: one changed byte would be another amplitude."""
    good = file(bdf=bdf)
    spoilt = [replace(signal, **{field: values}) for signal in good.signals]
    with pytest.raises(
        RecordingError, match=rf"channel left: its {'digital' if field == 'range' else field} range"
    ):
        read_edf(replace(good, signals=spoilt).to_bytes(), "a.bdf" if bdf else "a.edf")
