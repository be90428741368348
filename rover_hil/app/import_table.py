"""`rover-hil import table`: tables of any rover become logs."""

from collections.abc import Sequence
from pathlib import Path

from rover_hil.app.exit_codes import EXIT_OK
from rover_hil.app.import_contents import WriteDrive, import_files
from rover_hil.importing.table.columns import read_columns, rover_of
from rover_hil.importing.table.to_log import write_table_as_log


def import_tables(files: Sequence[Path], *, columns_path: Path, out: Path, force: bool, as_json: bool) -> int:
    """Turn tables into logs, all of them or none; returns the exit code.

    Args:
        files: One table per drive.
        columns_path: File of columns.
        out: The log of one table; the folder for the logs of several, each called as its table.
        force: Overwrite earlier logs.
        as_json: Print JSON.

    Raises:
        ConfigError: The file of columns or the rover is wrong, or a log exists or cannot be written.
        LogError: A table cannot be read, or does not fit the columns.
    """

    def make_write() -> WriteDrive:
        columns = read_columns(columns_path)
        rover = rover_of(columns, columns_path)
        return lambda file, part: write_table_as_log(file, columns, rover, part)

    import_files(files, out, make_write, what="rows", force=force, as_json=as_json)
    return EXIT_OK
