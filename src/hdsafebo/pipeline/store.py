"""Where runs are mirrored to: the SQLite file of the project, or a server; and how long that may take."""

from __future__ import annotations

import fcntl
import os
import sqlite3
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import TypeVar

from hdsafebo.errors import HdSafeBOError
from hdsafebo.files.bounded import require_regular

_CALL_S = 30.0  # one call of a server: an upload of some megabytes passes
_PATIENCE_S = 60.0  # all calls of a stage together ...
_SHARE = 0.05  # ... and this share of the time that the stage has run
_LOCK_S = 120.0  # a call of the local store; making the tables of a new one takes some seconds
_POLL_S = 0.05
T = TypeVar("T")


class StoreError(HdSafeBOError):
    """The store of the mirror cannot be used; the message says what to do."""


def home_of(root: Path) -> Path:
    """The directory of the project, which outlives the stage.

    `dvc exp run --temp` and `--queue` run stages in a copy of the project below `.dvc/tmp` that is removed
    afterwards; DVC then names the project itself in the variable DVC_ROOT.
    """
    named = os.environ.get("DVC_ROOT")
    if named and root.resolve().is_relative_to((Path(named) / ".dvc" / "tmp").resolve()):
        return Path(named).resolve()
    return root


def default_uri(home: Path) -> str:
    """The local store of a project."""
    return f"sqlite:///{home / 'mlruns.db'}"


def tracking_uri(home: Path) -> str:
    """MLFLOW_TRACKING_URI if it is set, else the local store."""
    return os.environ.get("MLFLOW_TRACKING_URI") or default_uri(home)


class MlflowStore:
    """Calls of the store, none of which may hold the stage for long.

    Attributes:
        uri: address, as MLflow takes it.
        local: whether it is the SQLite file of the project.

    Args:
        home: directory of the project.
    """

    def __init__(self, home: Path) -> None:
        self._home = home
        self.uri = tracking_uri(home)
        self.local = self.uri == default_uri(home)
        self._start = time.monotonic()
        self._spent = 0.0

    def call(self, work: Callable[[float], T]) -> T:
        """What `work` returns, which is told how many seconds it may take.

        Stages write the local store one after the other: SQLite refuses to be written twice at a time, and
        MLflow makes the tables of a new store even while another process makes them.

        Raises:
            StoreError: a server has taken too long, or the local store is no database or has a path that
                cannot be an address.
            Exception: what `work` raises.
        """
        if not self.local:
            return self._patiently(work)
        for sign in "?%":
            if sign in str(self._home):
                raise StoreError(
                    f"the path of the project holds a '{sign}', which means something else in the address of "
                    "a store; move the project, or set MLFLOW_TRACKING_URI"
                )
        with self._alone():
            _require_database(self._home / "mlruns.db")
            return work(_LOCK_S)

    def _patiently(self, work: Callable[[float], T]) -> T:
        """Do `work` in what is left of the time that the stage has for its server."""
        start = time.monotonic()
        left = _PATIENCE_S + _SHARE * (start - self._start) - self._spent
        if left <= 0:
            raise StoreError(f"the server has taken {self._spent:.0f} s of the stage, which is enough")
        try:
            return work(min(_CALL_S, left))
        finally:
            self._spent += time.monotonic() - start

    @contextmanager
    def _alone(self) -> Iterator[None]:
        path = self._home / ".journal" / "mlflow.lock"
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("a") as file:
            deadline = time.monotonic() + _LOCK_S
            while True:
                try:
                    fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                    break
                except BlockingIOError:
                    if time.monotonic() > deadline:
                        raise StoreError(f"{path}: held by another stage for {_LOCK_S:.0f} s") from None
                    time.sleep(_POLL_S)
            yield


def _require_database(path: Path) -> None:
    """StoreError for something else in the place of the local store, which MLflow would try for minutes."""
    if not path.exists():
        return
    try:
        require_regular(path)
        with closing(sqlite3.connect(path)) as connection:
            connection.execute("PRAGMA schema_version")
    except (OSError, sqlite3.Error) as error:
        if getattr(error, "sqlite_errorcode", None) == sqlite3.SQLITE_BUSY:
            raise StoreError(f"{path}: another program has locked it") from None
        raise StoreError(
            f"{path}: no store of MLflow: {error}; move it away, and the next stage begins a new store"
        ) from None


def experiments(home: Path) -> dict[str, str]:
    """Identifiers of the experiments in the local store by their names; none without a store.

    Raises:
        StoreError: the file is no store of MLflow.
    """
    path = home / "mlruns.db"
    if not path.exists():
        return {}
    query = "SELECT name, experiment_id FROM experiments WHERE lifecycle_stage = 'active' ORDER BY name"
    try:
        require_regular(path)
        with closing(sqlite3.connect(path)) as connection:
            kind = "SELECT type FROM sqlite_master WHERE name = 'experiments'"
            if connection.execute(kind).fetchone() != (
                "table",
            ):  # a view would be a program of whoever made it
                raise sqlite3.DatabaseError("it has no table of experiments")
            return {name: str(number) for name, number in connection.execute(query)}
    except (OSError, sqlite3.Error) as error:
        raise StoreError(f"{path}: no store of MLflow: {error}") from None
