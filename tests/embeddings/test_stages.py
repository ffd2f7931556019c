"""The two stages end to end, with the embeddings that need no training and one quick one."""

import importlib.util
import json
from argparse import Namespace
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numpy as np
import pyarrow.parquet as pq
import pytest

from hdsafebo.embeddings import load_embedding
from hdsafebo.errors import EmbeddingFileError, IsometryError, ParamsError
from hdsafebo.params import Embeddings, IsometryFloors, IsometryParams, Spinal
from hdsafebo.pipeline.stage import Stage

MODELS = {
    "pca": {"latent_dim": 16},
    "random": {"latent_dim": 16},
    "residual": {"epochs": 2, "homogeneous": True, "origin": 1.0},
}
SIZES = {"points": 300, "pairs": 2000, "figure_pairs": 500, "gp_points": 60, "gp_draws": 2}
CHECK = IsometryParams(**SIZES, jacobian_points=3, round_trip_rows=60)


class Silent:
    """A tracker that keeps what it is told."""

    def __init__(self) -> None:
        self.metrics: dict[str, float] = {}

    def log_metrics(self, metrics: dict[str, float], step: int | None = None) -> None:
        self.metrics.update(metrics)


@pytest.fixture(scope="module")
def scripts(project_root: Path) -> dict[str, ModuleType]:
    loaded = {}
    for name in ("train_embeddings", "check_isometry"):
        spec = importlib.util.spec_from_file_location(name, project_root / "stages" / f"{name}.py")
        assert spec is not None
        assert spec.loader is not None
        loaded[name] = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(loaded[name])
    return loaded


def stage(root: Path, isometry: IsometryParams = CHECK) -> Stage:
    params = SimpleNamespace(embeddings=Embeddings(models=MODELS), isometry=isometry, spinal=Spinal())
    return Stage("test", params, root, Namespace(), Silent())  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def trained(scripts: dict[str, ModuleType], tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("project")
    running = stage(root)
    scripts["train_embeddings"].main(running)
    assert set(running.tracker.metrics) == {f"{name}_cpu_seconds" for name in MODELS}  # type: ignore[attr-defined]
    return root


def test_training_writes_every_embedding_and_a_tenth_held_out(trained: Path) -> None:
    for name in MODELS:
        embedding = load_embedding(
            trained / f"models/embeddings/{name}.safetensors", input_dim=728, latent_dim=16
        )
        assert embedding.name == name
    held_out = np.load(trained / "models/embeddings/held_out.npy", allow_pickle=False)
    assert held_out.shape == (2180,)
    assert len(np.unique(held_out)) == 2180


def test_check_writes_the_measures_and_the_pairs(trained: Path, scripts: dict[str, ModuleType]) -> None:
    scripts["check_isometry"].main(stage(trained))
    measured = json.loads((trained / "reports/isometry.json").read_text())
    assert set(measured) == set(MODELS)
    assert measured["pca"]["distance_correlation"] > 0.999
    assert measured["residual"]["distance_correlation"] > 0.999
    assert measured["random"]["distance_correlation"] < 0.99
    assert measured["pca"]["condition_number"] == pytest.approx(1.0, abs=1e-6)
    pairs = pq.read_table(trained / "reports/isometry_pairs.parquet")
    assert pairs.column_names == ["original", *MODELS]
    assert pairs.num_rows == 500
    columns = [pairs[name].to_numpy() for name in ("original", "pca")]
    assert np.corrcoef(columns)[0, 1] > 0.999


def test_below_a_floor_the_stage_fails_after_it_wrote_the_report(
    trained: Path, scripts: dict[str, ModuleType]
) -> None:
    report = trained / "reports/isometry.json"
    report.unlink(missing_ok=True)
    strict = CHECK.model_copy(update={"floors": {"random": IsometryFloors(distance_correlation=0.999)}})
    with pytest.raises(IsometryError, match=r"distance_correlation is 0\.9\d+, its floor 0.999"):
        scripts["check_isometry"].main(stage(trained, strict))
    assert "random" in json.loads(report.read_text())


def test_floor_of_an_embedding_that_is_not_trained(trained: Path, scripts: dict[str, ModuleType]) -> None:
    unknown = CHECK.model_copy(update={"floors": {"irvae": IsometryFloors(round_trip=0.5)}})
    with pytest.raises(ParamsError, match=r"isometry.floors.irvae: no such embedding"):
        scripts["check_isometry"].main(stage(trained, unknown))


def test_missing_files_are_named(tmp_path: Path, scripts: dict[str, ModuleType]) -> None:
    with pytest.raises(EmbeddingFileError, match=r"held_out.npy: no list of held-out configurations"):
        scripts["check_isometry"].main(stage(tmp_path))
    np.save(stage(tmp_path).path("models/embeddings/held_out.npy"), np.array([-1, 3]))
    with pytest.raises(EmbeddingFileError, match="expected numbers of configurations, 0 to 21799"):
        scripts["check_isometry"].main(stage(tmp_path))
