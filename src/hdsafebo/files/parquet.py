"""Parquet files that are read whole, after a look at how large they would become.

A few kilobytes of run lengths and dictionaries can stand for any number of rows, so sizes are checked in
the metadata first, and texts are read as dictionaries before they are written out.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

from hdsafebo.errors import HdSafeBOError
from hdsafebo.files.bounded import require_regular

if TYPE_CHECKING:
    import pyarrow as pa
    import pyarrow.parquet as pq

MAX_CELLS = 50_000_000
MAX_BYTES = 2**30


def read_parquet(
    source: Path | BinaryIO,
    name: str,
    error: type[HdSafeBOError],
    columns: Sequence[str] | None = None,
    *,
    max_cells: int = MAX_CELLS,
    max_bytes: int = MAX_BYTES,
) -> pa.Table:
    """Columns of a parquet file, with the metadata of its schema.

    Args:
        source: path or open file.
        name: of the file, for messages.
        error: what is raised.
        columns: to read, numbers, truth values or text; None reads all.
        max_cells: largest number of rows times columns.
        max_bytes: largest size when decompressed, and largest size of a column of texts.

    Raises:
        HdSafeBOError: as `error`: the file is no parquet or damaged, lacks a column, has nested ones, or
            would take too much memory.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        if isinstance(source, Path):
            require_regular(source)
        # Opened as one file: below a directory, pyarrow would read "key=value" parts of the path as columns.
        with pq.ParquetFile(source) as file:
            schema = file.schema_arrow
            wanted = list(schema.names if columns is None else columns)
            _check_columns(schema, wanted, name, error)
            _check_size(file, wanted, name, error, max_cells, max_bytes)
            texts = [c for c in wanted if _is_text(schema.field(c).type)]
        with pq.ParquetFile(source, read_dictionary=texts) as file:
            table = file.read(columns=wanted)
        for text in texts:
            column = _written_out(table[text], f"{name}: column {text}", error, max_bytes)
            table = table.set_column(table.column_names.index(text), text, column)
        return table
    except (OSError, pa.ArrowException, UnicodeDecodeError) as fault:  # the last: names that are no UTF-8
        reason = " ".join(str(fault).split())[:300]
        raise error(f"{name}: cannot be read as parquet: {reason}") from fault


def column_names(path: Path, error: type[HdSafeBOError]) -> list[str]:
    """Names of the columns of a parquet file.

    Raises:
        HdSafeBOError: as `error`: it cannot be read as parquet.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        require_regular(path)
        return list(pq.read_schema(path).names)
    except (OSError, pa.ArrowException) as fault:
        raise error(f"{path}: cannot be read as parquet: {fault}") from fault


def _check_columns(schema: pa.Schema, wanted: list[str], name: str, error: type[HdSafeBOError]) -> None:
    import pyarrow as pa

    missing = [c for c in wanted if c not in schema.names]
    if missing:
        raise error(f"{name}: columns {missing} are missing; expected {wanted}")
    for column in wanted:
        if schema.names.count(column) > 1:
            raise error(f"{name}: column {column} appears twice")
        kind = schema.field(column).type
        plain = (pa.types.is_integer, pa.types.is_floating, pa.types.is_boolean, pa.types.is_null, _is_text)
        if not any(is_kind(kind) for is_kind in plain):
            raise error(f"{name}: column {column} has type {kind}, expected numbers or text")


def _is_text(kind: pa.DataType) -> bool:
    import pyarrow as pa

    if pa.types.is_dictionary(kind):
        kind = kind.value_type
    return pa.types.is_string(kind) or pa.types.is_large_string(kind)


def _check_size(
    file: pq.ParquetFile,
    wanted: list[str],
    name: str,
    error: type[HdSafeBOError],
    max_cells: int,
    max_bytes: int,
) -> None:
    cells = file.metadata.num_rows * len(wanted)
    if cells > max_cells:
        raise error(f"{name}: {cells} cells, expected at most {max_cells}")
    groups = [file.metadata.row_group(i) for i in range(file.metadata.num_row_groups)]
    size = sum(group.total_byte_size for group in groups)
    if size > max_bytes:
        raise error(f"{name}: {size} bytes when decompressed, expected at most {max_bytes}")


def _written_out(
    column: pa.ChunkedArray, what: str, error: type[HdSafeBOError], max_bytes: int
) -> pa.ChunkedArray:
    """Text from a dictionary, if all of it has room."""
    import pyarrow as pa
    import pyarrow.compute as pc

    if not pa.types.is_dictionary(column.type):
        return column
    size = 0
    for chunk in column.chunks:
        lengths = pc.take(pc.binary_length(chunk.dictionary), chunk.indices)
        size += pc.sum(pc.cast(lengths, pa.int64())).as_py() or 0
    if size > max_bytes:
        raise error(f"{what} holds {size} bytes of text, expected at most {max_bytes}")
    return column.cast(pa.string())
