"""Recordings from EDF, EDF+, BDF and BDF+ files; edfio reads header and samples.

EDF+ is described by Kemp and Olivan (2003, Clin Neurophysiol 114:1755); BDF, of BioSemi, is EDF with
samples of three bytes. A file is a header of 256 bytes, another 256 bytes for each signal, and data records;
in EDF+ one signal of each record is text: the time stamp of the record, and annotations.
"""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from hdsafebo.session.errors import RecordingError
from hdsafebo.session.measuring.csv_layout import LABELS
from hdsafebo.session.measuring.edf_annotations import read_time_stamps
from hdsafebo.session.measuring.recording import MAX_CHANNELS, MAX_VALUES, Channel, Recording

if TYPE_CHECKING:
    from edfio import Bdf, BdfSignal, Edf, EdfSignal

_FIXED, _PER_SIGNAL = 256, 256  # bytes of the header
_LABEL_BYTES, _COUNT_BYTES = 16, 8
_RANGES_AT = 104
_COUNTS_AT = 216  # bytes per signal of the header fields before the samples per record
_MAX_RECORDS = 100_000
_WHOLE = re.compile(rb"\s*[+-]?\d+\s*")
_DECIMAL = re.compile(rb"\s*[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?\s*")
_LARGEST, _NARROWEST = 1e12, 1e-12  # of a physical range: beyond them scaling runs over or under
_BLOCK = 2 * 2**20  # bytes that are unpacked at once: BDF takes nine times its size while it is


@dataclass(frozen=True)
class _Layout:
    """Sizes from the header.

    Attributes:
        bdf: whether samples have three bytes.
        records: number of data records.
        duration_s: of a data record.
        labels: of all signals.
        counts: samples of each signal in a data record.
    """

    bdf: bool
    records: int
    duration_s: float
    labels: list[str]
    counts: list[int]

    @property
    def sample_bytes(self) -> int:
        """Bytes of a sample."""
        return 3 if self.bdf else 2

    @property
    def header_bytes(self) -> int:
        """Bytes before the first data record."""
        return _FIXED + _PER_SIGNAL * len(self.labels)

    @property
    def record_bytes(self) -> int:
        """Bytes of a data record."""
        return self.sample_bytes * sum(self.counts)

    @property
    def text_signals(self) -> list[int]:
        """Which signals are the text of EDF+ or BDF+."""
        label = "BDF Annotations" if self.bdf else "EDF Annotations"
        return [i for i, found in enumerate(self.labels) if found == label]


def read_edf(content: bytes, name: str, unread: Collection[str] = ()) -> Recording:
    """Read an EDF or BDF recording, with or without annotations.

    Args:
        content: of the file.
        name: of the file, for messages.
        unread: channels that are not looked at.

    Raises:
        RecordingError: malformed, or parts are missing in between; the message names the channel.
    """
    layout = _layout(content, name)
    start_s, annotations = read_time_stamps(_texts(content, layout), layout.duration_s, name)
    texts = layout.text_signals
    if content[192:197] in (b"EDF+D", b"BDF+D") and not texts:
        raise RecordingError(f"{name}: says that parts are missing ({content[192:197].decode()}), not which")
    read = [
        i
        for i, (label, count) in enumerate(zip(layout.labels, layout.counts, strict=True))
        if i not in texts and label not in unread and count > 0
    ]
    values = sum(layout.counts[i] for i in read) * layout.records
    if values > MAX_VALUES:
        raise RecordingError(
            f"{name}: {values} values in {len(read)} channels, expected at most {MAX_VALUES}: "
            "record less, or list what is not needed in ignored_channels"
        )
    channels, note = _channels(content, name, layout, read, start_s)
    labels = {key: found[1] for key in LABELS if (found := re.search(rf"\b{key}=([^\s;]+)", note))}
    return Recording(name, channels, annotations, labels)


def _layout(content: bytes, name: str) -> _Layout:
    """Sizes from the header, and that the file has them."""
    start = content[:8]
    bdf = start == b"\xffBIOSEMI"
    if not bdf and start.strip() != b"0":
        raise RecordingError(f"{name}: no EDF or BDF file: it begins with {start!r}")
    if len(content) < _FIXED:
        raise RecordingError(f"{name}: {len(content)} bytes, expected a header of {_FIXED}")
    records = _whole(content[236:244], "number of data records", name)
    signals = _whole(content[252:256], "number of signals", name)
    if not 1 <= signals <= MAX_CHANNELS:
        raise RecordingError(f"{name}: {signals} signals, expected 1 to {MAX_CHANNELS}")
    if len(content) < _FIXED + _PER_SIGNAL * signals:
        raise RecordingError(f"{name}: ends within its header")
    labels = [_text(f) for f in _fields(content, 0, _LABEL_BYTES, signals)]
    counts = [
        _whole(f, f"channel {label}: samples per data record", name)
        for label, f in zip(labels, _fields(content, _COUNTS_AT, _COUNT_BYTES, signals), strict=True)
    ]
    if min(counts) < 0 or sum(counts) == 0:
        raise RecordingError(f"{name}: {counts} samples per data record, expected some")
    if records == -1:
        raise RecordingError(f"{name}: was not closed: the number of its data records is -1")
    if not 1 <= records <= _MAX_RECORDS:
        raise RecordingError(f"{name}: {records} data records, expected 1 to {_MAX_RECORDS}")
    layout = _Layout(bdf, records, _duration(content, name), labels, counts)
    if layout.record_bytes > _BLOCK:
        raise RecordingError(
            f"{name}: data records of {layout.record_bytes} bytes, expected at most {_BLOCK}"
        )
    size = layout.header_bytes + layout.records * layout.record_bytes
    if len(content) != size:
        raise RecordingError(f"{name}: {len(content)} bytes, its header says {size}: cut short or damaged")
    return layout


def _duration(content: bytes, name: str) -> float:
    """Duration of a data record."""
    field = content[244:252]
    duration = float(field) if _DECIMAL.fullmatch(field) else math.nan
    if not (math.isfinite(duration) and duration > 0):
        raise RecordingError(
            f"{name}: data records of {_text(field)!r} s, expected a duration above 0: "
            "without it no channel has a rate"
        )
    return duration


def _fields(content: bytes, offset: int, width: int, signals: int) -> Iterator[bytes]:
    """A header field of every signal; `offset` counts the bytes per signal of the fields before it."""
    first = _FIXED + offset * signals
    return (content[first + i * width : first + (i + 1) * width] for i in range(signals))


def _whole(field: bytes, what: str, name: str) -> int:
    if not _WHOLE.fullmatch(field):
        raise RecordingError(f"{name}: {what}: {_text(field)!r} is no whole number")
    return int(field)


def _text(field: bytes) -> str:
    """Text of a header field: EDF asks for ASCII; "µV" is found in UTF-8 and in Latin-1."""
    try:
        return field.decode().strip()
    except UnicodeDecodeError:
        return field.decode("latin-1").strip()


def _texts(content: bytes, layout: _Layout) -> Iterator[list[bytes]]:
    """The text signals of each data record."""
    ends = np.cumsum(layout.counts) * layout.sample_bytes
    places = [(ends[i] - layout.counts[i] * layout.sample_bytes, ends[i]) for i in layout.text_signals]
    for record in range(layout.records):
        start = layout.header_bytes + record * layout.record_bytes
        yield [content[start + first : start + last] for first, last in places]


def _channels(
    content: bytes, name: str, layout: _Layout, read: list[int], start_s: float
) -> tuple[tuple[Channel, ...], str]:
    """The wanted channels, and what the header says about the recording."""
    texts = layout.text_signals
    plain = [i for i in range(len(layout.labels)) if i not in texts]  # what edfio calls the signals
    values = {i: np.empty(layout.counts[i] * layout.records) for i in read}
    ranges: dict[int, tuple[float, float]] = {}
    note = ""
    units: dict[int, str] = {}
    for first, block in _blocks(content, name, layout):
        signals = block.signals
        for i in read:
            signal = signals[plain.index(i)]
            if first == 0:
                _check_range_fields(content, i, layout, name)
                units[i] = _text(signal.physical_dimension.encode("latin-1"))
                ranges[i] = _range(signal, f"{name}: channel {layout.labels[i]}")
            at = first * layout.counts[i]
            values[i][at : at + layout.counts[i] * block.num_data_records] = signal.data
        note = block.local_recording_identification
    channels = [
        Channel(
            layout.labels[i], values[i], layout.counts[i] / layout.duration_s, start_s, units[i], *ranges[i]
        )
        for i in read
    ]
    return tuple(channels), note


def _blocks(content: bytes, name: str, layout: _Layout) -> Iterator[tuple[int, Edf | Bdf]]:
    """Parts of the file, each read as a file of its own, and the number of its first data record."""
    import edfio

    step = max(1, _BLOCK // layout.record_bytes)
    for first in range(0, layout.records, step):
        count = min(step, layout.records - first)
        at = layout.header_bytes + first * layout.record_bytes
        header = content[:236] + f"{count:<8d}".encode() + content[244 : layout.header_bytes]
        part = header + content[at : at + count * layout.record_bytes]
        read = edfio.read_bdf if layout.bdf else edfio.read_edf
        try:
            yield first, read(part, header_encoding="latin-1")
        except (ValueError, IndexError, OverflowError) as error:
            raise RecordingError(f"{name}: no valid file: {' '.join(str(error).split())[:200]}") from None


def _check_range_fields(content: bytes, signal: int, layout: _Layout, name: str) -> None:
    """Ends of the ranges are written in decimal digits; edfio reads them as Python does, and 1_0 as 10."""
    for number, what in enumerate(("physical", "physical", "digital", "digital")):
        field = list(_fields(content, _RANGES_AT + 8 * number, 8, len(layout.labels)))[signal]
        if not _DECIMAL.fullmatch(field):
            raise RecordingError(
                f"{name}: channel {layout.labels[signal]}: its {what} range cannot be read: "
                f"{_text(field)!r} is no number"
            )


def _range(signal: EdfSignal | BdfSignal, where: str) -> tuple[float, float]:
    """Lowest and highest value that a sample of the signal can have, in its unit."""
    try:
        digital, physical = signal.digital_range, signal.physical_range
    except ValueError as error:
        raise RecordingError(f"{where}: its range cannot be read: {error}") from None
    if not digital.min < digital.max:
        raise RecordingError(
            f"{where}: its digital range is {digital.min} to {digital.max}, expected a range"
        )
    span = abs(physical.max - physical.min)
    if not (span >= _NARROWEST and max(abs(physical.min), abs(physical.max)) <= _LARGEST):
        raise RecordingError(
            f"{where}: its physical range is {physical.min:g} to {physical.max:g}, expected a range"
        )
    return min(physical), max(physical)
