"""A study's folder: its description, and the optimiser's state, replaced whole after each step.

system.json   the system, the method, the seed and the settings; written once
state         the optimiser; complete or as it was before, whenever the process is killed
lock          held while a step is taken, so that several processes take turns
"""

from __future__ import annotations

import fcntl
import json
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from hdsafebo.errors import HdSafeBOError
from hdsafebo.files.atomic import replacing
from hdsafebo.system.description import System, read_json
from hdsafebo.system.errors import StudyError

_FORMAT = 1
_SYSTEM, _STATE, _LOCK = "system.json", "state", "lock"


@dataclass(frozen=True)
class Plan:
    """What a study was begun with.

    Attributes:
        method: name of the optimiser.
        seed: of its random generator.
        settings: of the method.
    """

    method: str
    seed: int
    settings: Mapping[str, Any]


class Folder:
    """The folder of one study.

    Args:
        path: it; made by `create`.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._seen: tuple[int, int, int] | None = None

    @property
    def exists(self) -> bool:
        """Whether a study was begun here."""
        return (self.path / _SYSTEM).exists()

    @property
    def state(self) -> Path:
        """The file with the optimiser's state."""
        return self.path / _STATE

    @property
    def begun(self) -> bool:
        """Whether a state was saved."""
        return self.state.exists()

    def create(self, system: System, plan: Plan) -> None:
        """Write the description, unless another process has just done so.

        Raises:
            StudyError: the path is something else than a study's folder.
            WriteError: it cannot be written.
        """
        if self.path.exists() and not self.path.is_dir():
            raise StudyError(f"{self.path}: is a file; expected the folder of a study, or nothing yet")
        if self.path.is_dir() and not self.exists and any(p.name != _LOCK for p in self.path.iterdir()):
            raise StudyError(
                f"{self.path}: is a folder with other files; expected that of a study, or nothing yet"
            )
        data = {"format": _FORMAT, **asdict(plan), "system": system.to_dict()}
        with replacing(self.path / _SYSTEM) as temporary:
            text = json.dumps(data, indent=1, allow_nan=False, ensure_ascii=False)
            temporary.write_text(text + "\n", encoding="utf-8")

    def read(self) -> tuple[System, Plan]:
        """What the study was begun with.

        Raises:
            StudyError: the description is damaged.
        """
        path = self.path / _SYSTEM
        try:
            data = read_json(path)
            if data.get("format") != _FORMAT:
                raise StudyError(f"{path}: format {data.get('format')!r}; expected {_FORMAT}")
            plan = Plan(str(data["method"]), int(data["seed"]), dict(data["settings"]))
            return System.from_dict(data["system"], source=str(path)), plan
        except StudyError:
            raise
        except (HdSafeBOError, KeyError, TypeError, ValueError) as error:
            reason = f"lacks {error}" if isinstance(error, KeyError) else str(error)
            raise StudyError(f"{path}: damaged description: {reason}") from None

    @contextmanager
    def locked(self) -> Iterator[None]:
        """Take the turn of this process.

        Raises:
            StudyError: the folder is gone, or cannot be written.
        """
        try:
            handle = os.open(self.path / _LOCK, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o666)
        except OSError as error:
            raise StudyError(f"{self.path}: cannot be locked: {error.strerror}") from None
        try:
            fcntl.flock(handle, fcntl.LOCK_EX)
            yield
        finally:
            os.close(handle)

    @property
    def changed(self) -> bool:
        """Whether the state is another than the one that was last read or written here."""
        return self._stamp() != self._seen

    def note(self) -> None:
        """The present state is known here."""
        self._seen = self._stamp()

    def forget(self) -> None:
        """What is known here may differ from the state: read it again."""
        self._seen = (-1, -1, -1)

    def _stamp(self) -> tuple[int, int, int] | None:
        """A state is never changed in place, so another one is another file."""
        try:
            status = self.state.stat()
        except OSError:
            return None
        return status.st_ino, status.st_mtime_ns, status.st_size


def check_same(path: str | Path, stored: Mapping[str, Any], given: Mapping[str, Any]) -> None:
    """Raise StudyError that names the first part in which two descriptions differ."""
    for key in [*stored, *given]:
        if stored.get(key) != given.get(key):
            raise StudyError(
                f"{path}: {key} of the study's system is {_short(stored.get(key))}; "
                f"expected {_short(given.get(key))}"
            )


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 200 else text[:197] + "..."
