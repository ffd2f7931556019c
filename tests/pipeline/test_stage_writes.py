"""Stages on a disk that takes no more: the exit code 1, the path and the reason, no traceback."""

from __future__ import annotations

import json
import resource
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from safetensors.numpy import save_file

from hdsafebo.pipeline.stage import Stage, run_stage

NOISE = np.random.default_rng(0).normal(size=100_000)
WRITERS: dict[str, Callable[[Path], object]] = {
    "a.json": lambda path: path.write_text(json.dumps(NOISE.tolist())),
    "a.npy": lambda path: np.save(path, NOISE),
    "a.npz": lambda path: np.savez_compressed(path, a=NOISE),
    "a.parquet": lambda path: pq.write_table(pa.table({"a": NOISE}), path),
    "a.safetensors": lambda path: save_file({"a": NOISE}, path),
}


@pytest.mark.parametrize("name", WRITERS)
def test_a_stage_that_cannot_write_says_where(
    tmp_path: Path, project_root: Path, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    (tmp_path / "params.yaml").write_text(
        (project_root / "params.yaml").read_text().replace("enabled: true", "enabled: false")
    )

    def main(stage: Stage) -> None:
        before = resource.getrlimit(resource.RLIMIT_FSIZE)
        resource.setrlimit(resource.RLIMIT_FSIZE, (10_000, before[1]))
        try:
            WRITERS[name](stage.path(f"data/{name}"))
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, before)

    with pytest.raises(SystemExit) as end:
        run_stage("test", main, argv=["--root", str(tmp_path)])
    printed = capsys.readouterr().err
    assert end.value.code == 1
    assert str(tmp_path / "data" / name) in printed
    assert "File too large" in printed or "1234 written" in printed  # what np.save says
    assert "Traceback" not in printed


def test_an_interrupted_stage_says_that_it_can_go_on(
    tmp_path: Path, project_root: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "params.yaml").write_bytes((project_root / "params.yaml").read_bytes())

    def main(stage: Stage) -> None:
        raise KeyboardInterrupt

    with pytest.raises(SystemExit) as end:
        run_stage("test", main, argv=["--root", str(tmp_path)])
    printed = capsys.readouterr().err
    assert end.value.code == 130
    assert "stage test was interrupted; finished rounds of its runs are kept: start it again" in printed
    assert "Traceback" not in printed
