"""EDF and BDF files written byte by byte, after the format's description: any field can be put wrong."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np


@dataclass
class Signal:
    """One signal; `digital` (records, samples per record) are the numbers in the file."""

    label: str
    digital: np.ndarray
    unit: bytes = b"uV"
    physical: tuple[str, str] = ("-6000", "6000")
    range: tuple[str, str] | None = None


@dataclass
class EdfFile:
    """A file; fields that are None follow from the others."""

    signals: Sequence[Signal]
    bdf: bool = False
    duration: str = "1"
    records: int | None = None
    reserved: str = ""
    recording: str = "Startdate X X X X"
    stamps: Sequence[str] | None = None  # one a record; a signal of annotations is added
    annotations: dict[int, list[str]] = field(default_factory=dict)  # of each record, `+ONSET\x14TEXT`

    def to_bytes(self) -> bytes:
        """The whole file."""
        count = len(self.signals[0].digital)
        texts = [] if self.stamps is None else [self._text(i) for i in range(count)]
        size = 3 if self.bdf else 2
        width = -(-max(map(len, texts), default=0) // size) * size
        total = len(self.signals) + bool(texts)
        limit = 2 ** (8 * size - 1)
        default = (str(-limit), str(limit - 1))
        label = b"BDF Annotations" if self.bdf else b"EDF Annotations"
        version = b"\xffBIOSEMI" if self.bdf else b"0"
        shown = count if self.records is None else self.records
        header = b"".join(
            text.ljust(length)
            for text, length in (
                (version, 8),
                (b"X X X X", 80),
                (self.recording.encode(), 80),
                (b"01.01.26", 8),
                (b"10.00.00", 8),
                (str(256 * (total + 1)).encode(), 8),
                (self.reserved.encode(), 44),
                (str(shown).encode(), 8),
                (self.duration.encode(), 8),
                (str(total).encode(), 4),
            )
        )
        columns: list[list[bytes]] = [
            [
                s.label.encode("latin-1").ljust(16),
                b"".ljust(80),
                s.unit.ljust(8),
                s.physical[0].encode().ljust(8),
                s.physical[1].encode().ljust(8),
                (s.range or default)[0].encode().ljust(8),
                (s.range or default)[1].encode().ljust(8),
                b"".ljust(80),
                str(s.digital.shape[1]).encode().ljust(8),
                b"".ljust(32),
            ]
            for s in self.signals
        ]
        if texts:
            ends = [b"-1".ljust(8), b"1".ljust(8), *(d.encode().ljust(8) for d in default)]
            samples = str(width // size).encode().ljust(8)
            columns.append([label.ljust(16), b" " * 80, b" " * 8, *ends, b" " * 80, samples, b" " * 32])
        header += b"".join(column[i] for i in range(10) for column in columns)
        body = b""
        for i in range(count):
            body += b"".join(self._packed(s.digital[i]) for s in self.signals)
            if texts:
                body += texts[i].ljust(width, b"\x00")
        return header + body

    def _packed(self, digital: np.ndarray) -> bytes:
        wide = np.asarray(digital).astype("<i4").view(np.uint8).reshape(-1, 4)
        return wide[:, : 3 if self.bdf else 2].tobytes()

    def _text(self, record: int) -> bytes:
        assert self.stamps is not None
        if not self.stamps[record]:
            return b""
        lists = [f"{self.stamps[record]}\x14\x14", *(f"{a}\x14" for a in self.annotations.get(record, []))]
        return b"".join(one.encode() + b"\x00" for one in lists)


def signals_of(samples: np.ndarray, names: Sequence[str], rate: int, bdf: bool = False) -> list[Signal]:
    """Signals of one-second records from samples (n, channels) in uV, in a range of 6000 uV to both sides."""
    limit = 2 ** (23 if bdf else 15)
    step = 12000 / (2 * limit - 1)
    digital = np.round((samples + 6000) / step - limit).astype(int)
    records = len(samples) // rate
    return [Signal(n, digital[: records * rate, i].reshape(records, rate)) for i, n in enumerate(names)]
