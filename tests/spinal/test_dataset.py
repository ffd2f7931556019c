"""The dataset's file: typed columns with units, all rows, and clear refusals."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from hdsafebo.errors import DatasetError
from hdsafebo.spinal.dataset import ROWS, check_dataset, read_dataset, schema, to_table, write_dataset
from hdsafebo.spinal.traversal import Traversal


@pytest.fixture(scope="module")
def table(traversal: Traversal) -> pa.Table:
    return to_table(traversal)


def with_column(table: pa.Table, name: str, values: np.ndarray) -> pa.Table:
    return table.set_column(table.schema.names.index(name), table.schema.field(name), pa.array(values))


def test_the_dataset_has_218000_typed_rows(table: pa.Table, traversal: Traversal) -> None:
    check_dataset(table, "test")
    assert table.num_rows == ROWS == 218_000
    assert len(table.schema.names) == 2 + 16 + 12 + 12 + 1
    assert table.schema.field("current").metadata[b"unit"] == b"mA"
    assert float(table.schema.metadata[b"activation_threshold"]) == traversal.threshold
    row = 12_345
    assert table["configuration"][row].as_py() == row // 10
    assert table["current"][row].as_py() == traversal.currents[row % 10]
    assert table["mu_ST_left"][row].as_py() == traversal.mu[row // 10, row % 10, 4, 0]
    assert table["si_GA_right"][row].as_py() == traversal.si[row // 10, row % 10, 5, 1]
    assert table["g"][row].as_py() == traversal.g[row // 10, row % 10]


def test_files_round_trip_and_are_small_and_reproducible(table: pa.Table, tmp_path: Path) -> None:
    first, second = tmp_path / "a.parquet", tmp_path / "b.parquet"
    write_dataset(table, first)
    write_dataset(table, second)
    assert read_dataset(first).equals(table)
    assert first.read_bytes() == second.read_bytes()
    assert first.stat().st_size < 30e6


def test_missing_and_extra_rows_are_refused(table: pa.Table, tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match=r"217999 rows, expected 218000 \(1 missing\)"):
        write_dataset(table.slice(1), tmp_path / "x.parquet")
    with pytest.raises(DatasetError, match=r"218003 rows, expected 218000 \(3 extra\)"):
        check_dataset(pa.concat_tables([table, table.slice(0, 3)]), "x")
    short = tmp_path / "short.parquet"
    pq.write_table(table.slice(0, 100), short)
    with pytest.raises(DatasetError, match="100 rows, expected 218000"):
        read_dataset(short)


def test_wrong_columns_are_refused(table: pa.Table) -> None:
    with pytest.raises(DatasetError, match=r"columns missing \['g'\], extra \[\]"):
        check_dataset(table.drop_columns(["g"]), "x")
    with pytest.raises(DatasetError, match=r"columns missing \[\], extra \['h'\]"):
        check_dataset(table.append_column("h", table["g"]), "x")
    double = table.set_column(1, "current", table["current"].cast(pa.float64()))
    with pytest.raises(DatasetError, match=r"column current is double.*expected float in mA"):
        check_dataset(double, "x")
    unitless = pa.Table.from_arrays(
        table.columns, schema=pa.schema([pa.field(f.name, f.type) for f in schema()])
    )
    with pytest.raises(DatasetError, match=r"column configuration .*expected int32 in 1"):
        check_dataset(unitless, "x")


def test_wrong_rows_are_refused(table: pa.Table) -> None:
    configuration = table["configuration"].to_numpy().copy()
    configuration[[5, 15]] = configuration[[15, 5]]
    with pytest.raises(DatasetError, match="out of order"):
        check_dataset(with_column(table, "configuration", configuration), "x")
    current = table["current"].to_numpy().copy()
    current[17] *= 1.01
    with pytest.raises(DatasetError, match="currents of a configuration differ"):
        check_dataset(with_column(table, "current", current), "x")
    contact = table["contact_3"].to_numpy().copy()
    contact[100] = 1 - contact[100]
    with pytest.raises(DatasetError, match="contact_3 does not match"):
        check_dataset(with_column(table, "contact_3", contact), "x")


@pytest.mark.parametrize(
    ("name", "value"), [("mu_TA_left", 1.2), ("g", -0.1), ("si_IL_right", -1.5), ("g", np.nan)]
)
def test_values_outside_their_range_are_refused(table: pa.Table, name: str, value: float) -> None:
    values = table[name].to_numpy().copy()
    values[77] = value
    with pytest.raises(DatasetError, match=f"column {name} has values outside"):
        check_dataset(with_column(table, name, values), "x")


def test_missing_and_damaged_files_are_refused(tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match="no such file; the stage traverse_stimulation writes it"):
        read_dataset(tmp_path / "none.parquet")
    path = tmp_path / "bad.parquet"
    path.write_bytes(b"PAR1 nothing PAR1")
    with pytest.raises(DatasetError, match="not a parquet file"):
        read_dataset(path)
