"""Synergies: recovery of known ones, the rule of signs, and files of another hand."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from hdsafebo.errors import DatasetError, HandModelError
from hdsafebo.hand.rollout import Scene
from hdsafebo.hand.scene.model import hand_model
from hdsafebo.hand.synergies import (
    Synergies,
    fit_synergies,
    load_synergies,
    save_synergies,
    synergy_policies,
)

HAND = hand_model("forearm")


def activations(rows: int = 2000, noise: float = 0.0) -> tuple[pd.DataFrame, np.ndarray]:
    """Activations made of three known orthonormal synergies with falling variance, and noise."""
    rng = np.random.default_rng(0)
    basis = np.linalg.qr(rng.standard_normal((43, 3)))[0].T
    drive = rng.uniform(-1, 1, (rows, 3)) * [0.5, 0.3, 0.1]
    values = 0.5 + drive @ basis + noise * rng.standard_normal((rows, 43))
    table = pd.DataFrame(values.astype(np.float32), columns=list(HAND.muscles))
    table.insert(0, "episode", np.int32(0))
    table.insert(1, "step", np.arange(rows, dtype=np.int32))
    return table, basis


@pytest.fixture(scope="module")
def synergies() -> Synergies:
    return fit_synergies(activations(noise=0.01)[0], HAND)


def test_known_synergies_are_found() -> None:
    table, basis = activations()
    found = fit_synergies(table, HAND, components=3)
    np.testing.assert_allclose(np.abs(found.components @ basis.T), np.eye(3), atol=0.05)
    assert found.explained[2] == pytest.approx(1.0, abs=1e-6)
    shares = np.diff(np.concatenate([[0], found.explained]))
    np.testing.assert_allclose(shares, np.array([0.25, 0.09, 0.01]) / 0.35, atol=0.03)


def test_basis_follows_the_stated_rule(synergies: Synergies) -> None:
    np.testing.assert_allclose(synergies.components @ synergies.components.T, np.eye(10), atol=1e-9)
    assert (np.diff(synergies.explained) >= 0).all()
    assert (np.diff(synergies.explained, n=2) <= 1e-12).all()  # by falling variance
    largest = np.abs(synergies.components).argmax(axis=1)
    assert (synergies.components[np.arange(10), largest] > 0).all()


def test_signs_do_not_depend_on_the_data_order(synergies: Synergies) -> None:
    table = activations(noise=0.01)[0].iloc[::-1]
    again = fit_synergies(table, HAND)
    np.testing.assert_allclose(again.components[:3], synergies.components[:3], atol=1e-6)


def test_file_round_trip(synergies: Synergies, tmp_path: Path) -> None:
    path = tmp_path / "pca.safetensors"
    save_synergies(path, synergies)
    loaded = load_synergies(path, HAND)
    for name in ("mean", "components", "explained"):
        np.testing.assert_array_equal(getattr(loaded, name), getattr(synergies, name))
    card = json.loads((tmp_path / "pca.json").read_text())
    assert card["muscles"] == list(HAND.muscles)
    assert card["hand"] == HAND.digest
    np.testing.assert_allclose(card["variance_accounted_for"], synergies.explained, atol=1e-6)
    assert loaded.first(5).shape == (5, 43)
    with pytest.raises(HandModelError, match="11 synergies asked for; the file has 10"):
        loaded.first(11)


def test_zero_policy_keeps_the_start_pose(synergies: Synergies) -> None:
    scene = Scene("forearm")
    space = synergy_policies(scene, synergies, 5)
    assert space.dimension == 5 * 55
    zero = space.excitation(np.zeros((5, 55)), np.ones(55))
    np.testing.assert_array_equal(zero, scene.simulation().pose.activation)


def test_synergies_of_another_hand_are_refused(synergies: Synergies, tmp_path: Path) -> None:
    path = tmp_path / "pca.safetensors"
    save_synergies(path, synergies)
    with pytest.raises(HandModelError, match=r"another hand: 'forearm', 43 muscles.*expected 'extended', 55"):
        load_synergies(path, hand_model("extended"))
    with pytest.raises(HandModelError, match="another hand"):
        load_synergies(path, hand_model("forearm", 1.0))


def test_damaged_files_are_refused(synergies: Synergies, tmp_path: Path) -> None:
    path = tmp_path / "pca.safetensors"
    with pytest.raises(HandModelError, match="cannot be read as synergies"):
        load_synergies(path, HAND)
    path.write_bytes(b"\x80\x04")
    with pytest.raises(HandModelError, match="cannot be read as synergies"):
        load_synergies(path, HAND)
    save_synergies(path, replace(synergies, mean=synergies.mean[:-1]))
    with pytest.raises(HandModelError, match="do not fit 43 muscles"):
        load_synergies(path, HAND)
    save_synergies(path, replace(synergies, mean=np.full(43, np.nan)))
    with pytest.raises(HandModelError, match="not finite"):
        load_synergies(path, HAND)


def test_bad_tables_are_refused() -> None:
    table = activations(100)[0]
    with pytest.raises(DatasetError, match=r"unknown columns \['XYZ'\], missing \['FPL'\]"):
        fit_synergies(table.rename(columns={"FPL": "XYZ"}), HAND)
    with pytest.raises(DatasetError, match="30 rows of activations"):
        fit_synergies(table.iloc[:30], HAND)
    for value in (np.nan, -0.1, 1.1):
        broken = table.copy()
        broken.loc[3, "FPL"] = value
        with pytest.raises(DatasetError, match=r"not in \[0, 1\]"):
            fit_synergies(broken, HAND)
