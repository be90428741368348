"""`rover-hil export`: the records of a log for other programs."""

import sqlite3
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Literal

import typer

from drivers.errors import ConfigError, LogError
from rover_hil.console.exit_codes import EXIT_OK
from rover_hil.console.json_text import print_json
from rover_hil.console.options import ForceOption, JsonOption, LogArgument, log_at, out_option
from rover_hil.console.steps import show_progress
from rover_hil.exporting.can import check_name, write_can
from rover_hil.exporting.robot_localization import robot_localization_text
from rover_hil.exporting.rosbag2 import write_rosbag2
from rover_hil.exporting.tables import read_tables
from rover_hil.exporting.tum import CONTENT, SUFFIX, tum_texts
from rover_hil.exporting.write import write_tables
from rover_hil.pages.atomic_write import check_file, refuse_overwrite, unfinished, write_file, write_files
from rover_hil.recording.data_files import restore_config
from rover_hil.recording.reader import LogReader
from rover_hil.terminal import Terminal

TABLES = {"csv": ".csv", "parquet": ".parquet"}
ROSBAG = "rosbag2"
CAN = "can"
EVO = "evo"
ROBOT_LOCALIZATION = "robot_localization"
FILES = {CAN: ".log", ROBOT_LOCALIZATION: f"_{ROBOT_LOCALIZATION}.yaml"}
"""Formats of one file, and how its name ends, after that of the log."""
UNITS = {ROSBAG: "messages", CAN: "frames", EVO: "poses", ROBOT_LOCALIZATION: "lines"}
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
    program: Annotated[
        Literal["evo", "robot_localization"] | None,
        typer.Option(
            "--for",
            help="For a program: trajectories as TUM files for evo, or parameters of ekf_node of "
            "robot_localization.",
        ),
    ] = None,
    out: Annotated[
        Path | None,
        out_option("Folder to write [default: LOG_FORMAT]; a file with --can and --for robot_localization."),
    ] = None,
    force: ForceOption = False,
    as_json: JsonOption = False,
) -> int:
    """Write a log for other programs: tables, a ROS 2 bag, CAN frames, trajectories, or filter parameters.

    Tables have the units in the names of the columns. Parameters have source and interval in a comment.

    Example: `rover-hil export runs/first/run.mcap --csv`

    Data: `rover-hil sample runs` writes such a log; a whole run is
    `rover-hil run robotino --virtual --out runs/first`.
    """
    wanted = {"csv": csv, "parquet": parquet, ROSBAG: rosbag2, CAN: can}
    formats = [name for name, is_wanted in wanted.items() if is_wanted]
    formats += [] if program is None else [program]
    if len(formats) != 1:
        raise ConfigError("choose one format: --csv, --parquet, --rosbag2, --can or --for")
    (name,) = formats
    path = log_at(log_path)
    log = LogReader(path)
    place = out or path.with_name(f"{path.stem}{FILES.get(name, f'_{name}')}")
    _check_place(place, name, force=force)
    with show_progress() as progress:
        task = progress.add_task("reading", total=path.stat().st_size)
        rows = _write(log, name, place, lambda: progress.update(task, completed=log.bytes_read), force=force)
    console = Terminal(soft_wrap=True)
    if as_json:
        kind = "file" if name in FILES else "folder"
        print_json({kind: str(place), "rows": rows, "log_is_complete": log.is_complete})
        return EXIT_OK
    what = UNITS.get(name, "rows")
    for table, count in rows.items():
        console.print(f"{table}: {count} {what}")
    console.print(f"written: {place}")
    if not log.is_complete:
        console.print(f"{path} was cut off; everything up to the cut was written")
    return EXIT_OK


def _write(
    log: LogReader, name: str, place: Path, show: Callable[[], None], *, force: bool
) -> Mapping[str, int]:
    """Write a format; return what was counted in it."""
    if name == ROSBAG:
        with unfinished(place) as part, _named_failures(place):
            rows = _required(log, write_rosbag2(log, part, show))
    elif name == CAN:
        with restore_config(log) as config, unfinished(place) as part, _named_failures(place):
            rows = _required(log, write_can(log, config, part, show))
    elif name == EVO:
        texts, rows = tum_texts(log, show)
        write_files(place, texts)
        for left in {f"{each}{SUFFIX}" for each in CONTENT} - set(texts):  # of another log
            (place / left).unlink(missing_ok=True)
    elif name == ROBOT_LOCALIZATION:
        with restore_config(log) as config:
            text = robot_localization_text(log, config, show)
        write_file(place, text)
        rows = {name: text.count("\n")}
    else:
        tables = read_tables(log, show)
        rows = _required(log, {table: len(content.rows) for table, content in tables.items()})
        write_tables(tables, place, TABLES[name], force=force)
    return rows


def _check_place(place: Path, name: str, *, force: bool) -> None:
    """Check that a format can be written to a place."""
    if name == CAN:
        check_name(place)
    if name in FILES:
        check_file(place, force=force)
        return
    if name != ROSBAG:
        suffix = TABLES.get(name, SUFFIX)
        refuse_overwrite(*sorted(place.glob(f"*{suffix}"))[:1], force=force)
        return
    refuse_overwrite(place, force=force)
    # The whole folder is replaced: it must be one that held a bag only.
    if place.exists() and not (place / "metadata.yaml").is_file():
        raise ConfigError(f"{place} is not a bag: choose another --out")


@contextmanager
def _named_failures(path: Path) -> Iterator[None]:
    """Report what a full disk makes of the libraries: rosbags writes a database."""
    try:
        yield
    except (OSError, sqlite3.Error) as error:
        raise ConfigError(
            f"cannot write {path}: {error}; make room there, or choose another --out"
        ) from error


def _required(log: LogReader, rows: Mapping[str, int]) -> Mapping[str, int]:
    if not rows:
        raise LogError(f"log {log.path} holds no records: give the log of a run")
    return rows
