"""The stimulation task: rows, maps, look-up, and what a wrong dataset is answered with."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from hdsafebo.embeddings import make_embedding
from hdsafebo.errors import DatasetError, EmbeddingFileError, UnknownNameError
from hdsafebo.optimizers.registry import make_optimizer
from hdsafebo.params import load_params
from hdsafebo.problem import check_problem
from hdsafebo.problems.stimulation import (
    DATASET_FILE,
    ResponseCodec,
    SelectiveStimulation,
    StimulationSet,
    log_responses,
    make_task,
    read_target,
)
from hdsafebo.spinal.configurations import CONFIGURATIONS
from hdsafebo.spinal.field_map import PIXELS
from hdsafebo.trials import Trials

CURRENTS = np.geomspace(0.05, 5.0, 10)


@pytest.fixture(scope="module")
def rows() -> StimulationSet:
    return StimulationSet(CURRENTS)


@pytest.fixture(scope="module")
def values() -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(0)
    return rng.standard_normal(CONFIGURATIONS * 10), rng.random(CONFIGURATIONS * 10)


@pytest.fixture
def problem(rows: StimulationSet, values: tuple[np.ndarray, np.ndarray]) -> SelectiveStimulation:
    return SelectiveStimulation("st", rows, *values, threshold=0.05, log_safety=True)


def test_a_map_is_nearest_to_its_own_row_until_that_is_taken(rows: StimulationSet) -> None:
    wanted = np.random.default_rng(1).choice(len(rows), 6, replace=False)
    maps = rows.inputs(wanted)
    assert maps.shape == (6, PIXELS)
    np.testing.assert_array_equal(rows.nearest(maps, np.empty(0, int)), wanted)
    others = rows.nearest(maps, wanted)
    assert not set(others) & set(wanted)
    assert len(set(rows.nearest(np.repeat(maps[:1], 4, axis=0), wanted))) == 4


def test_features_are_logarithms_of_responses_at_unit_mean_squared_distance(rows: StimulationSet) -> None:
    features = rows.features
    assert features.shape == (CONFIGURATIONS * 10, 84)
    pairs = np.random.default_rng(3).choice(len(rows), (2, 20_000))
    squared = ((features[pairs[0]] - features[pairs[1]]) ** 2).sum(axis=1)
    assert squared.mean() == pytest.approx(1.0, abs=0.02)
    unit = np.array([[1.0, 4.0], [1.0, 4.0]])
    by_hand = np.log(0.5 * 2.5 + np.array([[0.5, 2.0], [1.0, 4.0]] * 2))
    by_hand -= by_hand.mean(axis=0)
    by_hand /= np.sqrt(2 * by_hand.var(axis=0).sum())
    np.testing.assert_allclose(log_responses(unit, np.array([0.5, 1.0])), by_hand)


def test_the_weakest_rows_have_the_lowest_current(rows: StimulationSet) -> None:
    weakest = rows.weakest()
    assert len(weakest) == CONFIGURATIONS
    few = weakest[::500]
    np.testing.assert_allclose(rows.inputs(few), 1 + CURRENTS[0] / 5 * rows.unit[::500])
    assert (rows.features[few + 1] > rows.features[few]).all()


def test_evaluation_looks_rows_up(
    problem: SelectiveStimulation, values: tuple[np.ndarray, np.ndarray]
) -> None:
    check_problem(problem)
    x, candidate = problem.initial(50, np.random.default_rng(2))
    result = problem.evaluate(Trials.pending(x, x, 1, candidate=candidate))
    np.testing.assert_array_equal(result.objective, values[0][candidate])
    np.testing.assert_array_equal(result.safety[:, 0], values[1][candidate])
    assert problem.optimum == values[0][values[1] >= 0.05].max()
    with pytest.raises(DatasetError, match="without a row"):
        problem.evaluate(Trials.pending(x, x, 1))


def test_the_log_keeps_the_safe_set(
    problem: SelectiveStimulation, values: tuple[np.ndarray, np.ndarray]
) -> None:
    safety = problem.safety[0]
    assert safety.transform is not None
    moved = safety.transform(np.array([safety.threshold]))[0]
    np.testing.assert_array_equal(safety.transform(values[1]) >= moved, values[1] >= safety.threshold)


def test_no_safe_row_is_an_error(rows: StimulationSet, values: tuple[np.ndarray, np.ndarray]) -> None:
    with pytest.raises(DatasetError, match=r"largest 0\.000"):
        SelectiveStimulation("st", rows, values[0], 0 * values[1], threshold=0.05, log_safety=False)


def table(values: tuple[np.ndarray, np.ndarray]) -> dict[str, np.ndarray]:
    return {
        "configuration": np.repeat(np.arange(CONFIGURATIONS, dtype=np.int32), 10),
        "current": np.tile(CURRENTS.astype(np.float32), CONFIGURATIONS),
        "si_ST_left": values[0].astype(np.float32),
        "g": values[1].astype(np.float32),
    }


def test_a_dataset_is_read(tmp_path: Path, values: tuple[np.ndarray, np.ndarray]) -> None:
    path = tmp_path / "s.parquet"
    pq.write_table(pa.table(table(values)), path)
    currents, selectivity, safety = read_target(path, "ST", "left")
    np.testing.assert_allclose(currents, CURRENTS, rtol=1e-6)
    np.testing.assert_array_equal(selectivity, values[0].astype(np.float32))
    np.testing.assert_array_equal(safety, values[1].astype(np.float32))


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (lambda t: {k: v[:-1] for k, v in t.items()}, "217999 rows, expected 218000"),
        (lambda t: {k: np.concatenate([v, v[:10]]) for k, v in t.items()}, "218010 rows"),
        (lambda t: t | {"configuration": t["configuration"][::-1]}, "every configuration at every current"),
        (lambda t: t | {"g": np.where(np.arange(218_000) == 5, np.nan, t["g"])}, "NaN"),
        (lambda t: {k: v for k, v in t.items() if k != "si_ST_left"}, "si_ST_left"),
    ],
)
def test_a_wrong_dataset_is_refused(
    tmp_path: Path, values: tuple[np.ndarray, np.ndarray], damage: object, message: str
) -> None:
    path = tmp_path / "s.parquet"
    pq.write_table(pa.table(damage(table(values))), path)  # type: ignore[operator]
    with pytest.raises(DatasetError, match=message):
        read_target(path, "ST", "left")


@pytest.mark.parametrize("content", [b"", b"PAR1", b"\x80\x04\x95cposix\nsystem\n"])
def test_a_file_that_is_no_table(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "s.parquet"
    path.write_bytes(content)
    with pytest.raises(DatasetError, match="cannot be read"):
        read_target(path, "ST", "left")


def test_a_task_refuses_an_unknown_muscle_and_an_embedding_of_other_maps(
    tmp_path: Path, project_root: Path, values: tuple[np.ndarray, np.ndarray]
) -> None:
    params = load_params(project_root / "params.yaml")
    with pytest.raises(UnknownNameError, match="unknown stimulation target 'soleus'; valid names: bfgm, ga"):
        make_task("scs_soleus", params, seed=0, root=tmp_path)
    (tmp_path / "data/spinal").mkdir(parents=True)
    pq.write_table(pa.table(table(values)), tmp_path / DATASET_FILE)
    other = make_embedding("pca", latent_dim=2)
    other.fit(np.random.default_rng(0).standard_normal((30, 20)), rng=np.random.default_rng(0))
    other.save(tmp_path / "models/embeddings/irvae.safetensors")
    with pytest.raises(EmbeddingFileError, match="input_dim is 20, expected 728"):
        make_task("scs_st", params, seed=0, root=tmp_path)


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory, values: tuple[np.ndarray, np.ndarray]) -> Path:
    """A project with a dataset of random values and an embedding of two principal components."""
    directory = tmp_path_factory.mktemp("root")
    (directory / "data/spinal").mkdir(parents=True)
    pq.write_table(pa.table(table(values)), directory / DATASET_FILE)
    maps = np.random.default_rng(0).uniform(size=(40, PIXELS))
    embedding = make_embedding("pca", latent_dim=2).fit(maps, rng=np.random.default_rng(0))
    embedding.save(directory / "models/embeddings/irvae.safetensors")
    return directory


def test_the_papers_setting_gives_codes_and_the_informed_one_responses(
    root: Path, project_root: Path
) -> None:
    params = load_params(project_root / "params.yaml")
    paper, informed = (make_task(name, params, seed=0, root=root) for name in ("scs_st", "scs_st_informed"))
    assert (paper.problem.name, informed.problem.name) == ("scs_st", "scs_st_informed")
    assert paper.problem.safety[0].transform is None
    assert informed.problem.safety[0].transform is not None
    assert paper.embedding is not None
    assert paper.problem.candidates is not None
    codec, some = paper.embedding(np.empty((0, PIXELS))), np.array([3, 70_000])
    rows = paper.problem.candidates
    few = np.array([5, 70])
    optimizer = make_optimizer("linebo", paper.problem, embedding=codec, bounds=paper.latent_bounds)
    told = paper.problem.selectivity[few], paper.problem.values[few]
    optimizer.observe(rows.inputs(few), *told, candidate=few, initial=True)
    optimizer.ask(1)
    optimizer.save(root / "state")
    assert "features" not in vars(rows), "only methods that choose among rows pay for their features"
    np.testing.assert_allclose(rows.features[some], codec.encode(rows.inputs(some)))
    assert informed.problem.candidates is not None
    assert informed.problem.candidates.features.shape[1] == 84
    assert "84 logarithms" in str(informed.knowledge.candidate_rows)
    assert paper.knowledge.kernel_features is informed.knowledge.kernel_features is None


def test_the_latent_box_is_that_of_the_training_points(root: Path, project_root: Path) -> None:
    params = load_params(project_root / "params.yaml")
    task = make_task("scs_st", params, seed=0, root=root)
    maps = np.random.default_rng(0).uniform(size=(40, PIXELS))
    assert task.embedding is not None
    codes = task.embedding(np.empty((0, PIXELS))).encode(maps)
    np.testing.assert_allclose(task.latent_bounds, [codes.min(axis=0), codes.max(axis=0)], atol=1e-9)


def test_seeds_share_a_task_until_a_file_changes(root: Path, project_root: Path) -> None:
    params = load_params(project_root / "params.yaml")
    task = make_task("scs_st", params, seed=0, root=root)
    assert make_task("scs_st", params, seed=1, root=root) is task
    assert make_task("scs_st_informed", params, seed=1, root=root).problem.name == "scs_st_informed"
    before = make_task("scs_st", params, seed=0, root=root)
    embedding = make_embedding("pca", latent_dim=3)
    embedding.fit(np.random.default_rng(1).uniform(size=(40, PIXELS)), rng=np.random.default_rng(0))
    file = root / "models/embeddings/irvae.safetensors"
    kept = file.read_bytes(), file.with_suffix(".json").read_bytes()
    try:
        embedding.save(file)
        after = make_task("scs_st", params, seed=0, root=root)
        assert (np.shape(before.latent_bounds), np.shape(after.latent_bounds)) == ((2, 2), (2, 3))
    finally:
        file.write_bytes(kept[0])
        file.with_suffix(".json").write_bytes(kept[1])


def test_codes_of_responses_stand_for_rows(rows: StimulationSet) -> None:
    codec = ResponseCodec(rows, 16)
    some = np.random.default_rng(4).choice(len(rows), 5, replace=False)
    maps = rows.inputs(some)
    np.testing.assert_array_equal(codec.encode(maps), codec.codes[some])
    # a configuration and its reverse have the same responses, so another row of the same code may come back
    np.testing.assert_array_equal(codec.encode(codec.decode(codec.codes[some])), codec.codes[some])
    np.testing.assert_array_equal(codec.encode(np.repeat(maps[:1], 2, axis=0))[0], codec.codes[some[0]])
    assert 0.9 < codec.share < 1
    spread = codec.codes.var(axis=0).sum() / rows.features.var(axis=0).sum()
    assert spread == pytest.approx(codec.share)
