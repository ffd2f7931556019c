"""Sessions to test with."""

from __future__ import annotations

from collections.abc import Callable
from itertools import permutations
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hdsafebo.errors import ParamsError
from hdsafebo.files.yaml import read_mapping, write_mapping
from hdsafebo.session.create import create_session
from hdsafebo.session.definition import StimulationDefinition, parse_definition
from hdsafebo.session.patient.month import initial_table
from hdsafebo.session.patient.patient import SimulatedPatient
from hdsafebo.session.patient.responses import MUSCLES, Responses
from hdsafebo.session.session import Session
from tests.session.small import CURRENTS_MA, FakeClock, small_definition, write_box_files


@pytest.fixture
def make_session(tmp_path: Path) -> Callable[..., Session]:
    """Makes a generic session."""

    def make(kind: str = "box", name: str = "s", **changes: Any) -> Session:
        definition, initial = write_box_files(tmp_path / f"{name}-files", kind)
        data = read_mapping(definition, ParamsError) | changes
        write_mapping(definition, data, ParamsError)
        return create_session(tmp_path / name, definition, who="ann", initial=initial, clock=FakeClock())

    return make


@pytest.fixture(scope="session")
def responses() -> Responses:
    """A patient's response to all bipolar configurations: each muscle prefers a place on the paddle."""
    place = np.concatenate([np.arange(8.0), np.arange(8.0) - 0.5])
    centre = np.linspace(0.5, 6.5, len(MUSCLES))
    index, mu = {}, []
    for cathode, anode in permutations(range(16), 2):
        row = [0] * 16
        row[cathode], row[anode] = -1, 1
        index[tuple(row)] = len(mu)
        near = np.exp(-0.5 * ((place[cathode] - centre) / 1.2) ** 2)
        mu.append([1 - np.exp(-current * (0.3 + 3.0 * near)) for current in CURRENTS_MA])
    table = np.array(mu)
    return Responses(index, np.array(CURRENTS_MA), table, table.max(axis=2) ** 0.2)


@pytest.fixture(scope="session")
def initial_trials(responses: Responses) -> str:
    """Initial trials of the simulated patient."""
    definition = parse_definition(small_definition())
    assert isinstance(definition, StimulationDefinition)
    return initial_table(SimulatedPatient(responses, definition.emg, 1), definition, 1)


@pytest.fixture
def clinic_files(tmp_path: Path, initial_trials: str) -> tuple[Path, Path]:
    """Session file and initial trials of the simulated patient with bipolar configurations."""
    folder = tmp_path / "files"
    folder.mkdir()
    definition, initial = folder / "session.yaml", folder / "initial.csv"
    write_mapping(definition, small_definition(), ParamsError)
    initial.write_text(initial_trials)
    return definition, initial
