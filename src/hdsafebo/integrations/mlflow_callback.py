"""One's own study as a run of MLflow: call it after each `tell`.

log = MLflowCallback(experiment="arm")
study.tell(suggestion, results)
log(study)
"""

from __future__ import annotations

import math
from typing import Any

from mlflow.entities import Metric, Param
from mlflow.tracking import MlflowClient

from hdsafebo.system.study import Study

_ALWAYS = "failed"
"""A metric that every logged trial has."""
_STUDY = "hdsafebo.study"
_MOST = 500
"""Metrics of one call; MLflow allows 1,000."""


class MLflowCallback:
    """Logs each trial that has its result as one step: outcomes, safety, and the best safe objective so far.

    The same study goes on in the same run, also after a restart; each trial is logged once.

    Args:
        experiment: name of MLflow's experiment; made when it is missing.
        uri: of the tracking server or store; None takes MLflow's own setting.
    """

    def __init__(self, experiment: str, uri: str | None = None) -> None:
        self._client = MlflowClient(tracking_uri=uri)
        found = self._client.get_experiment_by_name(experiment)
        self._experiment = found.experiment_id if found else self._client.create_experiment(experiment)

    def __call__(self, study: Study) -> str:
        """Log what is not logged yet; returns the id of the run."""
        run = self._run(study)
        logged = {metric.step for metric in self._client.get_metric_history(run.info.run_id, _ALWAYS)}
        table = study.to_dataframe()
        sign = study.system.objective.sign
        objective = table[study.system.objective.name]
        best = sign * (sign * objective.where(table["safe"])).cummax().ffill()
        metrics: list[Metric] = []
        done = table[table["status"] != "pending"].reset_index()
        for row in done.to_dict("records"):
            trial = int(row["trial"])
            if trial in logged:
                continue
            values = {name: row[name] for name in study.system.outcomes}
            values |= {
                "safe": float(row["safe"]),
                _ALWAYS: float(row["status"] == "failed"),
                "safe_probability": row["safe_probability"],
                "best_safe": best.loc[trial],
            }
            metrics += [
                Metric(_metric_name(n), float(v), 0, trial) for n, v in values.items() if math.isfinite(v)
            ]
        for first in range(0, len(metrics), _MOST):
            self._client.log_batch(run.info.run_id, metrics=metrics[first : first + _MOST])
        return str(run.info.run_id)

    def _run(self, study: Study) -> Any:
        """The run of this study."""
        identity = study.identity
        found = self._client.search_runs([self._experiment], f"tags.`{_STUDY}` = '{identity}'", max_results=1)
        if found:
            return found[0]
        run = self._client.create_run(
            self._experiment, run_name=study.system.name, tags={_STUDY: identity, "method": study.method}
        )
        params = {"method": study.method, "seed": study.seed, **study.settings}
        self._client.log_batch(run.info.run_id, params=[Param(k, str(v)) for k, v in params.items()])
        return self._client.get_run(run.info.run_id)


def _metric_name(name: str) -> str:
    """A name that MLflow takes: other characters become underscores."""
    return "".join(c if c.isalnum() or c in "_-./ " else "_" for c in name)
