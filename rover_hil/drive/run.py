"""`rover-hil run`: put the rover together, run the loop, write log, summary and report."""

import json
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from pathlib import Path
from typing import Annotated

import typer
from rich.live import Live
from rich.text import Text

from controllers.control_loop import StepOutput
from controllers.safety import Mode
from drivers.clock import PacedClock, wall_time_text
from drivers.errors import ConfigError
from rover_hil.config import Config, load_config
from rover_hil.connect.connections import connected
from rover_hil.console.exit_codes import EXIT_INTERRUPTED, EXIT_NO, EXIT_OK
from rover_hil.console.json_text import print_json_text
from rover_hil.console.memory import ShortOfMemoryError, sentence_of
from rover_hil.console.options import (
    LIVE_PORT,
    LOG_NAME,
    LONGEST_S,
    ConfigArgument,
    ForceOption,
    JsonOption,
    LiveOption,
    LivePortOption,
    PlantModelOption,
    number_option,
    out_option,
)
from rover_hil.console.output import can_tell
from rover_hil.live.server import HOST, LiveServer
from rover_hil.pages.atomic_write import refuse_overwrite
from rover_hil.recording.writer import Mirror
from rover_hil.report.write import REPORT_NAME, SUMMARY_NAME, write_report
from rover_hil.run.checks import RUN_CHECKS, VIRTUAL_RUN_CHECKS
from rover_hil.run.drive_permission import order_drive
from rover_hil.run.driving import StatusDisplay, run_real, run_virtual
from rover_hil.run.excitation import for_real_rover
from rover_hil.run.executive import End, Operator, RunResult
from rover_hil.terminal import Terminal

SLOW_SHARE = 0.02
"""Of the cycles of a real run; with more skipped the user is told."""


def run_rover(
    config_name: ConfigArgument,
    *,
    virtual: Annotated[
        bool,
        typer.Option(
            "--virtual",
            help="Drive the embedded simulated rover, in step with simulated time: no watchdog is needed.",
        ),
    ] = False,
    duration_s: Annotated[
        float | None,
        number_option(
            "End after this many seconds instead of with the mission.", "s", 0.1, LONGEST_S, "--duration"
        ),
    ] = None,
    out: Annotated[
        Path | None, out_option("Folder for log, summary and report [default: runs/NAME-DATE].")
    ] = None,
    realtime: Annotated[
        bool,
        typer.Option(
            "--realtime",
            help="Use the SCHED_FIFO scheduler; needs the right to. With --virtual: simulated time passes "
            "like real time, so that other programs can take part.",
        ),
    ] = False,
    model: PlantModelOption = None,
    live: LiveOption = False,
    live_port: LivePortOption = LIVE_PORT,
    odometry_to: Annotated[
        str | None,
        typer.Option(
            "--odometry-to",
            metavar="HOST:PORT",
            help="Send pose, velocity and state of each cycle there, as a line of JSON over UDP.",
        ),
    ] = None,
    force: ForceOption = False,
    as_json: JsonOption = False,
) -> int:
    """Run the loop, on real devices or on the simulated rover, and write log, summary and report.

    Exit code 1: the rover could not finish the mission, or drive until you or --duration ended the run.

    Example: `rover-hil run robotino --virtual`
    """
    config = load_config(config_name, VIRTUAL_RUN_CHECKS if virtual else RUN_CHECKS)
    messages = Terminal(stderr=True)
    if model is not None:
        config = _extended(config, model, messages, virtual=virtual)
    config, note = (config, "") if virtual else for_real_rover(config)
    folder = out or Path("runs") / f"{Path(config_name).stem}-{wall_time_text()}"
    log_path = folder / LOG_NAME
    reports = [folder / name for name in (SUMMARY_NAME, REPORT_NAME)]
    refuse_overwrite(log_path, *reports, force=force)
    limit_s = duration_s or config.loop.time_limit_s
    clock = PacedClock() if virtual and realtime else None
    connection = _connection(config, clock, messages, odometry_to, is_paced=realtime or not virtual)
    with (
        live_mirror(live_port if live else None, messages) as mirror,
        connection as operator,
        Live(console=messages, transient=True, auto_refresh=False) as display,
    ):
        show = _display(display, messages, note)

        try:
            if virtual:
                result = run_virtual(config, log_path, limit_s, show, mirror, clock=clock, operator=operator)
            else:
                order = order_drive(config_name, config)
                result = run_real(
                    config,
                    log_path,
                    limit_s,
                    show,
                    order=order,
                    realtime=realtime,
                    mirror=mirror,
                    operator=operator,
                )
        except KeyboardInterrupt:
            if not log_path.exists():
                raise
            messages.print(
                f"interrupted: the drive was commanded to stop; the log so far is {log_path}", soft_wrap=True
            )
            return EXIT_INTERRUPTED
        except Exception as error:
            raise _without_memory(error, "the drive was commanded to stop", log_path, folder) from error
    for path in reports:
        path.unlink(missing_ok=True)
    summary_json = _report(log_path, folder, messages)
    if summary_json is None:
        return EXIT_INTERRUPTED
    if as_json:
        print_json_text(summary_json)
    else:
        console = Terminal(soft_wrap=True)
        console.print(f"report: {folder / 'report.html'}")
        console.print(_result_line(result, len(json.loads(summary_json)["stops"])))
    _tell_slowness(result, config.loop.rate_hz, messages, virtual=virtual)
    return EXIT_OK if _went_well(result, duration_s) else EXIT_NO


def _connection(
    config: Config, clock: PacedClock | None, messages: Terminal, odometry_to: str | None, *, is_paced: bool
) -> AbstractContextManager[Operator | None]:
    """Return what connects a run with other programs; a simulated one only while its time is real."""
    if is_paced:
        return connected(config, clock, odometry_to)
    if odometry_to is not None or (config.ros2 is not None and config.ros2.commands):
        what = "ros2.commands" if odometry_to is None else "--odometry-to"
        raise ConfigError(f"{what}: other programs live in real time: add --realtime to --virtual")
    if config.ros2 is not None:
        messages.print("ROS 2 is not connected: add --realtime, and simulated time passes like real time")
    return nullcontext()


def _report(log_path: Path, folder: Path, messages: Terminal) -> str | None:
    """Write the report; returns the summary as JSON, or None after ctrl-C."""
    try:
        with messages.status("writing report"):
            return write_report(log_path, folder)
    except KeyboardInterrupt:
        messages.print(
            f"no report yet: `rover-hil replay {log_path} --out {folder}` writes it", soft_wrap=True
        )
        return None
    except Exception as error:
        raise _without_memory(error, "the drive has ended", log_path, folder) from error


def _without_memory(error: Exception, what: str, log_path: Path, folder: Path) -> Exception:
    """Return an error that is due to too little memory as one that says what to do with the log."""
    reason = sentence_of(error)
    if not reason or not log_path.exists():
        return error
    return ShortOfMemoryError(
        f"{reason}; {what}, and the log so far is {log_path}: with more memory "
        f"`rover-hil replay {log_path} --out {folder}` writes the report"
    )


def _display(live: Live, messages: Terminal, note: str) -> StatusDisplay:
    """Return what shows the state of a run; a note is printed once, when the run has begun."""
    notes = [note] if note else []

    def show(output: StepOutput) -> None:
        if notes:
            messages.print(notes.pop(), soft_wrap=True)
        if can_tell():  # a terminal that ctrl-S has stopped would hold the loop
            live.update(_status_line(output), refresh=True)

    return show


def _extended(config: Config, model: Path, messages: Terminal, *, virtual: bool) -> Config:
    if not virtual:
        raise ConfigError(f"{model}: --model is for the simulated rover: add --virtual")
    from rover_hil.drive.extended_simulation import extend_simulation

    simulation, changed_values = extend_simulation(config, model)
    for line in changed_values:
        messages.print(line)
    return config.model_copy(update={"simulation": simulation})


@contextmanager
def live_mirror(port: int | None, messages: Terminal) -> Iterator[Mirror | None]:
    """Give what streams records to viewers on a port, and say where it is; None without a port.

    Raises:
        ConfigError: The library is missing, or the port cannot be used.
    """
    if port is None:
        yield None
        return
    with LiveServer(port) as server:
        messages.print(f"live: open ws://{HOST}:{server.port} in Foxglove or Lichtblick")
        yield server.publish


def _result_line(result: RunResult, stops: int) -> str:
    parts = [result.reason, f"{result.duration_s:.1f} s"]
    if stops:
        parts.append(f"{stops} safety stop{'s' if stops > 1 else ''}")
    if result.watchdog_interventions:
        times = result.watchdog_interventions
        parts.append(f"{times} stop{'s' if times > 1 else ''} by the watchdog")
    if result.log_pause_s:
        parts.append(f"log not written for {result.log_pause_s:.1f} s")
    if result.skipped:
        parts.append(f"{result.skipped} of {result.cycles + result.skipped} cycles skipped")
    return ", ".join(parts)


def _tell_slowness(result: RunResult, rate_hz: float, messages: Terminal, *, virtual: bool) -> None:
    words = "" if virtual else too_slow(result, rate_hz)
    if words:
        messages.print(words, soft_wrap=True)


def too_slow(result: RunResult, rate_hz: float) -> str:
    """Return what to tell a user whose machine does not keep up with the loop; "" where it does."""
    due = result.cycles + result.skipped
    if result.skipped <= SLOW_SHARE * due:
        return ""
    return (
        f"this machine is too slow for loop.rate_hz = {rate_hz:g}, by a factor of {due / result.cycles:.2f}: "
        f"{result.skipped} of {due} cycles were skipped. Lower the rate, "
        "end other programs, or use --realtime"
    )


def _went_well(result: RunResult, duration_s: float | None) -> bool:
    if result.end is End.TIME_OVER:
        return duration_s is not None and result.mode is Mode.RUNNING
    return result.end in (End.FINISHED, End.STOPPED_BY_USER)


def _status_line(output: StepOutput) -> Text:
    estimate = output.estimate
    return Text(
        f"{output.mode.value:<15} x {estimate.x_m:+7.3f} m  y {estimate.y_m:+7.3f} m  "
        f"yaw {estimate.yaw_rad:+6.3f} rad  {output.reason}"
    )
