"""The process that talks to MLflow for a stage: orders on its standard input, one answer to each.

A server may answer without end, in small pieces for ever, or with little that becomes much; MLflow and what
it stands on bound none of that, for no scheme of addresses alike. A process has bounds that the kernel keeps:
one of memory, and one of time for each order, also when the stage is gone meanwhile.

An order is a line of JSON, {"number": 2, "limit_s": 30.0, "name": "finish", "given": {"status": "FINISHED"}},
and so is its answer, {"number": 2, "error": null}. The first line is {"uri": ..., "most_bytes": ...}: the
address of the store, and what memory there is; its answer says that MLflow is loaded.
"""

from __future__ import annotations

import json
import os
import resource
import signal
import sys
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import TYPE_CHECKING, Any

from hdsafebo.pipeline.processes import is_alive

if TYPE_CHECKING:
    from mlflow.tracking import MlflowClient

_LONGEST_ANSWER = 2000  # characters of an error, which may quote all that a server has sent
_METRICS_PER_BATCH = 1000  # limits of MLflow's log-batch call
_PARAMS_PER_BATCH = 100
_PARAM_LENGTH = 6000


class MlflowWriter:
    """Writes one run, and its child runs, to a store; every method is an order.

    Args:
        client: of MLflow.
    """

    def __init__(self, client: MlflowClient) -> None:
        self._client = client
        self._experiment = ""
        self._run = ""

    def begin(
        self,
        experiment: str,
        artifacts: str | None,
        run_name: str,
        tags: Mapping[str, str],
        params: Mapping[str, str],
    ) -> None:
        """Begin the run.

        Args:
            experiment: name of the experiment; a missing experiment is made.
            artifacts: address of the files of a new experiment in the local store, of which earlier runs of
                processes that were killed are closed; None on a server, which decides itself.
            run_name: name of the run.
            tags: of the run; `stage` and `process` tell which earlier runs were of the same item.
            params: parameters by their dotted names.
        """
        self._experiment = self._find_experiment(experiment, artifacts)
        if artifacts is not None:
            self._close_cut_runs(run_name, tags["stage"])
        run = self._client.create_run(self._experiment, tags=dict(tags), run_name=run_name)
        self._run = run.info.run_id
        self.log_params(params)

    def log_params(self, params: Mapping[str, str]) -> None:
        """Add parameters to the run, by their dotted names."""
        self._write_params(self._run, params)

    def log_series(self, steps: Sequence[int], series: Mapping[str, Sequence[float]]) -> None:
        """Add curves to the run, (k,) finite values or None at (k,) steps."""
        self._write_series(self._run, steps, series)

    def log_artifact(self, path: str) -> None:
        """Copy a file or a directory to the run's artefacts."""
        if os.path.isdir(path):
            self._client.log_artifacts(self._run, path, artifact_path=os.path.basename(path))
        else:
            self._client.log_artifact(self._run, path)

    def log_child(
        self,
        name: str,
        tags: Mapping[str, str],
        params: Mapping[str, str],
        steps: Sequence[int],
        series: Mapping[str, Sequence[float]],
    ) -> None:
        """Write a finished child run: `log_params` and `log_series` of its own."""
        all_tags = dict(tags) | {"mlflow.parentRunId": self._run}
        child = self._client.create_run(self._experiment, tags=all_tags, run_name=name).info.run_id
        self._write_params(child, params)
        self._write_series(child, steps, series)
        self._client.set_terminated(child, "FINISHED")

    def finish(self, status: str) -> None:
        """Close the run as 'FINISHED' or 'FAILED'."""
        self._client.set_terminated(self._run, status)

    def _find_experiment(self, name: str, artifacts: str | None) -> str:
        """Identifier of an experiment."""
        from mlflow.exceptions import MlflowException

        if (found := self._client.get_experiment_by_name(name)) is not None:
            return str(found.experiment_id)
        try:
            return str(self._client.create_experiment(name, artifact_location=artifacts))
        except MlflowException:  # on a server another stage may have made the experiment meanwhile
            if (found := self._client.get_experiment_by_name(name)) is None:
                raise
            return str(found.experiment_id)

    def _close_cut_runs(self, run_name: str, stage: str) -> None:
        """Earlier runs of this item whose process is gone were killed."""
        for run in self._client.search_runs([self._experiment], "attributes.status = 'RUNNING'"):
            tags = run.data.tags
            same = run.info.run_name == run_name and tags.get("stage") == stage
            if same and not is_alive(tags.get("process", "")):
                self._client.set_terminated(run.info.run_id, "KILLED")

    def _write_params(self, run: str, params: Mapping[str, str]) -> None:
        from mlflow.entities import Param

        entries = [Param(name, value[:_PARAM_LENGTH]) for name, value in params.items()]
        for start in range(0, len(entries), _PARAMS_PER_BATCH):
            self._client.log_batch(run, params=entries[start : start + _PARAMS_PER_BATCH])

    def _write_series(self, run: str, steps: Sequence[int], series: Mapping[str, Sequence[float]]) -> None:
        from mlflow.entities import Metric

        now = int(time.time() * 1000)
        entries = [
            Metric(name, value, now, step)
            for name, values in series.items()
            for step, value in zip(steps, values, strict=True)
            if value is not None
        ]
        for start in range(0, len(entries), _METRICS_PER_BATCH):
            self._client.log_batch(run, metrics=entries[start : start + _METRICS_PER_BATCH])


def main() -> None:
    """Obey the orders on the standard input until it ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # an interrupted stage has its run closed yet
    signal.signal(signal.SIGALRM, signal.SIG_DFL)  # ends the process, whatever it was started by
    answers = os.dup(1)
    os.dup2(2, 1)  # what libraries print is no answer
    start: dict[str, Any] = json.loads(sys.stdin.readline())
    writer: MlflowWriter | None = None
    try:
        from mlflow.tracking import MlflowClient

        with suppress(ValueError, OSError):  # not every system has such a limit
            resource.setrlimit(resource.RLIMIT_DATA, (start["most_bytes"], start["most_bytes"]))
    except Exception as error:
        _answer(answers, 0, error)
        return
    _answer(answers, 0, None)
    for line in sys.stdin:
        order: dict[str, Any] = json.loads(line)
        # Nobody handles the signal, so it ends the process wherever it is, also within a library's own code.
        signal.setitimer(signal.ITIMER_REAL, order["limit_s"])
        failure: Exception | None = None
        try:
            # The client of a new local store makes its tables, which belongs to the time of the first order.
            writer = writer or MlflowWriter(MlflowClient(tracking_uri=start["uri"]))
            getattr(writer, order["name"])(**order["given"])
        except Exception as error:
            failure = error
        signal.setitimer(signal.ITIMER_REAL, 0)
        _answer(answers, order["number"], failure)


def _answer(file: int, number: int, error: BaseException | None) -> None:
    """Write one line."""
    text = None if error is None else _reason(error)[:_LONGEST_ANSWER]
    os.write(file, json.dumps({"number": number, "error": text}).encode() + b"\n")


def _reason(error: BaseException) -> str:
    """What went wrong; where memory was short, MLflow reports an exception without words."""
    cause: BaseException | None = error
    while cause is not None:
        if isinstance(cause, MemoryError):
            limit = resource.getrlimit(resource.RLIMIT_DATA)[0]
            return f"what it answers takes more than {limit >> 20} MiB of memory"
        cause = cause.__cause__ or cause.__context__
    return f"{type(error).__name__}: {error}"


if __name__ == "__main__":
    main()
