"""Run one method on one task, all seeds, to data/runs/<task>-<method>.parquet."""

from __future__ import annotations

import argparse

from hdsafebo.campaign.item import run_item
from hdsafebo.pipeline.stage import Stage, run_stage


def main(stage: Stage) -> None:
    """Run one method on one task; finished rounds of a run that was cut are kept and not computed again."""
    task, method = stage.options.task, stage.options.method
    for result in run_item(task, method, stage.params, stage.root, stage.tracker):
        if result.abstained is not None:
            trials = len(result.rows["trial"])
            stage.notice(
                f"{task} {method}, seed {result.seed}: ended after {trials} trials: {result.abstained}"
            )


def options(parser: argparse.ArgumentParser) -> None:
    """What to run."""
    parser.add_argument("task", help="name of the task, such as synthetic, hand, scs_st or digits_3")
    parser.add_argument("method", help="name of the method, such as hdsafebo or sobol")


if __name__ == "__main__":
    run_stage("optimize", main, options=options)
