"""The stimulation dataset on disk: one row per configuration and current, typed columns with units."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from hdsafebo.errors import DatasetError
from hdsafebo.files.bounded import require_regular
from hdsafebo.spinal.activating_function import SIDES
from hdsafebo.spinal.configurations import CONFIGURATIONS, CONTACTS, enumerate_configurations
from hdsafebo.spinal.muscles import MUSCLES
from hdsafebo.spinal.traversal import Traversal

LEVELS = 10
ROWS = CONFIGURATIONS * LEVELS  # 218,000
POOLS = tuple(f"{muscle}_{side}" for muscle in MUSCLES for side in SIDES)


def schema() -> pa.Schema:
    """Columns, types and, in the fields' metadata, units and meaning."""

    def field(name: str, kind: pa.DataType, unit: str, meaning: str) -> pa.Field:
        return pa.field(name, kind, nullable=False, metadata={"unit": unit, "meaning": meaning})

    contacts = [
        field(f"contact_{i}", pa.int8(), "1", "polarity: -1 cathode, 0 off, +1 anode")
        for i in range(CONTACTS)
    ]
    mu = [field(f"mu_{p}", pa.float32(), "1", "activated share of the motor pool's volume") for p in POOLS]
    si = [
        field(f"si_{p}", pa.float32(), "1", "mu minus the mean mu of the adjacent pools of its side")
        for p in POOLS
    ]
    return pa.schema(
        [
            field("configuration", pa.int32(), "1", "number of the contact configuration"),
            field("current", pa.float32(), "mA", "current through all cathodes together"),
            *contacts,
            *mu,
            *si,
            field("g", pa.float32(), "1", "1 - largest mu of any muscle on either side"),
        ]
    )


def to_table(traversal: Traversal) -> pa.Table:
    """The rows of a traversal, configurations outer, currents inner.

    The schema's metadata states the activation threshold, a calibration constant.
    """
    levels = len(traversal.currents)
    columns = [
        np.repeat(np.arange(len(traversal.polarity), dtype=np.int32), levels),
        np.tile(traversal.currents, len(traversal.polarity)),
        *np.repeat(traversal.polarity, levels, axis=0).T,
        *traversal.mu.reshape(-1, len(POOLS)).T,
        *traversal.si.reshape(-1, len(POOLS)).T,
        traversal.g.ravel(),
    ]
    metadata = {
        "activation_threshold": repr(traversal.threshold),
        "activation_threshold_unit": "mV/mm^2",
        "activation_threshold_origin": "calibrated so that half of the rows are safe",
    }
    arrays = [pa.array(np.ascontiguousarray(c)) for c in columns]
    return pa.Table.from_arrays(arrays, schema=schema().with_metadata(metadata))


def write_dataset(table: pa.Table, path: Path) -> None:
    """Check and write the dataset; see `check_dataset`."""
    check_dataset(table, str(path))
    floats = [f.name for f in table.schema if f.type == pa.float32()]
    pq.write_table(
        table, path, compression="zstd", compression_level=9, use_byte_stream_split=floats,
        use_dictionary=[f.name for f in table.schema if f.name not in floats],
    )  # fmt: skip


def read_dataset(path: Path) -> pa.Table:
    """Read and check the dataset.

    Raises:
        DatasetError: the file is missing or damaged, or its content fails `check_dataset`.
    """
    try:
        require_regular(path)
        table = pq.read_table(path)
    except FileNotFoundError as error:
        raise DatasetError(f"{path}: no such file; the stage traverse_stimulation writes it") from error
    except (OSError, ValueError, pa.ArrowException) as error:
        raise DatasetError(f"{path}: not a parquet file: {error}") from error
    check_dataset(table, str(path))
    return table


def check_dataset(table: pa.Table, source: str) -> None:
    """Prove that a table is the whole dataset.

    Raises:
        DatasetError: missing or extra rows, a missing, extra or mistyped column, rows out of order, a
            configuration that is not the enumerated one, or a value outside its range.
    """
    wanted = schema()
    if table.schema.names != wanted.names:
        missing = [n for n in wanted.names if n not in table.schema.names]
        extra = [n for n in table.schema.names if n not in wanted.names]
        raise DatasetError(
            f"{source}: columns missing {missing}, extra {extra}, expected those of the schema in order"
        )
    for have, want in zip(table.schema, wanted, strict=True):
        if have.type != want.type or (have.metadata or {}).get(b"unit") != want.metadata[b"unit"]:
            raise DatasetError(
                f"{source}: column {want.name} is {have.type}, "
                f"expected {want.type} in {want.metadata[b'unit'].decode()}"
            )
    if table.num_rows != ROWS:
        difference = table.num_rows - ROWS
        raise DatasetError(
            f"{source}: {table.num_rows} rows, expected {ROWS} "
            f"({abs(difference)} {'extra' if difference > 0 else 'missing'})"
        )
    _check_rows(table, source)
    for name in wanted.names[2 + CONTACTS :]:
        low = -1.0 if name.startswith("si_") else 0.0
        values = _column(table, name)
        if not (np.isfinite(values).all() and values.min() >= low - 1e-6 and values.max() <= 1 + 1e-6):
            raise DatasetError(f"{source}: column {name} has values outside [{low:g}, 1]")


def _check_rows(table: pa.Table, source: str) -> None:
    """Every configuration, in order, at the same increasing currents, with the polarities it stands for."""
    if not np.array_equal(_column(table, "configuration"), np.repeat(np.arange(CONFIGURATIONS), LEVELS)):
        raise DatasetError(
            f"{source}: configurations are missing, repeated or out of order, "
            f"expected 0 to {CONFIGURATIONS - 1}, {LEVELS} rows each"
        )
    currents = _column(table, "current").reshape(CONFIGURATIONS, LEVELS)
    same = np.array_equal(currents, np.broadcast_to(currents[0], currents.shape))
    if not (same and currents[0, 0] > 0 and (np.diff(currents[0]) > 0).all()):
        raise DatasetError(
            f"{source}: the currents of a configuration differ or do not increase, "
            f"expected the same {LEVELS} for all"
        )
    polarity = np.repeat(enumerate_configurations(), LEVELS, axis=0)
    for i in range(CONTACTS):
        if not np.array_equal(_column(table, f"contact_{i}"), polarity[:, i]):
            raise DatasetError(f"{source}: column contact_{i} does not match the enumerated configurations")


def _column(table: pa.Table, name: str) -> NDArray:
    column = table[name]
    if column.null_count:
        raise DatasetError(f"column {name} has {column.null_count} missing values")
    return column.to_numpy()
