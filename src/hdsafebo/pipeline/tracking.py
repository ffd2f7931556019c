"""The MLflow mirror of a stage: a run per stage item, a child run per seed; files stay the truth.

No fault of the mirror may stop the pipeline, or take its time or memory: the first call that fails turns
tracking off for the rest of the stage with one notice. MLflow runs in a process of its own, with bounds, that
is started at the first write only (which takes one to three seconds).
"""

from __future__ import annotations

import logging
import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from hdsafebo.errors import HdSafeBOError, ParamsError
from hdsafebo.files.yaml import read_mapping
from hdsafebo.pipeline.mirror_process import MirrorProcess
from hdsafebo.pipeline.processes import this_process
from hdsafebo.pipeline.provenance import digest_json, digest_paths, git_state, stage_dependencies
from hdsafebo.pipeline.store import MlflowStore, home_of

PIPELINE_EXPERIMENT = "pipeline"
_LOG = logging.getLogger(__name__)


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
        self._process: MirrorProcess | None = None

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
        self._guard(lambda: self._order("log_params", params=_texts(params)))

    def log_metrics(self, metrics: Mapping[str, float], step: int | None = None) -> None:
        """Add one value of each of some metrics; values that are not finite are left out."""
        self.log_series([step or 0], {name: [value] for name, value in metrics.items()})

    def log_series(self, steps: Sequence[int], series: Mapping[str, Sequence[float]]) -> None:
        """Add whole curves, (k,) values at (k,) steps; values that are not finite are left out."""
        self._guard(lambda: self._order("log_series", **_curves(steps, series)))

    def log_artifact(self, path: Path) -> None:
        """Copy a file or a directory to the run's artefacts."""
        self._guard(lambda: self._order("log_artifact", path=str(path.absolute())))

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
        self._guard(
            lambda: self._order(
                "log_child", name=name, tags=self._tags(), params=_texts(params), **_curves(steps, series)
            )
        )

    def finish(self, status: str) -> None:
        """Close the run as 'FINISHED' or 'FAILED'; a stage that logged nothing gets its run here."""
        try:
            self._guard(lambda: self._order("finish", status=status))
        finally:
            self._end_process()

    def abandon(self) -> None:
        """Close a run that was begun as 'FAILED'; parameters that are refused at once leave no run."""
        if self._process is not None:
            self.finish("FAILED")

    def _guard(self, write: Callable[[], None]) -> None:
        """Do `write`; an error of any kind ends the tracking of this stage, and leaves the stage alone."""
        if not self.enabled:
            return
        try:
            if self._process is None:
                self._begin()
            write()
        except Exception as error:  # of the store, of files that tags are made of, of what was given
            self.enabled = False
            self._end_process()
            reason = str(error) if isinstance(error, HdSafeBOError) else repr(error)
            _LOG.warning(
                "NOTICE [%s]: tracking is off for the rest of this stage, its files are not affected: %s",
                self.stage,
                _for_print(f"{self._store.uri}: {reason}"),
            )

    def _begin(self) -> None:
        """Begin the run; loading MLflow does not count as time that the store takes."""
        self._store.call(lambda _: None)  # what is no store is found out before that
        self._process = MirrorProcess(self._store.uri)
        # A server decides itself where artefacts go; the local store keeps them in the project.
        place = (self._home / "mlartifacts" / self._experiment_name).as_uri() if self._store.local else None
        self._order(
            "begin",
            experiment=self._experiment_name,
            artifacts=place,
            run_name=self._run_name,
            tags=self._tags(),
            params=_texts(self._params),
        )

    def _order(self, what: str, **given: object) -> None:
        process = self._process
        assert process is not None
        self._store.call(lambda limit_s: process.order(what, limit_s, given))

    def _end_process(self) -> None:
        if self._process is not None:
            self._process.close()
            self._process = None

    def _tags(self) -> dict[str, str]:
        """Tags by which runs are found again; identifiers of runs never enter a file of the pipeline."""
        state = git_state(self.root)
        dvc_file = self.root / "dvc.yaml"
        parsed = read_mapping(dvc_file, ParamsError) if dvc_file.exists() else {}
        dependencies = [self.root / p for p in stage_dependencies(parsed, self.stage, self._item)]
        return self._item | {
            "stage": self.stage,
            "process": this_process(),
            "git_revision": state[0] if state else "none",
            "git_dirty": str(state[1]).lower() if state else "unknown",
            "params_hash": digest_json(self._params),
            "deps_hash": digest_paths(dependencies, self.root),
        }


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


def _texts(params: Mapping[str, object]) -> dict[str, str]:
    """Parameters as MLflow keeps them."""
    return {name: str(value) for name, value in flatten(params).items()}


def _curves(steps: Sequence[int], series: Mapping[str, Sequence[float]]) -> dict[str, object]:
    """Curves in plain numbers; None in the place of a value that is not finite."""
    values = {n: [float(v) if math.isfinite(v) else None for v in vs] for n, vs in series.items()}
    return {"steps": [int(step) for step in steps], "series": values}


def _for_print(text: str) -> str:
    """What a server may have sent, in one line without a password and without orders to a terminal."""
    line = re.sub(r"//[^/@\s]*@", "//", " ".join(text.split()))
    return "".join(c if c.isprintable() else "?" for c in line)[:300]


def flatten(params: Mapping[str, Any], prefix: str = "") -> dict[str, object]:
    """Nested mappings as one mapping with dotted names."""
    flat: dict[str, object] = {}
    for key, value in params.items():
        if isinstance(value, Mapping):
            flat |= flatten(value, f"{prefix}{key}.")
        else:
            flat[f"{prefix}{key}"] = value
    return flat
