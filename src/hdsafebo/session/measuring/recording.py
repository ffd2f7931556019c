"""A recording as its file or its stream gives it: every channel with its own unit, rate and range."""

from __future__ import annotations

import hashlib
import math
import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass, field

from hdsafebo.session.errors import RecordingError
from hdsafebo.typing import FloatArray

MAX_BYTES = 32 * 2**20  # of a file
MAX_VALUES = 3_000_000  # of the channels that are read: as numbers they are smaller than that file
MAX_CHANNELS = 512
MICROVOLTS = "uV"
# "µV" is written with the micro sign or with the Greek letter; NFKC makes the letter of both. The words are
# those of Lab Streaming Layer.
_IN_MICROVOLTS = {
    **{"nv": 1e-3, "uv": 1.0, "μv": 1.0, "mv": 1e3, "v": 1e6},
    **{"nanovolts": 1e-3, "microvolts": 1.0, "millivolts": 1e3, "volts": 1e6},
}


@dataclass(frozen=True)
class Channel:
    """One channel of a recording.

    Attributes:
        name: as the file writes it.
        values: (n,) samples in `unit`.
        rate_hz: sampling rate.
        start_s: time of the first sample on the recording's own clock.
        unit: as the file writes it.
        lowest, highest: ends of the range that the file says its samples have, in `unit`.
    """

    name: str
    values: FloatArray
    rate_hz: float
    start_s: float = 0.0
    unit: str = MICROVOLTS
    lowest: float = -math.inf
    highest: float = math.inf


@dataclass(frozen=True)
class Annotation:
    """Something that the recording says happened at a time, in seconds on its own clock."""

    time_s: float
    text: str


@dataclass(frozen=True)
class Recording:
    """What was recorded.

    Attributes:
        source: name of the file or stream, for messages.
        channels: all but the ignored ones, in the order of the file.
        annotations: in the order of the file.
        labels: what the file says about itself (`session`, `trial`), where it says so.
    """

    source: str
    channels: tuple[Channel, ...]
    annotations: tuple[Annotation, ...] = ()
    labels: dict[str, str] = field(default_factory=dict)

    def channel(self, name: str) -> Channel:
        """The channel of a name.

        Raises:
            RecordingError: none or several have it.
        """
        found = [c for c in self.channels if c.name == name]
        if len(found) > 1:
            raise RecordingError(f"{self.source}: channels {name} appear twice")
        if not found:
            have = ", ".join(c.name for c in self.channels) or "none"
            raise RecordingError(f"{self.source}: channels {name} are missing; it has {have}")
        return found[0]


def known_unit(text: str) -> bool:
    """Whether a text is a unit of voltage that can be converted."""
    return microvolts(text) is not None


def microvolts(unit: str) -> float | None:
    """A unit of voltage in uV; None for anything else."""
    return _IN_MICROVOLTS.get(_folded(unit))


def in_microvolts(channel: Channel, source: str) -> Channel:
    """The channel in uV.

    Raises:
        RecordingError: its unit is none of voltage.
    """
    factor = microvolts(channel.unit)
    if factor is None:
        raise RecordingError(
            f"{source}: channel {channel.name}: unit {channel.unit.strip()!r}, expected uV, mV or V"
        )
    if factor == 1.0:
        return channel
    return Channel(
        channel.name,
        channel.values * factor,
        channel.rate_hz,
        channel.start_s,
        MICROVOLTS,
        channel.lowest * factor,
        channel.highest * factor,
    )


def content_digest(channels: Sequence[Channel]) -> str:
    """SHA-256 of names, clocks and samples: the same for two files that differ in comments alone."""
    digest = hashlib.sha256()
    for channel in channels:
        digest.update(repr((channel.name, channel.rate_hz, channel.start_s, len(channel.values))).encode())
        digest.update((channel.values + 0.0).astype("<f8").tobytes())  # -0.0 becomes 0.0
    return digest.hexdigest()


def _folded(unit: str) -> str:
    return unicodedata.normalize("NFKC", unit).strip().casefold()
