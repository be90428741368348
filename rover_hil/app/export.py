"""`rover-hil export`: the records of a log for other programs."""

from pathlib import Path

from drivers.errors import ConfigError, LogError
from rover_hil.console.exit_codes import EXIT_OK
from rover_hil.console.json_text import print_json
from rover_hil.console.options import log_at
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


def export_log(path: Path, *, formats: list[str], out: Path | None, force: bool, as_json: bool) -> int:
    """Write the records of a log in one format; returns the exit code.

    Args:
        path: The log, or the folder of its run.
        formats: The formats wanted: "csv", "parquet", "rosbag2", "can"; one of them.
        out: Folder [default: the name of the log with `_` and the format]; for "can" a file
            [default: the name of the log with `.log`].
        force: Overwrite an earlier export.
        as_json: Print what was written as JSON.

    Raises:
        LogError: The log cannot be read, or holds no record.
        ConfigError: Not one format is wanted, its library is missing, or the folder cannot be written.
    """
    if len(formats) != 1:
        raise ConfigError("choose one format: --csv, --parquet, --rosbag2 or --can")
    (name,) = formats
    path = log_at(path)
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
            with unfinished(folder) as part:
                rows = dict(write_rosbag2(log, part, show))
                _require_records(log, rows)
        elif name == CAN:
            with restore_config(log) as config, unfinished(folder) as part:
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


def _require_records(log: LogReader, rows: dict[str, int]) -> None:
    if not rows:
        raise LogError(f"log {log.path} holds no records: give the log of a run")
