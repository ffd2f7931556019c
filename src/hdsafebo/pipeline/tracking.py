"""The MLflow mirror of a stage: a run per stage item, a child run per seed; files stay the truth.

No fault of the mirror may stop the pipeline: the first call that fails turns tracking off for the rest of the
stage with one notice. MLflow is imported at the first write only (the import takes one to three seconds).
"""

from __future__ import annotations

import logging
import math
import os
import platform
import re
import time
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hdsafebo.errors import ParamsError
from hdsafebo.files.yaml import read_mapping
from hdsafebo.pipeline.provenance import digest_json, digest_paths, git_state, stage_dependencies
from hdsafebo.pipeline.store import MlflowStore, home_of

if TYPE_CHECKING:
    from mlflow.tracking import MlflowClient

PIPELINE_EXPERIMENT = "pipeline"
_METRICS_PER_BATCH = 1000  # limits of MLflow's log-batch call
_PARAMS_PER_BATCH = 100
_PARAM_LENGTH = 6000
_LOG = logging.getLogger(__name__)
# An unreachable server must cost seconds, not the minutes of MLflow's default retries.
_QUIET_AND_QUICK = {
    "MLFLOW_HTTP_REQUEST_MAX_RETRIES": "1",
    "MLFLOW_HTTP_REQUEST_TIMEOUT": "5",
    "MLFLOW_HTTP_REQUEST_BACKOFF_FACTOR": "0",
    "MLFLOW_LOGGING_LEVEL": "WARNING",
    "MLFLOW_DISABLE_TELEMETRY": "true",
}


class Tracker:
    """Writes one stage item to MLflow; created by `track_stage`.

    Args:
        stage: name of the stage.
        params: the parameters that the stage uses; nested mappings become dotted names.
        root: the project's directory, or a copy that DVC made of it; see `store.home_of`.
        enabled: False makes every method do nothing.
    """

    def __init__(self, stage: str, params: Mapping[str, object], root: Path, *, enabled: bool = True) -> None:
        self.stage = stage
        self.root = root
        self._home = home_of(root)
        self._store = MlflowStore(self._home)
        self.enabled = enabled
        self._params = dict(params)
        self._experiment_name = PIPELINE_EXPERIMENT
        self._run_name = stage
        self._item: dict[str, str] = {}
        self._client: MlflowClient | None = None
        self._experiment = ""
        self._run = ""

    def place(
        self,
        experiment: str,
        run_name: str,
        *,
        stage: str,
        item: Mapping[str, str],
        params: Mapping[str, object],
    ) -> None:
        """Say where the run of a matrix item belongs, before anything is logged.

        Args:
            experiment: name of the experiment, the task for runs of a task.
            run_name: name of the run.
            stage: name of the stage in `dvc.yaml`.
            item: the values of the matrix; they become tags.
            params: the parameters that the item uses.
        """
        self._experiment_name, self._run_name = experiment, run_name
        self.stage, self._item, self._params = stage, dict(item), dict(params)

    def log_params(self, params: Mapping[str, object]) -> None:
        """Add parameters to the run; nested mappings become dotted names."""
        self._guard(lambda client: self._write_params(client, self._run, params))

    def log_metrics(self, metrics: Mapping[str, float], step: int | None = None) -> None:
        """Add one value of each of some metrics; values that are not finite are left out."""
        series = {name: [float(value)] for name, value in metrics.items()}
        self._guard(lambda client: self._write_series(client, self._run, [step or 0], series))

    def log_series(self, steps: Sequence[int], series: Mapping[str, Sequence[float]]) -> None:
        """Add whole curves, (k,) values at (k,) steps; values that are not finite are left out."""
        self._guard(lambda client: self._write_series(client, self._run, steps, series))

    def log_artifact(self, path: Path) -> None:
        """Copy a file or a directory to the run's artefacts."""

        def write(client: MlflowClient) -> None:
            if path.is_dir():
                client.log_artifacts(self._run, str(path), artifact_path=path.name)
            else:
                client.log_artifact(self._run, str(path))

        self._guard(write)

    def log_child(
        self,
        name: str,
        params: Mapping[str, object],
        steps: Sequence[int],
        series: Mapping[str, Sequence[float]],
    ) -> None:
        """Write a finished child run, for example one seed.

        Args:
            name: name of the child run.
            params: its parameters.
            steps: (k,) horizontal axis of the metrics, for example numbers of trials.
            series: metrics, (k,) values each; values that are not finite are left out.
        """

        def write(client: MlflowClient) -> None:
            tags = self._tags() | {"mlflow.parentRunId": self._run}
            child = client.create_run(self._experiment, tags=tags, run_name=name).info.run_id
            self._write_params(client, child, params)
            self._write_series(client, child, steps, series)
            client.set_terminated(child, "FINISHED")

        self._guard(write)

    def finish(self, status: str) -> None:
        """Close the run as 'FINISHED' or 'FAILED'; a stage that logged nothing gets its run here."""
        self._guard(lambda client: client.set_terminated(self._run, status))

    def abandon(self) -> None:
        """Close a run that was begun as 'FAILED'; parameters that are refused at once leave no run."""
        if self._client is not None:
            self.finish("FAILED")

    def _guard(self, write: Callable[[MlflowClient], None]) -> None:
        """Do `write`; an error of any kind ends the tracking of this stage, and leaves the stage alone."""
        if not self.enabled:
            return
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # deprecations between the mirror's libraries
                client = self._client or self._begin()
                self._store.call(lambda: write(client))
        except Exception as error:  # the mirror's libraries raise anything from OSError to SQLAlchemy's own
            self.enabled = False
            reason = " ".join(f"{self._store.uri}: {type(error).__name__}: {error}".split())
            without_password = re.sub(r"//[^/@\s]*@", "//", reason)[:300]
            _LOG.warning(
                "NOTICE [%s]: tracking is off for the rest of this stage, its files are not affected: %s",
                self.stage,
                without_password,
            )

    def _begin(self) -> MlflowClient:
        """Begin the run; the import of MLflow does not count as time that the store takes."""
        for key, value in _QUIET_AND_QUICK.items():
            os.environ.setdefault(key, value)
        from mlflow.tracking import MlflowClient

        def begin() -> MlflowClient:
            client = MlflowClient(tracking_uri=self._store.uri)  # makes the tables of a new store
            self._experiment = self._find_experiment(client)
            if self._store.local:
                self._close_cut_runs(client)
            run = client.create_run(self._experiment, tags=self._tags(), run_name=self._run_name)
            self._run = run.info.run_id
            self._write_params(client, self._run, self._params)
            return client

        self._client = self._store.call(begin)
        return self._client

    def _find_experiment(self, client: MlflowClient) -> str:
        """Identifier of the experiment; a missing experiment is made."""
        from mlflow.exceptions import MlflowException

        name = self._experiment_name
        if (found := client.get_experiment_by_name(name)) is not None:
            return str(found.experiment_id)
        # A server decides itself where artefacts go; the local store keeps them in the project.
        place = (self._home / "mlartifacts" / name).as_uri() if self._store.local else None
        try:
            return str(client.create_experiment(name, artifact_location=place))
        except MlflowException:  # on a server another stage may have made the experiment meanwhile
            if (found := client.get_experiment_by_name(name)) is None:
                raise
            return str(found.experiment_id)

    def _close_cut_runs(self, client: MlflowClient) -> None:
        """Earlier runs of this item whose process is gone were killed."""
        for run in client.search_runs([self._experiment], "attributes.status = 'RUNNING'"):
            tags = run.data.tags
            same = run.info.run_name == self._run_name and tags.get("stage") == self.stage
            if same and not _is_alive(tags.get("process", "")):
                client.set_terminated(run.info.run_id, "KILLED")

    def _tags(self) -> dict[str, str]:
        """Tags by which runs are found again; identifiers of runs never enter a file of the pipeline."""
        state = git_state(self.root)
        dvc_file = self.root / "dvc.yaml"
        parsed = read_mapping(dvc_file, ParamsError) if dvc_file.exists() else {}
        dependencies = [self.root / p for p in stage_dependencies(parsed, self.stage, self._item)]
        return self._item | {
            "stage": self.stage,
            "process": _this_process(),
            "git_revision": state[0] if state else "none",
            "git_dirty": str(state[1]).lower() if state else "unknown",
            "params_hash": digest_json(self._params),
            "deps_hash": digest_paths(dependencies, self.root),
        }

    @staticmethod
    def _write_params(client: MlflowClient, run: str, params: Mapping[str, object]) -> None:
        from mlflow.entities import Param

        entries = [Param(name, str(value)[:_PARAM_LENGTH]) for name, value in flatten(params).items()]
        for start in range(0, len(entries), _PARAMS_PER_BATCH):
            client.log_batch(run, params=entries[start : start + _PARAMS_PER_BATCH])

    @staticmethod
    def _write_series(
        client: MlflowClient, run: str, steps: Sequence[int], series: Mapping[str, Sequence[float]]
    ) -> None:
        from mlflow.entities import Metric

        now = int(time.time() * 1000)
        entries = [
            Metric(name, float(value), now, int(step))
            for name, values in series.items()
            for step, value in zip(steps, values, strict=True)
            if math.isfinite(value)
        ]
        for start in range(0, len(entries), _METRICS_PER_BATCH):
            client.log_batch(run, metrics=entries[start : start + _METRICS_PER_BATCH])


@contextmanager
def track_stage(
    name: str, params: Mapping[str, object], root: Path, *, enabled: bool = True
) -> Iterator[Tracker]:
    """Track a stage while the block runs.

    Args:
        name: name of the stage in `dvc.yaml`.
        params: the parameters that the stage uses, plain data.
        root: the project's directory.
        enabled: False tracks nothing and imports nothing.

    Yields:
        The tracker; its run ends as FAILED when the block raises (refused parameters leave no run), and the
        exception passes on.
    """
    tracker = Tracker(name, params, root, enabled=enabled)
    try:
        yield tracker
    except ParamsError:
        tracker.abandon()
        raise
    except BaseException:
        tracker.finish("FAILED")
        raise
    tracker.finish("FINISHED")


def _this_process() -> str:
    """Host, number and start of this process; numbers of processes are used again."""
    import psutil

    return f"{platform.node()} {os.getpid()} {psutil.Process().create_time():.2f}"


def _is_alive(process: str) -> bool:
    """Whether a process still runs, as far as can be known from this host."""
    import psutil

    try:
        host, number, start = process.split(" ")
        if host != platform.node():
            return True
        return abs(psutil.Process(int(number)).create_time() - float(start)) < 1.0
    except (ValueError, psutil.Error):
        return False


def flatten(params: Mapping[str, Any], prefix: str = "") -> dict[str, object]:
    """Nested mappings as one mapping with dotted names."""
    flat: dict[str, object] = {}
    for key, value in params.items():
        if isinstance(value, Mapping):
            flat |= flatten(value, f"{prefix}{key}.")
        else:
            flat[f"{prefix}{key}"] = value
    return flat
