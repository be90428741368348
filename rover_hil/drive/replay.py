"""`rover-hil replay`: run a log again and list the outputs that differ."""

import math
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from controllers.slip.effort.settings import YAW_PROBE
from drivers.clock import SystemClock, seconds
from drivers.errors import ConfigError, LogError
from rover_hil.config import Config
from rover_hil.console.error_message import readable_line
from rover_hil.console.exit_codes import EXIT_NO, EXIT_OK
from rover_hil.console.json_text import print_json
from rover_hil.console.options import (
    LIVE_PORT,
    ForceOption,
    JsonOption,
    LiveOption,
    LivePortOption,
    LogArgument,
    log_at,
    out_option,
)
from rover_hil.console.steps import show_progress
from rover_hil.drive.run_surroundings import live_mirror
from rover_hil.drives.formats.described_rover import load_rover
from rover_hil.drives.position_frame import COLUMNS, PositionFrame, position_frame
from rover_hil.drives.quality.judge import drive_findings, with_causes
from rover_hil.pages.atomic_write import check_new_file, refuse_overwrite, unfinished, write_file
from rover_hil.recording.data_files import restore_config, with_controller_of
from rover_hil.recording.findings import finding_lines
from rover_hil.recording.made_with import changes_since, made_with
from rover_hil.recording.reader import LogReader
from rover_hil.recording.watchdog_note import read_note
from rover_hil.report.write import REPORT_NAME, SUMMARY_NAME, write_report
from rover_hil.run.estimated_log import lacks_estimate, write_estimated
from rover_hil.run.recorded_cycles import DRIVEN
from rover_hil.run.replay import ReplayResult, replay
from rover_hil.terminal import Terminal

ROWS_SHOWN = 25
POSES_NAME = "poses_in_frame.csv"
"""Poses in the frame of the positions, where its direction is known."""
TEXT_SHOWN = 40


def replay_log(
    log_path: LogArgument,
    *,
    config_name: Annotated[
        str | None,
        typer.Option(
            "--config",
            help="Replay with rover, filter, limits, safety, slip and mission of this configuration, or of "
            "another log, or with rover and limits of a file of columns.",
        ),
    ] = None,
    out: Annotated[
        Path | None, out_option("Also write summary and report of the recorded run into this folder.")
    ] = None,
    live: LiveOption = False,
    live_port: LivePortOption = LIVE_PORT,
    force: ForceOption = False,
    as_json: JsonOption = False,
) -> int:
    """Run a log again and compare every output.

    Exit code 1: something came out different; the fields are listed. For a log that was imported with
    `--no-estimate` the estimate is made instead; the folder --out gets the log with it.

    Example: `rover-hil replay runs/first/run.mcap`

    Data: `rover-hil sample runs` writes such a log; a whole run is
    `rover-hil run robotino --virtual --out runs/first`.
    """
    if out is not None:
        refuse_overwrite(out / SUMMARY_NAME, out / REPORT_NAME, out / POSES_NAME, force=force)
    path = log_at(log_path)
    log = LogReader(path)
    estimated = _estimated_path(log, out, force=force)
    controller = None if config_name is None else load_rover(config_name)
    if not as_json:
        for change in changes_since(log.made_with):
            Terminal(soft_wrap=True).print(readable_line(change))
    with (
        restore_config(log) as logged_config,
        show_progress() as progress,
    ):
        task = progress.add_task("replaying", total=path.stat().st_size)
        if controller is None:
            refuse_old_excitation(logged_config, path)
        config = logged_config if controller is None else with_controller_of(logged_config, controller)
        result = _run_again(log, config, estimated, lambda: progress.update(task, completed=log.bytes_read))
    if result.cycles == 0:
        raise LogError(f"log {path} holds no complete cycle")
    causes = [] if log.origin in DRIVEN else drive_findings(path)
    result.findings, result.doubts = with_causes(causes, result.findings, result.doubts)
    frame = position_frame(estimated or path)
    if as_json:
        print_json({**_record(result, log), "position_frame": _frame_record(frame)})
    else:
        _print_words(result, log, estimated, frame)
    if live:
        _stream(LogReader(estimated or path), live_port)
    if out is not None:
        write_report(estimated or path, out)
        _write_poses(frame, out)
        if not as_json:
            Terminal().print(f"report of the recorded run: {out / REPORT_NAME}", soft_wrap=True)
    return EXIT_NO if result.differences else EXIT_OK


def _estimated_path(log: LogReader, out: Path | None, *, force: bool) -> Path | None:
    """Return where to write the log with its estimate; None where it has one.

    Raises:
        ConfigError: It has none, and there is no folder for it; or a file would be replaced.
    """
    if not lacks_estimate(log):
        return None
    if out is None:
        raise ConfigError(
            f"{log.path} was imported without an estimate, so there is nothing to compare: name with --out a "
            "folder, which gets the log with the estimate, and its report"
        )
    estimated = out / log.path.name
    if estimated.exists() and estimated.samefile(log.path):
        raise ConfigError(
            f"the log with the estimate would replace {log.path}: name another folder with --out"
        )
    check_new_file(estimated, force=force)
    return estimated


def _run_again(
    log: LogReader, config: Config, estimated: Path | None, on_cycle: Callable[[], None]
) -> ReplayResult:
    """Replay a log, or write the log `estimated` with the estimate that it has not."""
    if estimated is None:
        return replay(log, config, on_cycle)
    with unfinished(estimated) as part:
        return write_estimated(log, config, part, estimated, on_cycle)


def refuse_old_excitation(config: Config, path: Path) -> None:
    """Check that the slip of a log was not read from the excitation as in earlier versions.

    Raises:
        LogError: It was, and cannot be replayed.
    """
    slip = config.slip
    if slip is not None and slip.use == YAW_PROBE and "excitation" not in slip.model_fields_set:
        raise LogError(
            f"log {path}: its slip was read from the yaw excitation by fitted constants that this version "
            "does not have: replay it with the version that made it, or name a configuration of this version"
        )


def _stream(log: LogReader, port: int) -> None:
    """Stream a log at the speed of its recording, until its end or ctrl-C."""
    clock = SystemClock()
    with suppress(KeyboardInterrupt), live_mirror(port, Terminal(stderr=True)) as publish:
        start_ns = clock.now_ns()
        for message in log.stored_messages():
            clock.sleep_until(start_ns + message.t_ns - log.start_ns)
            if publish is not None:
                publish(message.topic, log.wall_offset_ns + message.t_ns, message.data)


def _record(result: ReplayResult, log: LogReader) -> dict[str, object]:
    return {
        "made_with": log.made_with,
        "replayed_with": dict(made_with()),
        "identical": not result.differences,
        "cycles": result.cycles,
        "differences": result.differences,
        "findings": result.findings,
        "doubts": result.doubts,
        "log_is_complete": log.is_complete and result.has_end,
    }


def _write_poses(frame: PositionFrame | None, out: Path) -> None:
    if frame is not None:
        rows = [",".join(COLUMNS), *(",".join(f"{value:.6f}" for value in row) for row in frame.poses)]
        write_file(out / POSES_NAME, "\n".join(rows) + "\n")


def _frame_record(frame: PositionFrame | None) -> dict[str, object] | None:
    if frame is None:
        return None
    end = dict(zip(COLUMNS, frame.poses[-1].tolist(), strict=True))
    numbers = {name: getattr(frame, name) for name in ("turned_rad", "turned_sd_rad", "rms_m")}
    return {"device": frame.device, "count": frame.count, **numbers, "end": end}


def _frame_sentence(frame: PositionFrame) -> str:
    x_m, y_m, yaw_rad = frame.poses[-1, 1:].tolist()
    turned_deg, sd_deg = math.degrees(frame.turned_rad), math.degrees(frame.turned_sd_rad)
    return (
        f"in the frame of the {frame.count} positions of {frame.device}, turned by {turned_deg:.1f} deg "
        f"(standard deviation {sd_deg:.1f}): it ends at {x_m:.3f}, {y_m:.3f} m, yaw "
        f"{math.degrees(math.remainder(yaw_rad, math.tau)):.1f} deg; positions and estimate differ by "
        f"{frame.rms_m:.3g} m rms; --out writes all poses to {POSES_NAME}"
    )


def _print_words(
    result: ReplayResult, log: LogReader, estimated: Path | None, frame: PositionFrame | None
) -> None:
    console = Terminal()
    if not log.is_complete:
        console.print(f"{log.path} was cut off; everything up to the cut was replayed")
        if note := read_note(log.path):
            console.print(note, soft_wrap=True)
    elif not result.has_end:
        console.print(
            f"{log.path} does not say how the run ended: it was interrupted, or its end was removed; "
            "everything in the log was replayed",
            soft_wrap=True,
        )
    if frame is not None:
        console.print(_frame_sentence(frame), soft_wrap=True)
    for finding in (*result.findings, *result.doubts):
        console.print("\n".join(finding_lines(finding)), soft_wrap=True)
    if estimated is not None:
        console.print(f"{result.cycles} cycles estimated: {estimated}", soft_wrap=True)
        return
    if not result.differences:
        console.print(f"{result.cycles} cycles replayed, every output identical")
        return
    table = Table("field", "cycles", "first at", "largest", "recorded last", "replayed last")
    for difference in result.differences[:ROWS_SHOWN]:
        table.add_row(
            difference.field,
            str(difference.count),
            f"{seconds(difference.first_t_ns - log.start_ns):.3f} s",
            "" if difference.largest is None else f"{difference.largest:.3g}",
            _short(difference.recorded),
            _short(difference.replayed),
        )
    console.print(table)
    console.print(f"{len(result.differences)} fields came out different in {result.cycles} cycles")


def _short(value: object) -> str:
    text = f"{value:.6g}" if isinstance(value, float) else str(value)
    return text if len(text) <= TEXT_SHOWN else f"{text[:TEXT_SHOWN]}..."
