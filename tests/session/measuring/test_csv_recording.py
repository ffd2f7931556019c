"""CSV recordings as amplifiers' programs, spreadsheets, R and pandas write them give the same numbers."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hdsafebo.session.errors import RecordingError
from hdsafebo.session.measuring.csv_recording import read_csv
from hdsafebo.session.measuring.emg import Emg, peak_to_peak
from hdsafebo.session.measuring.recordings import read_recording
from hdsafebo.session.measuring.trigger import Trigger

NAMES = ["left", "right"]
EMG = Emg(
    muscles=NAMES,
    rate_hz=1000.0,
    pulse_rate_hz=10.0,
    duration_s=0.2,
    window_ms=[3.0, 60.0],
    reference_uv={"left": 100.0, "right": 100.0},
    saturation_uv=5000.0,
    flat_uv=1.0,
)
START_S = -0.05  # recorded since before the pulse
SIZES_UV = np.array([200.0, 80.0])


def samples() -> np.ndarray:
    """(n, 2) responses of 200 and 80 uV from 10 ms after each pulse on; 5 uV before the first one."""
    since = START_S + np.arange(400) / 1000
    shape = np.where((since % 0.1 >= 0.01) & (since % 0.1 < 0.02), np.sin(since * 200 * np.pi), 0.0)
    shape = shape / np.ptp(shape)
    shape[since < 0] = np.where(np.arange(50) % 2, 2.5, -2.5) / 200
    return np.round(shape[:, None] * SIZES_UV, 4)


def table(
    delimiter: str = ",",
    decimal: str = ".",
    quote: bool = False,
    index: bool = False,
    trailing: bool = False,
    names: tuple[str, str, str] = ("time_s", *NAMES),
    units: list[str] | None = None,
    time_scale: float = 1.0,
    scale: float = 1.0,
    newline: str = "\n",
    extra: tuple[str, list[str]] | None = None,
) -> str:
    """A recording in one of many ways of writing it."""

    def text(value: float) -> str:
        return f"{value:.10g}".replace(".", decimal)

    header = [*names]
    rows = [
        [text((START_S + i / 1000) * time_scale), *(text(v * scale) for v in row)]
        for i, row in enumerate(samples().tolist())
    ]
    if extra is not None:
        header.append(extra[0])
        rows = [[*row, cell] for row, cell in zip(rows, itertools.cycle(extra[1]), strict=False)]
    if index:
        header.insert(0, "")
        rows = [[str(i), *row] for i, row in enumerate(rows, start=1)]
    if trailing:
        header.append("")
        rows = [[*row, ""] for row in rows]
    if quote:
        header = [f'"{cell}"' for cell in header]
        rows = [[f'"{row[0]}"', *row[1:]] for row in rows] if index else rows
    lines = [header, *([] if units is None else [units]), *rows]
    return newline.join(delimiter.join(line) for line in lines) + newline


WAYS = {
    "plain": table(),
    "R write.csv": table(quote=True, index=True),
    "R write.csv2": table(quote=True, index=True, delimiter=";", decimal=","),
    "pandas with its index": table(index=True),
    "semicolons, decimal commas": table(delimiter=";", decimal=","),
    "semicolons, decimal points": table(delimiter=";"),
    "tabs": table(delimiter="\t"),
    "tabs, decimal commas": table(delimiter="\t", decimal=","),
    "a row of units": table(units=["s", "uV", "uV"]),
    "a row of units, ms and mV": table(
        names=("Time", *NAMES), units=["ms", "mV", "mV"], time_scale=1000, scale=1e-3
    ),
    "units in brackets": table(names=("Time [ms]", "left [mV]", "right (mV)"), time_scale=1000, scale=1e-3),
    "units in brackets in a row": table(units=["[s]", "[µV]", "[μV]"]),
    "channels' units alone": table(names=("time", *NAMES), units=["", "V", "V"], scale=1e-6),
    "Windows, a delimiter at each end": table(newline="\r\n", trailing=True, delimiter=";", decimal=","),
    "empty lines": table(newline="\n\n"),
    "ms in the name of the column": table(names=("time_ms", *NAMES), time_scale=1000),
}


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig"])
def test_every_way_of_writing_gives_the_same_values(way: str, encoding: str) -> None:
    recording = read_recording(WAYS[way].encode(encoding), "a.csv", EMG)
    assert [c.name for c in recording.channels] == NAMES
    assert recording.channels[0].start_s == pytest.approx(START_S)
    assert recording.channels[0].rate_hz == pytest.approx(1000.0)
    np.testing.assert_allclose(peak_to_peak(recording, EMG), SIZES_UV, rtol=1e-6)


def test_windows_programs_write_microvolts_in_their_own_code_page() -> None:
    content = table(units=["s", "µV", "µV"]).encode("cp1252")
    np.testing.assert_allclose(peak_to_peak(read_recording(content, "a.csv", EMG), EMG), SIZES_UV, rtol=1e-6)


@pytest.mark.parametrize("cells", [["S 1", "", "n. def."], ["nan"], ["1e400"], [""], ["\xb5"], ['"a,b"']])
def test_an_ignored_column_may_hold_anything(cells: list[str]) -> None:
    ignoring = EMG.model_copy(update={"ignored_channels": ["Marker"]})
    content = table(extra=("Marker", cells)).encode("cp1252")
    np.testing.assert_allclose(
        peak_to_peak(read_recording(content, "a.csv", ignoring), EMG), SIZES_UV, rtol=1e-6
    )
    with pytest.raises(RecordingError, match=r"a\.csv"):
        peak_to_peak(read_recording(content, "a.csv", EMG), EMG)


@pytest.mark.parametrize("between", ["0", ""])
def test_a_column_of_marks_places_the_pulses(between: str) -> None:
    """The clock alone would look for the responses 13 ms too late."""
    cells = [between] * 400
    cells[50] = cells[51] = "1"
    late = table(extra=("TRIG", cells)).replace("-0.05,", "-0.037,", 1)
    shifted = "\n".join(
        line if i == 0 else f"{-0.037 + (i - 1) / 1000:.3f},{line.split(',', 1)[1]}"
        for i, line in enumerate(late.splitlines())
    ).encode()
    marked = EMG.model_copy(update={"trigger": Trigger(channel="TRIG", threshold=0.5)})
    np.testing.assert_allclose(
        peak_to_peak(read_recording(shifted, "a.csv", marked), marked), SIZES_UV, rtol=1e-6
    )


def test_comments_hold_labels_and_annotations() -> None:
    comment = "# session: abc\n#trial:7\n# annotation: 0.013 Stim: right\n# anything else\n"
    recording = read_csv((comment + table()).encode(), "a.csv")
    assert recording.labels == {"session": "abc", "trial": "7"}
    assert [(a.time_s, a.text) for a in recording.annotations] == [(0.013, "Stim: right")]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (table(units=["s", "uV", "g"]), "channel right: unit 'g', expected uV, mV or V"),
        (table(units=["h", "uV", "uV"]), "line 2, column time_s: 'h' is no number"),
        (table(names=("Time [h]", *NAMES)), "header is"),
        (
            table(delimiter=";", decimal=",").replace(";0;0\n", ";0.0;0\n", 1),
            "column left: '0.0' is no number",
        ),
        (table() + "0.35,1\n", "line 402: 2 values, expected 3"),
        (table() + "0.35,1_0,2\n", "line 402, column left: '1_0' is no number"),
        (table() + "0.35,,2\n", "line 402, column left: is empty, expected a finite number"),
        (
            table(newline="\r\n\r\n") + "0.35,1,inf\r\n",
            "line 803, column right: inf, expected a finite number",
        ),
        ("time_s,left,right\n" + "0,1," + "7" * 70_000 + "\n", "a line of more than 65536 bytes"),
        ("#" + "\n#" * 70_000 + "\n" + table(), "no header line in the first 65536 bytes"),
        ("x" * 70_000, "a line of more than 65536 bytes"),
        ("# annotation: soon Stim\n" + table(), "line 1: annotation at 'soon', expected SECONDS TEXT"),
        ("time_s,left,right\n", "0 samples, expected at least 2"),
        ("time_s,left,right\n0,1,2\n", "1 samples, expected at least 2"),
        ("time_s\n0\n1\n", "header is 'time_s'"),
        ("time_s,Time,left\n", "header is"),
        ("", "no header line"),
        ("# trial: 7", "no header line"),
    ],
)
def test_what_is_malformed_is_named(content: str, message: str) -> None:
    with pytest.raises(RecordingError, match=message):
        peak_to_peak(read_recording(content.encode(), "a.csv", EMG), EMG)


def test_utf_16_is_named() -> None:
    with pytest.raises(RecordingError, match=r"a\.csv: no UTF-8 text"):
        read_csv(table().encode("utf-16"), "a.csv")


@settings(max_examples=300, derandomize=True, database=None, deadline=None)
@given(
    st.sampled_from(sorted(WAYS)),
    st.lists(st.tuples(st.floats(0, 1), st.binary(max_size=3), st.integers(0, 3)), min_size=1, max_size=4),
)
def test_three_hundred_spoilt_files_are_read_or_refused(
    way: str, changes: list[tuple[float, bytes, int]]
) -> None:
    content = WAYS[way].encode()
    for place, put, cut in changes:
        at = int(place * len(content))
        content = content[:at] + put + content[at + cut :]
    values, refusal = np.zeros(2), "a.csv"
    try:
        values = peak_to_peak(read_recording(content, "a.csv", EMG), EMG)
    except RecordingError as error:
        refusal = str(error)
    assert refusal.startswith("a.csv")
    assert np.isfinite(values).all()


def test_carriage_returns_alone_are_refused_in_words() -> None:
    with pytest.raises(RecordingError, match=r"a\.csv, line 1: no line of a table: .* carriage return"):
        read_recording(table(newline="\r").encode(), "a.csv", EMG)


@pytest.mark.parametrize(
    ("header", "units", "column"),
    [
        ("time_s,left [uV],right [uV]", "s,mV,uV", "left"),
        ("time_s,left,right (V)", "s,uV,mV", "right"),
        ("time_s,left,right", "ms,uV,uV", "time_s"),
        ("Time [ms],left,right", "s,uV,uV", "Time"),
    ],
)
def test_two_units_of_one_column_are_refused(header: str, units: str, column: str) -> None:
    """Values in mV that are read as uV are a thousand times too small, and below every other check."""
    lines = table().splitlines()
    with pytest.raises(RecordingError, match=f"line 2, column {column}: the unit is"):
        read_recording("\n".join([header, units, *lines[1:]]).encode(), "a.csv", EMG)


@pytest.mark.parametrize("units", ["sec,microvolts,µV", "S,UV,uV"])
def test_one_unit_may_be_written_in_two_ways(units: str) -> None:
    lines = table().splitlines()
    content = "\n".join(["time_s,left [uV],right [μV]", units, *lines[1:]]).encode()
    np.testing.assert_allclose(peak_to_peak(read_recording(content, "a.csv", EMG), EMG), SIZES_UV, rtol=1e-3)


@pytest.mark.parametrize("mark", ["1,2", '"Mo, 1,5"', "on,5"])
@pytest.mark.parametrize("decimal", [".", ","])
def test_what_is_not_looked_at_does_not_say_how_numbers_are_written(mark: str, decimal: str) -> None:
    """A comma in a column of marks used to make decimal commas of the others' points."""
    marked = table(";", decimal, extra=("Marker", [mark] * len(samples())))
    emg = EMG.model_copy(update={"ignored_channels": ["Marker"]})
    np.testing.assert_allclose(peak_to_peak(read_recording(marked.encode(), "a.csv", emg), emg), SIZES_UV)


def test_a_clock_that_is_not_looked_at_is_no_second_time() -> None:
    emg = EMG.model_copy(update={"ignored_channels": ["Time"]})
    clocked = table(extra=("Time", ["10:00:00"] * len(samples()))).encode()
    np.testing.assert_allclose(peak_to_peak(read_recording(clocked, "a.csv", emg), emg), SIZES_UV)
    with pytest.raises(RecordingError, match="header"):
        read_recording(clocked, "a.csv", EMG)
