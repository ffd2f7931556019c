"""An amplifier and a stimulator on this computer, as Lab Streaming Layer streams that nobody else can see."""

from __future__ import annotations

import threading
import time
import uuid
from collections.abc import Sequence

import numpy as np
import pylsl

# Discovery and data stay on the loopback interface; a session of its own keeps tests that run at once apart.
pylsl.set_config_content(
    "[ports]\nIPv6 = disable\n"
    "[multicast]\nResolveScope = machine\nMachineAddresses = {127.0.0.1}\nListenAddress = 127.0.0.1\n"
    f"[lab]\nKnownPeers = {{127.0.0.1}}\nSessionID = {uuid.uuid4().hex}\n"
    "[log]\nlevel = -3\n"
)
_CHUNK_S = 0.01


class Amplifier:
    """Sends a quiet signal in chunks, as an amplifier does, and a trial when one is delivered.

    Use it as a context manager.

    Args:
        trial: (n, channels) samples that follow `deliver`.
        labels, units: of the channels; None leaves them out.
        name: of the stream.
        rate_hz: nominal rate.
        lost: samples of the trial that are not sent.
    """

    def __init__(
        self,
        trial: np.ndarray,
        labels: Sequence[str] | None,
        units: Sequence[str] | None = None,
        *,
        name: str = "EMG",
        rate_hz: float = 2000.0,
        lost: slice = slice(0, 0),
    ) -> None:
        info = pylsl.StreamInfo(name, "EMG", trial.shape[1], rate_hz, pylsl.cf_double64, uuid.uuid4().hex)
        if labels is not None:
            info.set_channel_labels(list(labels))
        if units is not None:
            info.set_channel_units(list(units))
        self._outlet: pylsl.StreamOutlet | None = pylsl.StreamOutlet(info)
        self._trial, self._rate = trial, rate_hz
        self._lost = np.zeros(len(trial), bool)
        self._lost[lost] = True
        self._wanted, self._end = threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._play)
        self.delivered_at = 0.0

    def __enter__(self) -> Amplifier:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def deliver(self) -> None:
        """Let the trial begin; `delivered_at` is when, on the clock of the streams."""
        self._wanted.set()

    def stop(self) -> None:
        """Switch it off."""
        self._end.set()
        if self._thread.is_alive():
            self._thread.join()
        self._outlet = None

    def _play(self) -> None:
        begun, sent, first = pylsl.local_clock(), 0, None
        while not self._end.is_set():
            due = int((pylsl.local_clock() - begun) * self._rate)
            if first is None and self._wanted.is_set():
                first = due
                self.delivered_at = begun + first / self._rate
            numbers = np.arange(sent, due)
            rows = np.zeros((len(numbers), self._trial.shape[1]))
            kept = np.ones(len(numbers), bool)
            if first is not None:
                inside = (numbers >= first) & (numbers < first + len(self._trial))
                rows[inside] = self._trial[numbers[inside] - first]
                kept[inside] = ~self._lost[numbers[inside] - first]
            if kept.any() and self._outlet is not None:
                self._outlet.push_chunk(rows[kept].tolist(), (begun + numbers[kept] / self._rate).tolist())
            sent = due
            time.sleep(_CHUNK_S)


class Marker:
    """A stream of texts."""

    def __init__(self, name: str) -> None:
        info = pylsl.StreamInfo(name, "Markers", 1, pylsl.IRREGULAR_RATE, pylsl.cf_string, uuid.uuid4().hex)
        self._outlet = pylsl.StreamOutlet(info)

    def mark(self, text: str, at: float) -> None:
        """Send a marker for a time of the clock."""
        self._outlet.push_sample([text], at)
