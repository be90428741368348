"""Write tables as CSV or Parquet files."""

import csv
import io
from collections.abc import Mapping
from contextlib import ExitStack
from pathlib import Path

from drivers.errors import ConfigError
from rover_hil.exporting.tables import Table, Value
from rover_hil.pages.atomic_write import refuse_overwrite, unfinished

DECIMALS_OF_TIME = 9


def write_tables(tables: Mapping[str, Table], folder: Path, suffix: str, *, force: bool) -> None:
    """Write each table as a file NAME.csv or NAME.parquet into a folder.

    Args:
        tables: By name.
        folder: Made where missing.
        suffix: ".csv" or ".parquet".
        force: Overwrite files.

    Raises:
        ConfigError: A file exists or cannot be written, or pyarrow is missing.
    """
    encode = _csv if suffix == ".csv" else _parquet
    paths = {name: folder / f"{name}{suffix}" for name in tables}
    refuse_overwrite(*paths.values(), force=force)
    try:
        with ExitStack() as stack:  # all of them or none
            parts = {name: stack.enter_context(unfinished(path)) for name, path in paths.items()}
            for name, table in tables.items():
                parts[name].write_bytes(encode(table))
    except OSError as error:
        raise ConfigError(f"cannot write to {folder}: {error.strerror}; choose another --out") from error


def _csv(table: Table) -> bytes:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(table.columns)
    for row in table.rows:
        writer.writerow([_word(row.get(name)) for name in table.columns])
    return text.getvalue().encode()


def _word(value: Value) -> object:
    if isinstance(value, bool):
        return int(value)
    return "" if value is None else value


def _parquet(table: Table) -> bytes:
    try:
        import pyarrow as pa
        import pyarrow.parquet as pq
    except ImportError as error:
        raise ConfigError("--parquet needs pyarrow: `pip install rover-hil[export]`") from error
    columns = {name: pa.array(_alike(table.column(name))) for name in table.columns}
    stream = io.BytesIO()
    pq.write_table(pa.table(columns), stream, compression="zstd")
    return stream.getvalue()


def _alike(values: list[Value]) -> list[Value]:
    """Return a column with one type: text where there is any, else float where there is any."""
    kinds = {type(value) for value in values if value is not None}
    if len(kinds) < 2:
        return values
    if str in kinds:
        return [None if value is None else str(value) for value in values]
    return [None if value is None else float(value) for value in values]
