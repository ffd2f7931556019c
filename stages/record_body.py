"""Play random reflexes of the body, and keep what they observe -> data/body/observations.npz."""

from __future__ import annotations

from hdsafebo.pipeline.stage import Stage, run_stage
from hdsafebo.problems.body import RECORDED_FILE, policies_of, save_observations


def main(stage: Stage) -> None:
    """Record once, so that no run has to."""
    policies = policies_of(stage.params.tasks.body.problem)
    save_observations(policies.observations, stage.path(RECORDED_FILE))
    stage.log_metrics({"observations": float(len(policies.observations))})


if __name__ == "__main__":
    run_stage("record_body", main)
