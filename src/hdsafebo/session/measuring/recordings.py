"""Recordings from CSV, EDF, EDF+, BDF and BDF+ files. Nothing in a file is trusted; all of it is checked."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

from hdsafebo.session.errors import RecordingError
from hdsafebo.session.measuring.csv_recording import read_csv
from hdsafebo.session.measuring.edf_recording import read_edf
from hdsafebo.session.measuring.emg import Emg
from hdsafebo.session.measuring.recording import MAX_BYTES, Recording


def read_recording(content: bytes, name: str, emg: Emg | None = None) -> Recording:
    """Read a recording; the suffix of `name` says whether it is `.csv`, `.edf` or `.bdf`.

    Args:
        content: of the file.
        name: of the file, for messages.
        emg: says which channels need not be read, and which one holds triggers; None reads them all.

    Raises:
        RecordingError: too large, another suffix, or malformed; the message names the line or channel.
    """
    if len(content) > MAX_BYTES:
        raise RecordingError(f"{name}: {len(content)} bytes, expected at most {MAX_BYTES}")
    unread: Collection[str] = emg.unread_channels if emg is not None else ()
    suffix = Path(name).suffix.lower()
    if suffix == ".csv":
        trigger = emg.trigger if emg is not None else None
        sparse = [trigger.channel] if trigger is not None and trigger.channel is not None else []
        return read_csv(content, name, unread, sparse)
    if suffix in (".edf", ".bdf"):
        return read_edf(content, name, unread)
    raise RecordingError(f"{name}: the name ends in {suffix or 'nothing'}, expected .csv, .edf or .bdf")
