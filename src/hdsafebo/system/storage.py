"""A study's folder: its description, and the optimiser's state, replaced whole after each step.

system.json   the system, the method, the seed and the settings; written once
state         the optimiser; complete or as it was before, whenever the process is killed; it names the system
lock          held while a step is taken, so that several processes take turns
"""

from __future__ import annotations

import errno
import fcntl
import filecmp
import json
import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from hashlib import sha256
from numbers import Integral
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from pydantic import BaseModel, ValidationError

from hdsafebo.errors import HdSafeBOError, ParamsError
from hdsafebo.files.atomic import WriteError, write_json
from hdsafebo.files.durable import make_durable_directory
from hdsafebo.system.description import System, read_json
from hdsafebo.system.errors import StudyError

_FORMAT = 2
_WITHOUT_DIGEST = 1  # written before descriptions had a digest, and studies a state from the beginning
_UNWRITABLE = (errno.EROFS, errno.EACCES, errno.EPERM)
_SYSTEM, _STATE, _LOCK = "system.json", "state", "lock"


@dataclass(frozen=True)
class Plan:
    """What a study was begun with.

    Attributes:
        method: name of the optimiser.
        seed: of its random generator.
        settings: of the method.

    Raises:
        ParamsError: the seed is no whole number, or negative.
    """

    method: str
    seed: int
    settings: Mapping[str, Any]

    def __post_init__(self) -> None:
        if isinstance(self.seed, bool) or not isinstance(self.seed, Integral) or self.seed < 0:
            raise ParamsError(f"seed is {self.seed!r}; expected a whole number, at least 0")
        object.__setattr__(self, "seed", int(self.seed))


class Folder:
    """The folder of one study.

    Args:
        path: it; made by `create`.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._seen: tuple[int, int, int] | None = None
        self._has_state = False  # a study without its state has lost all that it was told

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

    def create(self, system: System, plan: Plan, save: Callable[[Path], None]) -> None:
        """Write state and description, unless another process has just done so.

        Args:
            system: of the study.
            plan: what it is begun with.
            save: writes the state of an optimiser that knows nothing yet.

        Raises:
            StudyError: the path is something else than a study's folder, or that of a study that lost its
                description.
            WriteError: it cannot be written.
        """
        if self.path.exists() and not self.path.is_dir():
            raise StudyError(f"{self.path}: is a file; expected the folder of a study, or nothing yet")
        left = {_LOCK, _STATE, *(p.name for p in self._unfinished())}
        if self.path.is_dir() and not self.exists and {p.name for p in self.path.iterdir()} - left:
            raise StudyError(
                f"{self.path}: is a folder with other files; expected that of a study, or nothing yet"
            )
        data = {"format": _FORMAT, **asdict(plan), "system": system.to_dict()}
        data["digest"] = _digest(data)
        try:
            make_durable_directory(self.path)
        except OSError as error:
            raise WriteError(f"{self.path}: cannot be made: {error.strerror or error}") from None
        with self.locked():
            if not self.exists:
                self._require_nothing_told(save)
                save(self.state)
                write_json(self.path / _SYSTEM, data)  # last: it makes the folder a study

    def clean(self) -> None:
        """Remove what processes left that were killed while they wrote; needs the lock."""
        for path in self._unfinished():
            with suppress(OSError):
                path.unlink()

    def _unfinished(self) -> list[Path]:
        """Files under the names that `files.atomic` gives until they are complete."""
        names = _STATE, Path(_SYSTEM).stem
        return [path for name in names for path in self.path.glob(f".{name}.[0-9]*-????????*")]

    def _require_nothing_told(self, save: Callable[[Path], None]) -> None:
        """Raise StudyError when a state without a description is other than that of a beginning cut short."""
        if not self.begun:
            return
        with TemporaryDirectory() as folder:
            beginning = Path(folder) / _STATE
            save(beginning)
            if filecmp.cmp(beginning, self.state, shallow=False):
                return
        raise StudyError(
            f"{self.path / _SYSTEM}: is missing, and the state beside it is of another study or of one that "
            f"was told something; restore the description from a copy, or remove {self.state} to begin anew"
        )

    def read(self) -> tuple[System, Plan]:
        """What the study was begun with.

        Raises:
            StudyError: the description is damaged.
        """
        path = self.path / _SYSTEM
        try:
            data = read_json(path)
            if data.get("format") not in (_FORMAT, _WITHOUT_DIGEST):
                raise StudyError(f"{path}: format {data.get('format')!r}; expected {_FORMAT}")
            self._has_state = data["format"] == _FORMAT
            digest = data.pop("digest", None)
            if digest != (_digest(data) if self._has_state else None):
                raise StudyError(f"{path}: damaged description: it is not the one that was written")
            plan = Plan(str(data["method"]), data["seed"], dict(data["settings"]))
            return System.from_dict(data["system"], source=str(path)), plan
        except StudyError:
            raise
        except (HdSafeBOError, KeyError, TypeError, ValueError) as error:
            reason = f"lacks {error}" if isinstance(error, KeyError) else str(error)
            raise StudyError(f"{path}: damaged description: {reason}") from None

    @contextmanager
    def locked(self, *, looking: bool = False) -> Iterator[None]:
        """Take the turn of this process.

        Args:
            looking: nothing will be written, so that the folder may be one that cannot be (an archive).

        Raises:
            StudyError: the folder is gone, or cannot be written.
        """
        try:
            handle = os.open(self.path / _LOCK, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o666)
        except OSError as error:
            if looking and error.errno in _UNWRITABLE:
                with self._looked_at():
                    yield
                return
            raise StudyError(f"{self.path}: cannot be locked: {error.strerror}") from None
        try:
            fcntl.flock(handle, fcntl.LOCK_EX)
            yield
        finally:
            os.close(handle)

    @contextmanager
    def _looked_at(self) -> Iterator[None]:
        """Share the turn with others that look, as far as there is a lock to share.

        States are replaced whole, so that one is whole without a lock, too.
        """
        try:
            handle = os.open(self.path / _LOCK, os.O_RDONLY | os.O_CLOEXEC)
        except OSError:
            yield
            return
        try:
            fcntl.flock(handle, fcntl.LOCK_SH)
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
        self._has_state |= self._seen is not None

    def require_state(self) -> None:
        """Raise StudyError when the state is gone that the study had."""
        if self._has_state and not self.begun:
            raise StudyError(f"{self.state}: is missing, and with it all that the study was told")

    def check_settings(self, plan: Plan, begun: BaseModel, loaded: BaseModel) -> None:
        """Raise StudyError unless a loaded state has the settings that the study was begun with."""
        if begun != loaded:
            raise StudyError(
                f"{self.state}: is of a study by {plan.method} with other settings: "
                f"{loaded!r}; expected {begun!r}"
            )

    def check_given(self, begun: BaseModel, given: Mapping[str, Any]) -> None:
        """Raise StudyError when settings are given that would change those that the study was begun with.

        One that is given as it is, though nobody set it when the study was begun, changes nothing.
        """
        for key, value in given.items():
            if value is None:
                continue
            try:
                with_it = type(begun)(**(begun.model_dump(exclude_unset=True) | {key: value}))
                same = with_it.model_dump() == begun.model_dump()
            except ValidationError:
                same = False
            if not same:
                known = getattr(begun, key, None)
                raise StudyError(f"{self.path}: {key} of the study is {known!r}; expected {value!r}")

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


def _digest(data: Mapping[str, Any]) -> str:
    """SHA-256 of plain data."""
    return sha256(json.dumps(data, sort_keys=True, allow_nan=False).encode()).hexdigest()


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
