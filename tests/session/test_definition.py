"""Names of a session file."""

from __future__ import annotations

from pathlib import Path

import pytest

from hdsafebo.errors import ParamsError
from hdsafebo.files.yaml import write_mapping
from hdsafebo.session.definition import load_definition, parse_definition
from hdsafebo.session.errors import DefinitionError
from tests.session.small import box_definition


@pytest.mark.parametrize("hidden", ["\u200b", "\u202e", "\u00ad", "\ufeff"])
def test_names_with_characters_that_cannot_be_seen_are_refused(tmp_path: Path, hidden: str) -> None:
    """Two inputs could look the same, or one turn the words after it around; begun sessions open."""
    data = box_definition()
    data["inputs"][0]["name"] = f"a{hidden}b"
    parse_definition(data)
    write_mapping(tmp_path / "session.yaml", data, ParamsError)
    with pytest.raises(DefinitionError, match=rf"inputs.0.name.*cannot be seen, U\+{ord(hidden):04X}"):
        load_definition(tmp_path / "session.yaml")
