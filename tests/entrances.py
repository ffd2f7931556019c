"""Every place where a user can hand in a file: a valid one to spoil, and what reads it."""

from __future__ import annotations

import json
import shutil
import struct
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from hdsafebo.errors import HdSafeBOError

MUSCLES = ("one", "two", "three")
HAND = cast(Any, SimpleNamespace(muscles=MUSCLES, variant="forearm", digest="f" * 64))


@dataclass(frozen=True)
class Entrance:
    """A place where a file comes in.

    Attributes:
        name: of the file, as the user would name it.
        write: makes a valid file at the path, and whatever lies beside it.
        read: what reads it in earnest.
        unchecked: the format has no checksum, so that a flipped bit may be another valid value.
    """

    name: str
    write: Callable[[Path], object]
    read: Callable[[Path], object]
    unchecked: bool = True


def _params(path: Path) -> None:
    path.write_bytes((Path(__file__).parents[1] / "params.yaml").read_bytes())


def _check_params(path: Path) -> object:
    from hdsafebo.pipeline.checked_params import load_checked_params

    return load_checked_params(path)


def _profile(path: Path) -> None:
    for name in ("standard.yaml", path.name):
        (path.parent / name).write_bytes((Path(__file__).parents[1] / "profiles" / name).read_bytes())


def _apply_profile(path: Path) -> object:
    from hdsafebo.pipeline.profiles import apply_profile

    return apply_profile(path.parents[1], path.stem)


def _session_file(path: Path, kind: str = "box") -> None:
    from tests.session.small import write_box_files

    write_box_files(path.parent, kind)


def _initial_parquet(path: Path) -> None:
    import csv

    _session_file(path)
    with path.with_suffix(".csv").open() as file:
        head, *rows = csv.reader(file)
    pq.write_table(pa.table({name: [float(row[i]) for row in rows] for i, name in enumerate(head)}), path)


def _new_session(path: Path, *, initial: str = "initial.csv") -> None:
    from hdsafebo.session.create import create_session

    folder = path.parent
    create_session(folder / "s", folder / "session.yaml", who="ann", initial=folder / initial).close()


def _recording(path: Path) -> None:
    path.write_text("# trial: 3\ntime_s,TA,ST\n" + "".join(f"{i / 1000:.3f},{i}.5,-1\n" for i in range(50)))


def _edf(path: Path) -> None:
    import pyedflib

    with pyedflib.EdfWriter(str(path), 1, file_type=pyedflib.FILETYPE_EDFPLUS) as writer:
        limits = {
            "physical_max": 6000.0,
            "physical_min": -6000.0,
            "digital_max": 32767,
            "digital_min": -32768,
        }
        texts = {"label": "TA", "dimension": "uV", "transducer": "", "prefilter": ""}
        writer.setSignalHeader(0, {**texts, **limits, "sample_frequency": 200})
        writer.writeSamples([np.arange(200.0)])


def _read_recording(path: Path) -> object:
    from hdsafebo.session.measuring.recordings import read_recording

    return read_recording(path.read_bytes(), path.name)


def _store(path: Path) -> None:
    """The session that one of the two copies of a log belongs to."""
    directory = path.parent.parent
    _session_file(directory.parent / "session.yaml")
    _new_session(directory)


def _verify_copies(path: Path) -> None:
    from hdsafebo.session.session import Session
    from hdsafebo.session.views.audit import verify_session

    verify_session(Session.open(path.parent.parent, read_only=True))


def _former_store(path: Path) -> None:
    shutil.copyfile(Path(__file__).parent / "session" / "data" / "box" / "session.db", path)


def _open_former(path: Path) -> None:
    from hdsafebo.session.session import Session

    Session.open(path.parent, read_only=True)


def _audit_log(path: Path) -> None:
    from hdsafebo.session.session import Session
    from hdsafebo.session.views.export import export_session

    _store(path.parent / "s" / "original" / "audit.log")
    session = Session.open(path.parent / "s")
    export_session(session, path.parent)
    session.close()


def _verify_log(path: Path) -> object:
    from hdsafebo.session.views.audit import verify_export

    return verify_export(path)


def _problem() -> Any:
    from hdsafebo.problem import FunctionProblem

    return FunctionProblem(lambda x: (x.sum(axis=1), x[:, 0]), bounds=[[0.0] * 3, [1.0] * 3])


def _state(path: Path) -> None:
    from hdsafebo.optimizers.controls.sobol import Sobol

    made = Sobol(_problem(), seed=0)
    trials = made.ask(4)
    made.tell(trials, trials.x.sum(axis=1), trials.x[:, 0])
    made.save(path)


def _load_state(path: Path) -> object:
    from hdsafebo.optimizers.controls.sobol import Sobol

    return Sobol.load(path, _problem()).ask(2)


def _embedding(path: Path) -> None:
    from hdsafebo.embeddings import make_embedding

    rng = np.random.default_rng(0)
    made = make_embedding("pca", latent_dim=2).fit(rng.normal(size=(30, 6)), rng=rng)
    made.save(path.with_suffix(".safetensors"))


def _load_embedding(path: Path) -> object:
    from hdsafebo.embeddings import load_embedding

    return load_embedding(path.with_suffix(".safetensors"), input_dim=6)


def _run_file(path: Path) -> None:
    from tests.report.run_files import trial_table, write_run

    numbers = np.linspace(0, 1, 12)
    table = trial_table(5, numbers, numbers, n_initial=4, batch=2)
    made = write_run(path.parent, "synthetic", "toy", [table], n_initial=4, batch=2)
    made.replace(path)


def _read_run(path: Path) -> object:
    from hdsafebo.runs.read import read_run

    return read_run(path)


def _input(relative: str, content: Any) -> tuple[Callable[[Path], None], Callable[[Path], None]]:
    """A file that the report reads besides run files; its folder is the project's."""
    from hdsafebo.report.data.inputs import read_inputs

    def write(path: Path) -> None:
        if path.suffix == ".json":
            path.write_text(json.dumps(content))
        else:
            pq.write_table(pa.table(content), path)

    def read(path: Path) -> None:
        root = Path(str(path).removesuffix(relative))
        read_inputs(root, root / "data" / "runs")

    return write, read


def _synergies(path: Path) -> None:
    from hdsafebo.hand.synergies import Synergies, save_synergies

    eye = np.eye(3)
    save_synergies(path, Synergies(eye[0], eye, eye[0], MUSCLES, HAND.variant, HAND.digest))


def _load_synergies(path: Path) -> object:
    from hdsafebo.hand.synergies import load_synergies

    return load_synergies(path, HAND)


def _policy(path: Path) -> None:
    from hdsafebo.policies.affine import Normalisation, PolicySpace
    from hdsafebo.policies.policy_file import save_policy

    ends, none = np.ones(2), Normalisation.none(3)
    space = PolicySpace(-ends, ends, 0 * ends, ends, none, (2,), (3,))
    save_policy(path, space.policy(np.arange(8.0)), "Point-v0")


def _load_policy(path: Path) -> object:
    from hdsafebo.policies.policy_file import load_policy

    return load_policy(path)


def _moment(path: Path) -> None:
    from hdsafebo.hand.reference import save_moment

    save_moment(path, np.eye(4), HAND)


def _load_moment(path: Path) -> object:
    from hdsafebo.hand.reference import load_moment

    return load_moment(path, HAND)


def _digits(path: Path) -> None:
    def idx(values: np.ndarray) -> bytes:
        shape = struct.pack(f">{values.ndim}I", *values.shape)
        return bytes((0, 0, 8, values.ndim)) + shape + values.tobytes()

    path.write_bytes(idx(np.zeros((5, 8, 8), np.uint8)))
    path.with_name(path.name.replace("images-idx3", "labels-idx1")).write_bytes(idx(np.zeros(5, np.uint8)))


def _load_digits(path: Path) -> object:
    from hdsafebo.problems.digit_images import load_digit_images

    return load_digit_images("idx", path.parent)


def _predictor(path: Path) -> None:
    from hdsafebo.problems.digit_predictor import DigitPredictor

    DigitPredictor(8).save(path)


def _load_predictor(path: Path) -> object:
    from hdsafebo.problems.digit_predictor import DigitPredictor

    return DigitPredictor.load(path)


def _lead_field(path: Path) -> None:
    from hdsafebo.spinal.lead_field import LeadField

    grid = np.zeros((4, 5))
    triangles = np.zeros((2, 3), int)
    flat = np.zeros(2, int)
    LeadField(
        np.zeros((2, 5)), triangles, flat, np.array(["a"]), np.zeros(4), grid, grid,
        np.zeros((16, 2)), np.zeros(3), np.zeros((4, 5, 16)),
    ).save(path)  # fmt: skip


def _load_lead_field(path: Path) -> object:
    from hdsafebo.spinal.lead_field import LeadField

    return LeadField.load(path)


def _dataset(path: Path) -> None:
    from hdsafebo.spinal.dataset import schema

    pq.write_table(schema().empty_table(), path)


def _read_dataset(path: Path) -> object:
    from hdsafebo.spinal.dataset import read_dataset

    return read_dataset(path)


def _journal(path: Path) -> None:
    from hdsafebo.campaign.journal import Journal

    with Journal(path) as journal:
        for i in range(5):
            journal.append(f"round-{i}", {"objective": [i / 3]})


def _open_journal(path: Path) -> None:
    from hdsafebo.campaign.journal import Journal

    with Journal(path):
        pass


_CHECK = {"distance_correlation": 0.9, "gp_mean_difference": 0.1, "gp_variance_difference": 0.1}
_NUMBERS = np.linspace(0, 1, 50).tolist()

ENTRANCES = {
    "params": Entrance("params.yaml", _params, _check_params),
    "profile": Entrance("profiles/smoke.yaml", _profile, _apply_profile),
    "session file": Entrance("session.yaml", _session_file, _new_session),
    "initial trials": Entrance("initial.csv", _session_file, _new_session),
    "initial parquet": Entrance(
        "initial.parquet", _initial_parquet, lambda path: _new_session(path, initial=path.name)
    ),
    "candidates": Entrance("candidates.csv", lambda path: _session_file(path, "list"), _new_session),
    "recording": Entrance("trial.csv", _recording, _read_recording),
    "EDF recording": Entrance("trial.edf", _edf, _read_recording),
    "log of a session": Entrance("s/original/audit.log", _store, _verify_copies, unchecked=False),
    "second log of a session": Entrance("s/copy/audit.log", _store, _verify_copies),
    "session of the former format": Entrance("s/session.db", _former_store, _open_former),
    "audit log": Entrance("audit.log", _audit_log, _verify_log, unchecked=False),
    "optimiser state": Entrance("state", _state, _load_state),
    "embedding": Entrance("pca.safetensors", _embedding, _load_embedding, unchecked=False),
    "embedding card": Entrance("pca.json", _embedding, _load_embedding),
    "run file": Entrance("synthetic-toy.parquet", _run_file, _read_run),
    "isometry": Entrance("reports/isometry.json", *_input("reports/isometry.json", {"pca": _CHECK})),
    "distances": Entrance(
        "reports/isometry_pairs.parquet",
        *_input("reports/isometry_pairs.parquet", {"original": _NUMBERS, "pca": _NUMBERS}),
    ),
    "synergy shares": Entrance(
        "models/synergies/pca.json",
        *_input("models/synergies/pca.json", {"variance_accounted_for": [0.5, 0.7]}),
    ),
    "learning curve": Entrance(
        "data/rollouts/learning_curve.parquet",
        *_input(
            "data/rollouts/learning_curve.parquet",
            {"setting": ["full"] * 50, "step": list(range(50)), "total_reward": _NUMBERS},
        ),
    ),
    "stimulation of the report": Entrance(
        "data/spinal/selectivity.json",
        *_input("data/spinal/selectivity.json", {"rows": 3, "threshold": 0.05, "safe_share": 0.5}),
    ),
    "traversal": Entrance(
        "data/spinal/traversal.json", *_input("data/spinal/traversal.json", {"seconds": 1.0})
    ),
    "synergies": Entrance("synergies.safetensors", _synergies, _load_synergies),
    "policy": Entrance("policy.safetensors", _policy, _load_policy),
    "observations": Entrance("observations.safetensors", _moment, _load_moment),
    "digits": Entrance("train-images-idx3-ubyte", _digits, _load_digits),
    "digit predictor": Entrance("predictor.safetensors", _predictor, _load_predictor),
    "lead field": Entrance("lead_field.npz", _lead_field, _load_lead_field),
    "stimulation dataset": Entrance("stimulation.parquet", _dataset, _read_dataset),
    "journal": Entrance("rounds.log", _journal, _open_journal, unchecked=False),
}


def refusal(entrance: Entrance, path: Path) -> str | None:
    """The message with which a file is refused; None when it is taken. Any other error passes on."""
    try:
        entrance.read(path)
    except HdSafeBOError as error:
        return str(error)
    return None
