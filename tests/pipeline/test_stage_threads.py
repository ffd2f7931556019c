"""The files of a stage do not depend on the number of threads that the environment offers."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import torch
from threadpoolctl import threadpool_info  # type: ignore[import-untyped]

from hdsafebo.errors import ParamsError
from hdsafebo.files.yaml import read_mapping, write_mapping
from hdsafebo.pipeline.stage import Stage, run_stage

VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


def test_a_stage_computes_with_one_thread(tmp_path: Path, project_root: Path) -> None:
    (tmp_path / "params.yaml").write_bytes((project_root / "params.yaml").read_bytes())
    counted: list[int] = []

    def main(stage: Stage) -> None:
        counted.extend(library["num_threads"] for library in threadpool_info())
        counted.append(torch.get_num_threads())
        counted.extend(int(os.environ[variable]) for variable in VARIABLES)

    before = torch.get_num_threads()
    torch.set_num_threads(2)
    try:
        run_stage("test", main, argv=["--root", str(tmp_path)])
        assert torch.get_num_threads() == 2
    finally:
        torch.set_num_threads(before)
    assert set(counted) == {1}


def test_reflexes_of_the_body_are_recorded_alike(tmp_path: Path, project_root: Path) -> None:
    """The excitations that hold its posture are a solution of least squares, which differed by 1e-16."""
    params = read_mapping(project_root / "params.yaml", ParamsError)
    params["tasks"]["body"]["problem"] |= {"body": "myofullbody", "pushes": [1], "horizon": 160}
    params["tracking"]["enabled"] = False
    recorded = []
    for threads in ("1", "3"):
        root = tmp_path / threads
        root.mkdir()
        write_mapping(root / "params.yaml", params, ParamsError)
        environment = (
            os.environ | dict.fromkeys(VARIABLES, threads) | {"PYTHONPATH": str(project_root / "src")}
        )
        script = project_root / "stages" / "record_body.py"
        subprocess.run([sys.executable, script, "--root", root], env=environment, check=True, timeout=300)
        recorded.append(np.load(root / "data/body/observations.npz")["observations"])
    np.testing.assert_array_equal(*recorded)
