"""The committed evidence: what every number of the report can be computed from, in a few megabytes.

runs/             the trials of every run, one file per task and method, see `compact`
inputs/           what else the report reads, at the paths that it has in the project
params.yaml       the parameters of the runs
provenance.json   revision, libraries and original file of every run file
"""

from __future__ import annotations

import shutil
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from hdsafebo.campaign.run_spec import code_digest
from hdsafebo.errors import DatasetError
from hdsafebo.files.atomic import replacing, write_json
from hdsafebo.files.parquet import column_names, read_parquet
from hdsafebo.params import load_params
from hdsafebo.pipeline.provenance import digest_file, git_state
from hdsafebo.problems.registry import family_of
from hdsafebo.report.data import body_inputs, hand_inputs, inputs
from hdsafebo.report.data.json_files import read_json
from hdsafebo.report.data.planned import planned_runs
from hdsafebo.runs.read import read_run
from hdsafebo.runs.schema import COLUMNS, run_name
from hdsafebo.typing import FloatArray

RUNS = "runs"
INPUTS = "inputs"
PARAMS = "params.yaml"
PROVENANCE = "provenance.json"
FILES = (
    inputs.ISOMETRY,
    inputs.DISTANCES,
    inputs.SYNERGIES,
    inputs.LEARNING,
    inputs.STIMULATION,
    inputs.TRAVERSAL,
    hand_inputs.DIFFICULTY,
    f"{hand_inputs.POLICIES}/policies.json",
    f"{body_inputs.POLICIES}/policies.json",
    f"{body_inputs.POLICIES}/{body_inputs.FILM}",
)
PICTURES = (inputs.HAND_FRAMES, inputs.SPINAL_FRAMES, hand_inputs.POLICIES, body_inputs.POLICIES)
CODE = ("src", "stages")
LIBRARIES = ("numpy", "scipy", "torch", "gpytorch", "botorch", "scikit-learn", "mujoco", "cma")
_EXACT_BITS = 13
"""Of a number's 24 significant bits; four decimal digits."""
_UNUSED = ("candidate",)
_FURTHER_COLUMNS = ("safety_no_drop", "safety_upright", "safety_joint_load")


def keep_evidence(root: Path, folder: Path) -> list[str]:
    """Write the evidence of the runs that the parameters of a project name.

    Runs of days may be kept one after another, on one machine or several: what is not here stays as it was
    kept before.

    Args:
        root: the project's directory, in which the pipeline has run.
        folder: of the evidence; a file there that is up to date keeps its provenance.

    Returns:
        Names of the runs that are neither here nor kept.

    Raises:
        DatasetError: no run file of the profile is there, one is malformed or of other code, or the disk
            cannot be written.
    """
    params = load_params(root / PARAMS)
    names = [run_name(task, method) for task, method in planned_runs(params)]
    made = {name: source for name in names if (source := _made(root, name, params.profile)) is not None}
    missing = [n for n in names if n not in made and not (folder / RUNS / f"{n}.parquet").is_file()]
    if missing == names:
        raise DatasetError(f"{root / 'data/runs'}: no run of {PARAMS}; run the pipeline first (dvc repro)")
    before = read_provenance(folder).get("runs", {})
    here = _here(root)
    digests = {name: digest_file(source) for name, source in made.items()}
    new = [
        name
        for name in made
        if before.get(name, {}).get("source_sha256") != digests[name]
        or not (folder / RUNS / f"{name}.parquet").is_file()
    ]
    _require_this_code([made[name] for name in new])
    runs: dict[str, Any] = {}
    for name in sorted(set(names) - set(missing), key=names.index):
        target = folder / RUNS / f"{name}.parquet"
        known = before.get(name, {})
        if name in new:
            compact(made[name], target)
            known = here | {"source_sha256": digests[name]}
        meta = read_run(target).meta
        runs[name] = known | {"seeds": meta.seeds, "trials": meta.n_trials, "profile": meta.profile}
    for path in sorted((folder / RUNS).glob("*.parquet")):
        if path.stem not in runs:
            path.unlink()
    _copy_inputs(root, folder / INPUTS)
    shutil.copyfile(root / PARAMS, folder / PARAMS)
    write_json(folder / PROVENANCE, here | {"profile": params.profile, "runs": runs}, DatasetError)
    return missing


def _require_this_code(files: list[Path]) -> None:
    """Raise `DatasetError` for run files of other code: the revision of this moment would not be theirs."""
    other = []
    for path in files:
        meta = read_run(path).meta
        if meta.code != code_digest(family_of(meta.task), meta.algorithm):
            other.append(path.name)
    if other:
        raise DatasetError(
            f"{files[0].parent}: {', '.join(other)}: computed by code other than the present one, whose "
            "revision they would be kept under; keep them from a checkout of their own, or run them again"
        )


def _made(root: Path, name: str, profile: str) -> Path | None:
    """The file of a run under the profile; DVC leaves those of another one until their items run again."""
    path = root / "data/runs" / f"{name}.parquet"
    return path if path.is_file() and read_run(path).meta.profile == profile else None


def read_provenance(folder: Path) -> dict[str, Any]:
    """What `provenance.json` says; empty when there is none."""
    path = folder / PROVENANCE
    content = read_json(path)
    if content is None:
        return {}
    if not isinstance(content, dict):
        raise DatasetError(f"{path}: expected an object, got {type(content).__name__}")
    return content


def compact(source: Path, target: Path) -> None:
    """Write a run file without the searched points, its numbers to four significant digits, well compressed.

    What was safe is kept as it was decided; violations are rounded with the values that they are of.
    """
    present = column_names(source, DatasetError)
    extra = [name for name in _FURTHER_COLUMNS if name in present]
    table = read_parquet(source, str(source), DatasetError, [*COLUMNS, *extra])
    columns: dict[str, pa.Array] = {}
    for name in table.column_names:
        column = table[name]
        if name in _UNUSED:
            columns[name] = pa.array(np.full(len(column), -1, np.int64))
        elif pa.types.is_floating(column.type):
            columns[name] = pa.array(rounded(column.to_numpy()), pa.float32())
        else:
            columns[name] = column
    floats = [name for name, column in columns.items() if column.type == pa.float32()]
    others = [name for name in columns if name not in floats]
    target.parent.mkdir(parents=True, exist_ok=True)
    with replacing(target, DatasetError) as temporary:
        pq.write_table(
            pa.table(columns).replace_schema_metadata(table.schema.metadata),
            temporary,
            compression="zstd",
            compression_level=19,
            use_dictionary=others,
            use_byte_stream_split=floats,
        )


def rounded(values: FloatArray) -> np.ndarray:
    """(n,) float32 with the last bits zero; NaN stays."""
    step = np.uint32(1 << (24 - _EXACT_BITS))
    bits = np.asarray(values, np.float32).view(np.uint32)
    near = ((bits + step // 2) & ~(step - np.uint32(1))).view(np.float32)
    return np.where(np.isfinite(values), near, np.asarray(values, np.float32))


def _copy_inputs(root: Path, folder: Path) -> None:
    """Copy what is here; pictures of a folder replace those that were kept of it."""
    for name in PICTURES:
        if (root / name).is_dir():
            shutil.rmtree(folder / name, ignore_errors=True)
    pictures = [path for name in PICTURES for path in sorted((root / name).glob("*.png"))]
    for source in [*(root / name for name in FILES), *pictures]:
        if source.is_file():
            target = folder / source.relative_to(root)
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(source, target)


def _here(root: Path) -> dict[str, Any]:
    """Revision and libraries of this moment, and whether the code differs from the revision.

    Code alone, not the parameters: a profile rewrites them, and they are kept beside the runs.
    """
    states = [state for name in CODE if (state := git_state(root / name)) is not None]
    revision = states[0][0] if states else None
    modified = any(changed for _, changed in states) if states else None
    return {"revision": revision, "modified": modified, "libraries": {n: _version(n) for n in LIBRARIES}}


def _version(library: str) -> str | None:
    try:
        return version(library)
    except PackageNotFoundError:
        return None
