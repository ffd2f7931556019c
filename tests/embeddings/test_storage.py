"""Files: they come back to the bit, and damaged or hostile ones are refused by name."""

import hashlib
import json
from pathlib import Path

import numpy as np
import pytest
from safetensors.numpy import load_file, save_file

from hdsafebo.embeddings import Embedding, load_embedding, make_embedding
from hdsafebo.embeddings.identity import Identity
from hdsafebo.embeddings.linear import PCA
from hdsafebo.errors import EmbeddingFileError

X = np.random.default_rng(0).standard_normal((30, 6))


@pytest.fixture
def saved(tmp_path: Path) -> Path:
    path = tmp_path / "pca.safetensors"
    make_embedding("pca", latent_dim=2).fit(X, rng=np.random.default_rng(0)).save(path)
    return path


def edit_card(path: Path, **changes: object) -> None:
    card = path.with_suffix(".json")
    card.write_text(json.dumps({**json.loads(card.read_text()), **changes}))


def edit_tensors(path: Path, **changes: np.ndarray | None) -> None:
    """Change tensors and keep the card's checksum right, as someone hostile would."""
    tensors = {key: value for key, value in {**load_file(path), **changes}.items() if value is not None}
    save_file(tensors, path)
    edit_card(path, sha256=hashlib.sha256(path.read_bytes()).hexdigest())


@pytest.mark.parametrize("name", ["identity", "pca", "random"])
def test_loaded_equals_saved(name: str, tmp_path: Path) -> None:
    settings = {} if name == "identity" else {"latent_dim": 3}
    embedding = make_embedding(name, **settings).fit(X, rng=np.random.default_rng(0))
    path = tmp_path / "deep" / f"{name}.safetensors"
    embedding.save(path)
    loaded = load_embedding(path, input_dim=6, latent_dim=embedding.latent_dim)
    assert type(loaded) is type(embedding)
    assert loaded.settings == embedding.settings
    np.testing.assert_array_equal(loaded.encode(X), embedding.encode(X))
    np.testing.assert_array_equal(loaded.decode(loaded.encode(X)), embedding.decode(embedding.encode(X)))
    first = [path.read_bytes(), path.with_suffix(".json").read_bytes()]
    loaded.save(path)
    assert [path.read_bytes(), path.with_suffix(".json").read_bytes()] == first


def test_a_class_loads_its_own_kind_only(saved: Path) -> None:
    assert isinstance(PCA.load(saved), Embedding)
    with pytest.raises(EmbeddingFileError, match=r"pca.json: kind is 'pca', expected 'identity'"):
        Identity.load(saved)


def test_another_shape_than_its_use_needs(saved: Path) -> None:
    with pytest.raises(EmbeddingFileError, match="input_dim is 6, expected 728"):
        load_embedding(saved, input_dim=728)
    with pytest.raises(EmbeddingFileError, match="latent_dim is 2, expected 16"):
        load_embedding(saved, latent_dim=16)


@pytest.mark.parametrize("suffix", [".safetensors", ".json"])
def test_missing_file(saved: Path, suffix: str) -> None:
    saved.with_suffix(suffix).unlink()
    with pytest.raises(EmbeddingFileError, match=f"{suffix}: No such file"):
        load_embedding(saved)


def test_other_suffix(tmp_path: Path) -> None:
    with pytest.raises(EmbeddingFileError, match=r"ends in .safetensors"):
        load_embedding(tmp_path / "model.pt")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"format": "pickle"}, "format"),
        ({"version": 2}, "version"),
        ({"kind": "os.system"}, "unknown embedding 'os.system'; valid names"),
        ({"kind": "identity"}, "unknown setting 'latent_dim'"),
        ({"input_dim": -1}, "input_dim"),
        ({"input_dim": 10**12}, "expected at most 1073741824"),
        ({"input_dim": 7}, r"tensor 'mean' is float64 \(6,\), expected float64 \(7,\)"),
        ({"latent_dim": 3}, "latent_dim is 3, the settings give 2"),
        ({"latent_dim": 3, "settings": {"latent_dim": 3}}, r"tensor 'encoder' is float64 \(2, 6\)"),
        ({"settings": {"latent_dim": "2"}}, "setting 'latent_dim'"),
        ({"settings": {"latent_dim": 2, "hook": "rm"}}, "unknown setting 'hook'"),
        ({"sha256": "0" * 64}, "SHA-256"),
        ({"surprise": 1}, "surprise"),
    ],
)
def test_hostile_card(saved: Path, changes: dict[str, object], message: str) -> None:
    edit_card(saved, **changes)
    with pytest.raises(EmbeddingFileError, match=message):
        load_embedding(saved)


@pytest.mark.parametrize("text", ["", "[]", "{", "[" * 100_000, "\ud800"])
def test_card_that_is_no_card(saved: Path, text: str) -> None:
    saved.with_suffix(".json").write_bytes(text.encode("utf-8", "surrogatepass"))
    with pytest.raises(EmbeddingFileError, match=r"pca.json"):
        load_embedding(saved)


def test_oversized_files_are_not_read(saved: Path) -> None:
    with saved.open("r+b") as file:
        file.truncate(2**33)  # sparse: it takes no room, reading it would
    with pytest.raises(EmbeddingFileError, match="8589934592 bytes, expected at most"):
        load_embedding(saved)


def test_cut_off_or_changed_tensors(saved: Path) -> None:
    data = saved.read_bytes()
    saved.write_bytes(data[:-8])
    with pytest.raises(EmbeddingFileError, match="SHA-256"):
        load_embedding(saved)
    edit_card(saved, sha256=hashlib.sha256(data[:-8]).hexdigest())
    with pytest.raises(EmbeddingFileError, match="no safetensors file"):
        load_embedding(saved)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"mean": None}, "expected .*'mean'"),
        ({"extra": np.zeros(2)}, "'extra'"),
        ({"mean": np.zeros(5)}, r"'mean' is float64 \(5,\)"),
        ({"mean": np.zeros(6, np.float32)}, r"'mean' is float32"),
        ({"mean": np.full(6, np.nan)}, "'mean' holds NaN"),
    ],
)
def test_hostile_tensors(saved: Path, changes: dict[str, np.ndarray | None], message: str) -> None:
    edit_tensors(saved, **changes)
    with pytest.raises(EmbeddingFileError, match=message):
        load_embedding(saved)
