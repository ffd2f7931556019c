"""The rounds of one run on disk: results as they are acknowledged, and the optimiser's last saved state.

A run has a directory of its own, named by the digest of everything that determines it:

    rounds.log      one record per finished round, durable before the next one begins
    state-<round>   the optimiser's state after that round, to continue without computing rounds again
    lock            held while the run is computed
"""

from __future__ import annotations

import base64
import fcntl
import hashlib
import math
import os
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np

from hdsafebo.campaign.journal import Journal
from hdsafebo.errors import JournalError
from hdsafebo.files.durable import is_in_place
from hdsafebo.pipeline.provenance import digest_file, digest_json
from hdsafebo.runs.schema import Rows
from hdsafebo.trials import Trials

_KEY_LENGTH = 24
_LOCK = "lock"
_LOCK_POLL_S = 0.2
_PATIENCE_S = 180.0  # longer than a worker goes on for a campaign that was killed (see `progress`)
_ROUND_PREFIX = "round-"
_STATE_PREFIX = "state-"
_OUTCOME = "outcome"


@dataclass(frozen=True)
class Round:
    """A finished round.

    Attributes:
        points: digest of what was evaluated (see `points_digest`).
        rows: its rows in the run file.
    """

    points: str
    rows: Rows


def points_digest(trials: Trials) -> str:
    """SHA-256 of the points of a round, to the bit: inputs, codes and candidate rows."""
    state = hashlib.sha256()
    for array in (trials.x, trials.z, trials.candidate.astype(np.int64)):
        state.update(f"{array.dtype.str}{array.shape}".encode())
        state.update(np.ascontiguousarray(array).tobytes())
    return state.hexdigest()


class RunJournal:
    """The files of a run; one process at a time.

    Attributes:
        directory: the run's directory.
        rounds: finished rounds.
        state: the last round whose state was saved, and the file; None without one.
        outcome: how the run ended, plain data; None while it is not complete.

    Args:
        directory: of the journal, which holds the directories of all runs.
        name: readable part of the run's directory.
        identity: everything that determines the run, plain data.
        patience_s: how long to wait for a process that computes the same run.

    Raises:
        JournalError: the run's files are damaged or contradict each other, cannot be written, or
            another process holds the run.
    """

    def __init__(
        self, directory: Path, name: str, identity: Mapping[str, object], *, patience_s: float = _PATIENCE_S
    ) -> None:
        self.directory = directory / f"{name}-{digest_json(identity)[:_KEY_LENGTH]}"
        self._log = Journal(self.directory / "rounds.log")
        self._lock = -1
        try:
            self._lock = self._acquire(patience_s)
            self._log.refresh()
            self._log.append("identity", identity)
            self.rounds = self._read_rounds()
            self.state = self._read_state()
            outcome = self._log.records.get(_OUTCOME)
            self.outcome = cast(dict[str, Any], outcome) if outcome is not None else None
        except BaseException:
            self.close()
            raise

    def append(self, entry: Round) -> None:
        """Make the next round durable."""
        self._require_lock()
        number = len(self.rounds)
        self._log.append(f"{_ROUND_PREFIX}{number}", {"points": entry.points, "rows": _to_plain(entry.rows)})
        self.rounds.append(entry)

    def save_state(self, save: Callable[[Path], None]) -> None:
        """Make the optimiser's state after the last round durable, in place of the previous one.

        Args:
            save: writes the state to the file it is given, which is complete and durable when it returns.
        """
        number = len(self.rounds) - 1
        path = self.directory / f"{_STATE_PREFIX}{number}"
        save(path)
        self._log.append(path.name, {"sha256": digest_file(path)})
        self._keep_state(path)
        self.state = number, path

    def finish(self, outcome: dict[str, Any]) -> None:
        """Make durable that the run is complete, and how it ended; its state is needed no longer."""
        self._log.append(_OUTCOME, outcome)
        self.outcome = outcome
        self.state = None
        self._keep_state(None)

    def close(self) -> None:
        """Let other processes have the run."""
        self._log.close()
        if self._lock >= 0:
            os.close(self._lock)
            self._lock = -1

    def __enter__(self) -> RunJournal:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def _acquire(self, patience_s: float) -> int:
        try:
            handle = os.open(self.directory / _LOCK, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
        except OSError as error:
            raise JournalError(f"{self.directory}: the lock cannot be opened: {error.strerror}") from error
        deadline = time.monotonic() + patience_s
        while True:
            try:
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                if time.monotonic() > deadline:
                    os.close(handle)
                    raise JournalError(
                        f"{self.directory}: another process has computed this run for over {patience_s:.0f} s"
                    ) from None
                time.sleep(_LOCK_POLL_S)
            else:
                return handle

    def _require_lock(self) -> None:
        """JournalError when the lock's file was deleted: another process may hold a new one by now."""
        path = self.directory / _LOCK
        if not is_in_place(path, self._lock):
            raise JournalError(
                f"{path}: was deleted while the run is computed, so that another process may compute it as "
                "well; start it again, and it goes on after the rounds that are kept"
            )

    def _read_rounds(self) -> list[Round]:
        numbers = self._numbers(_ROUND_PREFIX)
        if numbers != list(range(len(numbers))):
            raise JournalError(
                f"{self._log.path}: holds rounds {numbers}; expected 0, 1, 2, ... without a gap"
            )
        records = [cast(dict[str, Any], self._log.records[f"{_ROUND_PREFIX}{n}"]) for n in numbers]
        return [Round(record["points"], _from_plain(record["rows"])) for record in records]

    def _read_state(self) -> tuple[int, Path] | None:
        """The newest state that was acknowledged; older and unfinished states are removed."""
        numbers = self._numbers(_STATE_PREFIX)
        if not numbers or _OUTCOME in self._log.records:
            self._keep_state(None)
            return None
        path = self.directory / f"{_STATE_PREFIX}{max(numbers)}"
        expected = cast(dict[str, str], self._log.records[path.name])["sha256"]
        if max(numbers) >= len(self.rounds):
            raise JournalError(f"{path}: belongs to a round that {self._log.path} does not have")
        try:
            intact = digest_file(path) == expected
        except OSError as error:
            what = "is missing" if isinstance(error, FileNotFoundError) else error.strerror
            raise JournalError(f"{path}: {what}; remove {self.directory} to compute the run again") from None
        if not intact:
            raise JournalError(f"{path}: is damaged; remove {self.directory} to compute the run again")
        self._keep_state(path)
        return max(numbers), path

    def _numbers(self, prefix: str) -> list[int]:
        return sorted(int(key.removeprefix(prefix)) for key in self._log.records if key.startswith(prefix))

    def _keep_state(self, kept: Path | None) -> None:
        """Remove older states, and unfinished states that a killed process left."""
        for path in self.directory.glob(f"*{_STATE_PREFIX}*"):
            if path != kept:
                path.unlink()


def _to_plain(rows: Rows) -> list[dict[str, object]]:
    """Columns in their order: NaN as null, codes in base64; floats keep every bit in decimal."""
    plain: list[dict[str, object]] = []
    for name, column in rows.items():
        values: object
        if name == "z":
            values = base64.b64encode(np.ascontiguousarray(column, "<f4").tobytes()).decode()
        elif column.dtype.kind == "f":
            values = [None if math.isnan(v) else v for v in column.tolist()]
        else:
            values = column.tolist()
        plain.append({"name": name, "type": column.dtype.str, "shape": list(column.shape), "values": values})
    return plain


def _from_plain(plain: Sequence[Mapping[str, Any]]) -> Rows:
    rows: Rows = {}
    for column in plain:
        values = column["values"]
        if column["name"] == "z":
            array = np.frombuffer(base64.b64decode(values), "<f4")
        else:
            array = np.array([math.nan if v is None else v for v in values], column["type"])
        rows[column["name"]] = array.reshape(column["shape"])
    return rows
