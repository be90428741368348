"""`rover-hil export`: the records of a log for other programs."""

import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer

from drivers.errors import ConfigError, LogError
from rover_hil.console.exit_codes import EXIT_OK
from rover_hil.console.json_text import print_json
from rover_hil.console.options import ForceOption, JsonOption, LogArgument, log_at, out_option
from rover_hil.console.steps import show_progress
from rover_hil.exporting.can import check_name, write_can
from rover_hil.exporting.rosbag2 import write_rosbag2
from rover_hil.exporting.tables import read_tables
from rover_hil.exporting.write import write_tables
from rover_hil.pages.atomic_write import check_file, refuse_overwrite, unfinished
from rover_hil.recording.data_files import restore_config
from rover_hil.recording.reader import LogReader
from rover_hil.terminal import Terminal

TABLES = {"csv": ".csv", "parquet": ".parquet"}
ROSBAG = "rosbag2"
CAN = "can"
UNITS = {ROSBAG: "messages", CAN: "frames"}
"""What is counted, where it is not rows."""


def export_log(
    log_path: LogArgument,
    *,
    csv: Annotated[bool, typer.Option("--csv", help="Tables as CSV files.")] = False,
    parquet: Annotated[bool, typer.Option("--parquet", help="Tables as Parquet files.")] = False,
    rosbag2: Annotated[bool, typer.Option("--rosbag2", help="A ROS 2 bag.")] = False,
    can: Annotated[
        bool, typer.Option("--can", help="Frames of its CAN buses; --out ends in .log, .asc, .blf or .trc.")
    ] = False,
    out: Annotated[
        Path | None, out_option("Folder to write [default: LOG_FORMAT]; a file with --can.")
    ] = None,
    force: ForceOption = False,
    as_json: JsonOption = False,
) -> int:
    """Write a log for other programs: tables with units in the names of columns, a ROS 2 bag, CAN frames.

    Example: `rover-hil export runs/first/run.mcap --csv`

    Data: `rover-hil sample runs` writes such a log; a whole run is
    `rover-hil run robotino --virtual --out runs/first`.
    """
    wanted = {"csv": csv, "parquet": parquet, ROSBAG: rosbag2, CAN: can}
    formats = [name for name, is_wanted in wanted.items() if is_wanted]
    if len(formats) != 1:
        raise ConfigError("choose one format: --csv, --parquet, --rosbag2 or --can")
    (name,) = formats
    path = log_at(log_path)
    log = LogReader(path)
    if name == CAN:
        folder = out or path.with_suffix(".log")
        check_name(folder)
        check_file(folder, force=force)
    else:
        folder = out or path.with_name(f"{path.stem}_{name}")
        _check_folder(folder, name, force=force)
    with show_progress() as progress:
        task = progress.add_task("reading", total=path.stat().st_size)

        def show() -> None:
            progress.update(task, completed=log.bytes_read)

        if name == ROSBAG:
            with unfinished(folder) as part, _named_failures(folder):
                rows = dict(write_rosbag2(log, part, show))
                _require_records(log, rows)
        elif name == CAN:
            with restore_config(log) as config, unfinished(folder) as part, _named_failures(folder):
                rows = dict(write_can(log, config, part, show))
                _require_records(log, rows)
        else:
            tables = read_tables(log, show)
            rows = {table: len(content.rows) for table, content in tables.items()}
            _require_records(log, rows)
            progress.update(task, description="writing")
            write_tables(tables, folder, TABLES[name], force=force)
    console = Terminal(soft_wrap=True)
    if as_json:
        place = "file" if name == CAN else "folder"
        print_json({place: str(folder), "rows": rows, "log_is_complete": log.is_complete})
        return EXIT_OK
    what = UNITS.get(name, "rows")
    for table, count in rows.items():
        console.print(f"{table}: {count} {what}")
    console.print(f"written: {folder}")
    if not log.is_complete:
        console.print(f"{path} was cut off; everything up to the cut was written")
    return EXIT_OK


def _check_folder(folder: Path, name: str, *, force: bool) -> None:
    if name != ROSBAG:
        refuse_overwrite(*sorted(folder.glob(f"*{TABLES[name]}"))[:1], force=force)
        return
    refuse_overwrite(folder, force=force)
    # The whole folder is replaced: it must be one that held a bag only.
    if folder.exists() and not (folder / "metadata.yaml").is_file():
        raise ConfigError(f"{folder} is not a bag: choose another --out")


@contextmanager
def _named_failures(path: Path) -> Iterator[None]:
    """Report what a full disk makes of the libraries: rosbags writes a database."""
    try:
        yield
    except (OSError, sqlite3.Error) as error:
        raise ConfigError(
            f"cannot write {path}: {error}; make room there, or choose another --out"
        ) from error


def _require_records(log: LogReader, rows: dict[str, int]) -> None:
    if not rows:
        raise LogError(f"log {log.path} holds no records: give the log of a run")
