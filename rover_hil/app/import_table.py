"""`rover-hil import table`: tables of any rover become logs."""

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import asdict
from pathlib import Path

from drivers.clock import seconds
from drivers.errors import ConfigError
from rover_hil.app.exit_codes import EXIT_OK
from rover_hil.app.import_contents import print_contents
from rover_hil.app.json_text import print_json
from rover_hil.app.steps import show_steps
from rover_hil.importing.drive import START_NS, Contents
from rover_hil.importing.table.columns import read_columns, rover_of
from rover_hil.importing.table.to_log import write_table_as_log
from rover_hil.pages.atomic_write import check_file, unfinished


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
    outs = _outs(files, out)
    for path in outs:
        check_file(path, force=force)
    columns = read_columns(columns_path)
    rover = rover_of(columns, columns_path)
    done: list[Contents] = []
    with ExitStack() as stack:
        parts = [stack.enter_context(unfinished(path)) for path in outs]
        with show_steps(f"reading {files[0].name}") as step:
            for file, part in zip(files, parts, strict=True):
                step(f"reading {file.name}")
                contents = Contents()
                for contents in write_table_as_log(file, columns, rover, part):
                    step(f"importing {file.name}, {seconds(contents.end_ns - START_NS):.0f} s are done")
                done.append(contents)
    if as_json:
        print_json(
            [
                {"log": str(path), "duration_s": seconds(contents.end_ns - START_NS), **asdict(contents)}
                for path, contents in zip(outs, done, strict=True)
            ]
        )
        return EXIT_OK
    for path, contents in zip(outs, done, strict=True):
        print_contents(contents, path, what="rows")
    return EXIT_OK


def _outs(files: Sequence[Path], out: Path) -> list[Path]:
    if len(files) == 1:
        return [out]
    if not out.is_dir():
        raise ConfigError(
            f"no folder {out} for the logs of {len(files)} tables: make it, or choose another --out"
        )
    outs = [out / f"{file.name.removesuffix('.gz').rsplit('.', 1)[0]}.mcap" for file in files]
    if len(set(outs)) < len(outs):
        raise ConfigError("two of the tables have one name, so would their logs: import them one by one")
    return outs
