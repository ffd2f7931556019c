"""A stage's end of the process that talks to MLflow for it; see `mlflow_writer`."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Mapping

from hdsafebo.errors import HdSafeBOError

# An unreachable server must cost seconds, not the minutes of MLflow's default retries.
_QUIET_AND_QUICK = {
    "MLFLOW_HTTP_REQUEST_MAX_RETRIES": "1",
    "MLFLOW_HTTP_REQUEST_TIMEOUT": "5",
    "MLFLOW_HTTP_REQUEST_BACKOFF_FACTOR": "0",
    "MLFLOW_LOGGING_LEVEL": "WARNING",
    "MLFLOW_DISABLE_TELEMETRY": "true",
}
_MOST_BYTES = 2**30  # that the process may write to; MLflow itself takes a quarter of them
# Libraries that compute keep memory for each of their threads, and nothing is computed there.
_ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}


class MirrorError(HdSafeBOError):
    """The process could not do what it was told; the message is that of MLflow, of bounded length."""


class MirrorProcess:
    """Starts the process, which loads MLflow; that takes one to three seconds.

    Args:
        uri: address of the store, as MLflow takes it.

    Raises:
        MirrorError: MLflow cannot be loaded.
        OSError: no process can be started.
    """

    def __init__(self, uri: str) -> None:
        # The current directory is not where to look for modules, and a warning there is nobody's error.
        command = [sys.executable, "-P", "-W", "ignore", "-m", "hdsafebo.pipeline.mlflow_writer"]
        self._process = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env=_QUIET_AND_QUICK | os.environ | _ONE_THREAD,
        )
        self._number = 0
        try:
            self._send({"uri": uri, "most_bytes": _MOST_BYTES})
            self._receive(0.0)
        except BaseException:
            self.close()
            raise

    def order(self, name: str, limit_s: float, given: Mapping[str, object]) -> None:
        """Have a method of `MlflowWriter` called.

        Args:
            name: of the method.
            limit_s: the process is ended when that takes longer.
            given: its arguments, as JSON has them.

        Raises:
            MirrorError: the store takes too long or more memory than there is for it, or what MLflow raised.
        """
        self._number += 1
        self._send({"number": self._number, "limit_s": limit_s, "name": name, "given": given})
        self._receive(limit_s)

    def close(self) -> None:
        """End the process; all that it has answered is written."""
        self._process.kill()
        self._process.wait()
        for pipe in (self._process.stdin, self._process.stdout):
            try:
                if pipe is not None:
                    pipe.close()
            except OSError:  # what could not be sent any more
                pass

    def _send(self, content: object) -> None:
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(json.dumps(content).encode() + b"\n")
            self._process.stdin.flush()
        except OSError:
            raise self._ended(0.0) from None

    def _receive(self, limit_s: float) -> None:
        """Wait for the answer to the last order; one to an order that was interrupted may come before it."""
        assert self._process.stdout is not None
        while line := self._process.stdout.readline():
            answer = json.loads(line)
            if answer["number"] == self._number:
                if answer["error"] is not None:
                    raise MirrorError(answer["error"])
                return
        raise self._ended(limit_s)

    def _ended(self, limit_s: float) -> MirrorError:
        code = self._process.wait()
        if code == -signal.SIGALRM:
            return MirrorError(f"it has not answered within {limit_s:.0f} s")
        return MirrorError(f"the process that talks to MLflow has ended (exit code {code})")
