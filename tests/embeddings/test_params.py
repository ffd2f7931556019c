"""The blocks of the parameters: bad settings are refused when they are read."""

from pathlib import Path

import pytest
from pydantic import ValidationError

from hdsafebo.errors import ParamsError
from hdsafebo.files.yaml import read_mapping
from hdsafebo.params import Embeddings, IsometryParams
from hdsafebo.pipeline.checked_params import parse_checked_params


def test_defaults_are_valid() -> None:
    assert "residual" in Embeddings().models
    assert IsometryParams().points == 10_000


@pytest.mark.parametrize(
    ("models", "message"),
    [
        ({"umap": {}}, "unknown embedding 'umap'; valid names"),
        ({"pca": {"latent": 3}}, "unknown setting 'latent'; valid settings: latent_dim"),
        ({"irvae": {"epochs": 0}}, "setting 'epochs': .*got 0"),
        ({"irvae": {"learning_rate": float("nan")}}, "learning_rate"),
    ],
)
def test_bad_models(project_root: Path, models: dict[str, dict[str, object]], message: str) -> None:
    data = read_mapping(project_root / "params.yaml", ParamsError)
    data["embeddings"]["models"] = models
    with pytest.raises(ParamsError, match=message):
        parse_checked_params(data)


@pytest.mark.parametrize("floors", [{"pca": {"distance_corelation": 0.9}}, {"pca": {"round_trip": 1.1}}])
def test_bad_floors(floors: dict[str, dict[str, float]]) -> None:
    with pytest.raises(ValidationError):
        IsometryParams(floors=floors)
