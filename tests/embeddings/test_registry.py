"""Names and settings: an error says what is valid."""

import subprocess
import sys

import pytest

from hdsafebo.embeddings import embedding_names, make_embedding
from hdsafebo.errors import ParamsError, UnknownNameError


def test_every_name_makes_an_embedding_of_that_name() -> None:
    for name in embedding_names():
        assert make_embedding(name).name == name


def test_unknown_name_lists_the_valid_ones() -> None:
    with pytest.raises(
        UnknownNameError, match="'umap'; valid names: identity, irvae, pca, random, residual, vae"
    ):
        make_embedding("umap")


def test_unknown_setting_lists_the_valid_ones() -> None:
    with pytest.raises(ParamsError, match="unknown setting 'dim'; valid settings: latent_dim"):
        make_embedding("pca", dim=3)


@pytest.mark.parametrize("value", [0, -1, 2.5, "3", None, True])
def test_setting_out_of_range_names_key_and_value(value: object) -> None:
    with pytest.raises(ParamsError, match=f"setting 'latent_dim': .*got {value!r}"):
        make_embedding("pca", latent_dim=value)


def test_heavy_libraries_stay_out_of_the_import() -> None:
    code = (
        "import sys; from hdsafebo.embeddings import *; [make_embedding(name) for name in embedding_names()];"
        "print(sorted({'torch', 'sklearn'} & set(sys.modules)))"
    )
    shown = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert shown.strip() == "[]"
