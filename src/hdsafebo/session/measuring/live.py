"""Recordings from a Lab Streaming Layer stream, the way most laboratories get at their amplifiers' samples.

What was received is written as a CSV recording, so that a live trial and one from a file are read, checked
and kept by the same steps. Samples have no times of their own in such a file: they follow each other at the
stream's nominal rate, which the time stamps must bear out.
"""

from __future__ import annotations

import csv
import io
import time
from collections.abc import Callable, Mapping, Sequence
from types import ModuleType
from typing import TYPE_CHECKING

import numpy as np

from hdsafebo.session.errors import RecordingError
from hdsafebo.session.measuring.csv_layout import TIME_COLUMN
from hdsafebo.session.measuring.emg import Emg
from hdsafebo.session.measuring.recording import MAX_VALUES, Annotation
from hdsafebo.typing import FloatArray

if TYPE_CHECKING:
    import pylsl

_SEARCH_S = 2.0  # streams answer within a fraction of a second
_PATIENCE_S = 5.0  # without a sample, before a stream counts as dead
_JITTER_S = 0.02  # of time stamps about an even clock: amplifiers send some ten milliseconds at once
_LONGEST_S = 3600
_ROOM_S = 60  # that the inlet can hold while nobody takes samples out


def record_stream(
    name: str,
    seconds: float,
    emg: Emg,
    labels: Mapping[str, str],
    *,
    markers: str | None = None,
    on_start: Callable[[], None] = lambda: None,
) -> bytes:
    """Record a stream from now on.

    Args:
        name: of the stream; its channels have labels and units.
        seconds: how long.
        emg: which channels are needed.
        labels: written into the recording (`session`, `trial`).
        markers: name of a stream of texts, which become annotations; None: there is none.
        on_start: called when samples are being taken: the trial may be delivered.

    Returns:
        A CSV recording.

    Raises:
        RecordingError: no such stream, or several; it lacks channels or units; it stopped, or samples are
            missing.
    """
    if not 0 < seconds <= _LONGEST_S:
        raise RecordingError(f"{seconds:g} s of {name!r}, expected more than 0 and at most {_LONGEST_S} s")
    lsl = _library()
    found = lsl.resolve_streams(wait_time=_SEARCH_S)
    stream = _Inlet(lsl, _only(found, name), name)
    events = None if markers is None else _Inlet(lsl, _only(found, markers), markers)
    columns = stream.columns(emg)
    wanted = round(seconds * stream.rate_hz)
    if not 2 <= wanted * len(columns) <= MAX_VALUES:
        raise RecordingError(
            f"{name}: {seconds:g} s are {wanted} samples of {len(columns)} channels, "
            f"expected 1 to {MAX_VALUES // len(columns)} samples"
        )
    for inlet in filter(None, (stream, events)):
        inlet.begin()
    on_start()
    samples, stamps = stream.take(wanted)
    start_s = _start(stamps, stream.rate_hz, name)
    annotations = [] if events is None else events.annotations(start_s, wanted / stream.rate_hz)
    return _as_csv(samples[:, columns], stream, columns, labels, annotations)


class _Inlet:
    """An open stream.

    Attributes:
        rate_hz: nominal rate.
        labels, units: of its channels.
    """

    def __init__(self, lsl: ModuleType, info: pylsl.StreamInfo, name: str) -> None:
        self._name = name
        self._lost = (lsl.util.LostError, lsl.util.TimeoutError)
        # Time stamps of streams from several computers are put on the clock of this one.
        self._inlet = lsl.StreamInlet(
            info, max_buflen=_ROOM_S, recover=False, processing_flags=lsl.proc_clocksync
        )
        try:
            full = self._inlet.info(timeout=_PATIENCE_S)
        except self._lost as error:
            raise self._silent(error) from None
        self.rate_hz = float(full.nominal_srate())
        self._is_text = full.channel_format() == lsl.cf_string
        self.labels = full.get_channel_labels() or []
        self.units = full.get_channel_units() or [None] * len(self.labels)

    def columns(self, emg: Emg) -> list[int]:
        """Which channels are to be kept; RecordingError unless the stream is one of samples with units."""
        if self._is_text or not self.rate_hz > 0:
            raise RecordingError(f"{self._name}: is a stream of events, expected samples at a rate")
        if not self.labels or None in self.labels:
            raise RecordingError(
                f"{self._name}: its channels have no labels, expected {', '.join(emg.muscles)}"
            )
        for label, unit in zip(self.labels, self.units, strict=True):
            if label in emg.muscles and not unit:
                raise RecordingError(f"{self._name}: channel {label} has no unit, expected uV, mV or V")
        return [i for i, label in enumerate(self.labels) if label not in emg.unread_channels]

    def begin(self) -> None:
        """Let samples arrive; what has arrived before is dropped."""
        try:
            self._inlet.open_stream(timeout=_PATIENCE_S)
        except self._lost as error:
            raise self._silent(error) from None
        self._inlet.flush()

    def take(self, wanted: int) -> tuple[FloatArray, FloatArray]:
        """The next samples (wanted, channels) and their time stamps (wanted,), in s."""
        samples: list[Sequence[float]] = []
        stamps: list[float] = []
        last = time.monotonic()
        while len(samples) < wanted:
            try:
                rows, times = self._inlet.pull_chunk(timeout=0.1, max_samples=wanted - len(samples))
            except self._lost as error:
                raise self._silent(error) from None
            samples += rows
            stamps += times
            now = time.monotonic()
            last = now if times else last
            if now - last > _PATIENCE_S:
                raise RecordingError(
                    f"{self._name}: no sample for {_PATIENCE_S:g} s, after {len(samples)} of {wanted}"
                )
        return np.array(samples, float), np.array(stamps)

    def annotations(self, start_s: float, seconds: float) -> list[Annotation]:
        """What was marked during a recording that began at a time, on the recording's clock."""
        if not self._is_text:
            raise RecordingError(f"{self._name}: is no stream of texts, expected markers")
        try:
            rows, times = self._inlet.pull_chunk(timeout=0.2)
        except self._lost as error:
            raise self._silent(error) from None
        marks = [
            Annotation(stamp - start_s, " ".join(" ".join(row).split()))
            for row, stamp in zip(rows, times, strict=True)
        ]
        return [mark for mark in marks if 0.0 <= mark.time_s <= seconds]

    def _silent(self, error: Exception) -> RecordingError:
        return RecordingError(f"{self._name}: the stream does not answer any more: {error}")


def _library() -> ModuleType:
    try:
        import pylsl
    except (ImportError, RuntimeError) as error:  # the second where its C library is missing
        raise RecordingError(
            f"streams need pylsl (pip install 'hdsafebo[lsl]'): {' '.join(str(error).split())[:200]}"
        ) from None
    return pylsl


def _only(found: Sequence[pylsl.StreamInfo], name: str) -> pylsl.StreamInfo:
    """The stream of a name."""
    same = [info for info in found if info.name() == name]
    if len(same) > 1:
        hosts = ", ".join(sorted(info.hostname() for info in same))
        raise RecordingError(f"{len(same)} streams are named {name!r} (on {hosts}), expected one")
    if not same:
        names = ", ".join(sorted({repr(info.name()) for info in found})) or "none"
        raise RecordingError(f"no stream is named {name!r}; the network has {names}")
    return same[0]


def _start(stamps: FloatArray, rate_hz: float, name: str) -> float:
    """Time of the first sample, from all time stamps; RecordingError where they are not even."""
    starts = stamps - np.arange(len(stamps)) / rate_hz
    spread = float(np.ptp(starts))
    if spread > _JITTER_S:
        raise RecordingError(
            f"{name}: its time stamps stray {spread:.3f} s from {rate_hz:g} Hz, expected at most "
            f"{_JITTER_S:g} s: samples are missing, or the rate is another one"
        )
    return float(np.median(starts))


def _as_csv(
    samples: FloatArray,
    stream: _Inlet,
    columns: list[int],
    labels: Mapping[str, str],
    annotations: Sequence[Annotation],
) -> bytes:
    """The recording as a file; numbers are written so that they are read as the same ones."""
    text = io.StringIO()
    for key, value in labels.items():
        text.write(f"# {key}: {value}\n")
    for mark in annotations:
        text.write(f"# annotation: {mark.time_s:.6f} {mark.text}\n")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([TIME_COLUMN, *(stream.labels[i] for i in columns)])
    writer.writerow(["s", *(stream.units[i] or "" for i in columns)])
    for number, row in enumerate(samples.tolist()):
        writer.writerow([f"{number / stream.rate_hz:.9f}", *row])
    return text.getvalue().encode()
