"""Time stamps and annotations of EDF+ and BDF+.

edfio hands out annotations without the time stamps of the data records, and its patterns take a time that
grows with the square of the length of a malformed text. The lists are simple (Kemp and Olivan 2003,
section 2.2): +ONSET[\\x15DURATION]\\x14TEXT\\x14TEXT...\\x14\\x00; that of the time stamp has an empty text.
"""

from __future__ import annotations

import re
from collections.abc import Iterable

from hdsafebo.session.errors import RecordingError
from hdsafebo.session.measuring.recording import Annotation

_ONSET = re.compile(rb"[+-]\d{1,15}(?:\.\d{0,15})?")
_MAX_ANNOTATIONS = 100_000
_ROUNDING_S, _DRIFT = 1e-4, 1e-4  # of printed times, and of clocks (relative): no gap of a sample at 2 kHz


def read_time_stamps(
    records: Iterable[list[bytes]], duration_s: float, name: str
) -> tuple[float, tuple[Annotation, ...]]:
    """When a recording starts, on the clock that its header starts, and what is annotated.

    Args:
        records: the text signals of each data record; none in plain EDF.
        duration_s: of a data record.
        name: of the file, for messages.

    Returns:
        Time of the first sample in s after the header's start time, and the annotations.

    Raises:
        RecordingError: malformed, or there are gaps between data records.
    """
    start = before = 0.0
    annotations: list[Annotation] = []
    for number, texts in enumerate(records):
        for signal, text in enumerate(texts):
            where = f"{name}: data record {number + 1}"
            lists = _lists(text, where)
            if signal == 0:
                stamp = _stamp(lists, where)
                start = stamp if number == 0 else start
                step = stamp - before
                if number > 0 and abs(step - duration_s) > _ROUNDING_S + _DRIFT * duration_s:
                    raise RecordingError(
                        f"{where} begins {step:.6g} s after the one before, expected {duration_s:.6g} s: "
                        "parts of the recording are missing"
                    )
                before = stamp
            annotations += [Annotation(onset, note) for onset, notes in lists for note in notes if note]
            if len(annotations) > _MAX_ANNOTATIONS:
                raise RecordingError(f"{name}: more than {_MAX_ANNOTATIONS} annotations")
    return start, tuple(annotations)


def _stamp(lists: list[tuple[float, list[str]]], where: str) -> float:
    if not lists or (lists[0][1] and lists[0][1][0]):
        raise RecordingError(f"{where} has no time stamp")
    return lists[0][0]


def _lists(text: bytes, where: str) -> list[tuple[float, list[str]]]:
    """Onset and texts of each list."""
    found = []
    for piece in text.split(b"\x00"):
        if not piece:
            continue
        onset, *notes = piece.split(b"\x14")
        if not _ONSET.fullmatch(onset.partition(b"\x15")[0]):
            raise RecordingError(f"{where}: {onset[:20]!r} is no time of an annotation")
        try:
            words = [note.decode() for note in notes]
        except UnicodeDecodeError:
            raise RecordingError(f"{where}: an annotation is no UTF-8 text") from None
        found.append((float(onset.partition(b"\x15")[0]), words))
    return found
