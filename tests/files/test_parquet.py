"""Parquet files: whatever byte is wrong, the file is refused with its name or read."""

from __future__ import annotations

from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from hdsafebo.errors import DatasetError
from hdsafebo.files.parquet import read_parquet


@pytest.mark.parametrize("columns", [None, ["objective"]])
@pytest.mark.thorough
def test_no_changed_byte_ends_in_another_error(tmp_path: Path, columns: list[str] | None) -> None:
    path = tmp_path / "run.parquet"
    pq.write_table(pa.table({"objective": [1.0, 2.0], "status": ["completed", "failed"]}), path)
    whole = path.read_bytes()
    refused = 0
    for place in range(len(whole)):
        content = bytearray(whole)
        content[place] ^= 0x80
        path.write_bytes(content)
        try:
            read_parquet(path, str(path), DatasetError, columns)
        except DatasetError as error:
            refused += str(path) in str(error)
    assert refused > len(whole) // 4
