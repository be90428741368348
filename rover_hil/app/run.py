"""`rover-hil run`: put the rover together, run the loop, write log, summary and report."""

import gc
import json
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, closing, contextmanager, nullcontext
from pathlib import Path

from rich.live import Live
from rich.text import Text

from controllers.control_loop import StepOutput
from controllers.safety import Mode
from drivers.clock import PacedClock, SystemClock, VirtualClock, wall_time_text
from drivers.device_settings import DriveSettings
from drivers.emergency_stop import EmergencyStop
from drivers.errors import ConfigError, NotConnectedError
from rover_hil.app.drive import order_drive
from rover_hil.app.exit_codes import EXIT_INTERRUPTED, EXIT_NO, EXIT_OK, exit_terminated, exit_unfinished
from rover_hil.app.json_text import print_json_text
from rover_hil.app.memory import ShortOfMemoryError, sentence_of
from rover_hil.app.options import LOG_NAME
from rover_hil.app.output import can_tell, tell
from rover_hil.config import Config, load_config
from rover_hil.connect.connections import connected
from rover_hil.live.server import HOST, LiveServer
from rover_hil.pages.atomic_write import refuse_overwrite, unfinished
from rover_hil.recording.data_files import collect_data_files
from rover_hil.recording.schema import END, end_record
from rover_hil.recording.watchdog_note import note_path
from rover_hil.recording.writer import LogWriter, Mirror
from rover_hil.report.write import REPORT_NAME, SUMMARY_NAME, write_report
from rover_hil.run.checks import RUN_CHECKS, VIRTUAL_RUN_CHECKS
from rover_hil.run.composition import build_real_rig, build_virtual_rig
from rover_hil.run.drive_order import DriveOrder
from rover_hil.run.end_signals import EndRequest, held_signals
from rover_hil.run.excitation import for_real_rover
from rover_hil.run.executive import End, Executive, Operator, RunResult, end_by
from rover_hil.run.linear_algebra import allocate_linear_algebra
from rover_hil.run.real_time import enter_realtime
from rover_hil.run.watchdog_process import WatchdogProcess
from rover_hil.terminal import Terminal
from sim_backends.world.plant import Truth

CONNECT_TIMEOUT_S = 2.0
REALTIME_SPIN_S = 0.0006
SLOW_SHARE = 0.02
"""Of the cycles of a real run; with more skipped the user is told."""

StatusDisplay = Callable[[StepOutput], None]


def run_rover(
    config_name: str,
    *,
    virtual: bool,
    duration_s: float | None,
    out: Path | None,
    realtime: bool,
    as_json: bool,
    model: Path | None = None,
    force: bool = False,
    live_port: int | None = None,
    odometry_to: str | None = None,
) -> int:
    """Run a rover and write its results; returns the exit code.

    With `force` the results of an earlier run in the same folder are replaced, once this one begins. With
    `live_port` the records are also streamed to viewers on that port, with `odometry_to` a record of each
    cycle is sent to that host and port.

    Raises:
        RoverHilError: Bad configuration, a device that cannot be opened, a folder that cannot be used.
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
        live_mirror(live_port, messages) as mirror,
        connection as operator,
        Live(console=messages, transient=True, auto_refresh=False) as live,
    ):
        show = _display(live, messages, note)

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
    from rover_hil.app.extended_simulation import extend_simulation

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


def run_virtual(
    config: Config,
    log_path: Path,
    limit_s: float,
    show: StatusDisplay | None,
    mirror: Mirror | None = None,
    *,
    clock: VirtualClock | None = None,
    operator: Operator | None = None,
) -> RunResult:
    """Run the simulated rover of `config` on simulated time, into the log `log_path`.

    Args:
        config: A configuration with a mission and a simulation.
        log_path: Replaced where it exists, once the run begins.
        limit_s: End after this much simulated time.
        show: Called about ten times per second of real time, or None.
        mirror: Gets each record of the log too, or None.
        clock: None for simulated time that runs as fast as it can.
        operator: Operates the run, or None.

    Raises:
        ConfigError: The simulation is missing or does not fit the devices.
    """
    clock = clock or VirtualClock()
    with held_signals() as request, ExitStack() as resources:
        allocate_linear_algebra()
        with unfinished(log_path) as part:
            log = resources.enter_context(
                _open_log(part, log_path, config, clock.now_ns(), "virtual", mirror)
            )
            rig, world = build_virtual_rig(config, clock, log)

            def record_truth(now_ns: int) -> Truth:
                truth = world.plant.truth()
                log.truth(now_ns, truth)
                return truth

            request.obey()
            rig.connect(CONNECT_TIMEOUT_S)
            resources.enter_context(closing(rig))
            executive = Executive(
                rig,
                log,
                config.loop.rate_hz,
                on_cycle=record_truth,
                on_status=show,
                operator=operator,
                end_request=request,
            )
        _log_mission_path(log, config, clock.now_ns())
        note_path(log_path).unlink(missing_ok=True)  # of an earlier run
        return _execute(executive, log, limit_s, request)


def run_real(
    config: Config,
    log_path: Path,
    limit_s: float,
    show: StatusDisplay | None,
    *,
    order: DriveOrder,
    realtime: bool = False,
    mirror: Mirror | None = None,
    operator: Operator | None = None,
) -> RunResult:
    """Run the rover of `config` on its real ports, into the log `log_path`, and say which one moves.

    Args:
        config: As for `run_virtual`, like those that are not named here.
        log_path: As there.
        limit_s: End after this time.
        show: As there.
        order: The order to move this rover.
        realtime: Use the SCHED_FIFO scheduler.
        mirror: As there.
        operator: As there.

    Raises:
        ConfigError: The user has no right to use the scheduler.
        WatchdogError: The watchdog cannot be started, or cannot open the port of the drive.
        NotConnectedError: A device cannot be opened.
        KeyboardInterrupt: Ctrl-C came before the drive was opened.
        Terminated: Another signal came before.
    """
    clock = SystemClock(REALTIME_SPIN_S if realtime else 0.0)
    if realtime:
        enter_realtime()
    with held_signals() as request, ExitStack() as resources:
        allocate_linear_algebra()
        with unfinished(log_path) as part:
            log = resources.enter_context(_open_log(part, log_path, config, clock.now_ns(), "real", mirror))
            rig = build_real_rig(config, clock, log)
            watchdog = resources.enter_context(
                WatchdogProcess(_stop_of(config), config.safety.expiry_s, note_path(log_path))
            )
            request.obey()
            try:
                rig.connect(CONNECT_TIMEOUT_S)
            except NotConnectedError as error:
                raise NotConnectedError(
                    f"{error}; `rover-hil doctor` reports more, `rover-hil simulate` serves a simulated rover"
                ) from error
            resources.enter_context(closing(rig))
            watchdog.check_port()
            executive = Executive(
                rig,
                log,
                config.loop.rate_hz,
                on_status=show,
                watchdog=watchdog,
                operator=operator,
                end_request=request,
            )
            request.obey()
        tell(f"moving {order.rover}")  # a standard error that is lost ends no run
        _log_mission_path(log, config, clock.now_ns())
        gc.collect()
        gc.freeze()  # what start-up made need not be looked at again in every collection
        watchdog.arm()
        try:
            return _execute(executive, log, limit_s, request)
        finally:
            watchdog.close()


def _stop_of(config: Config) -> EmergencyStop:
    """Return how another process stops the drive of `config`."""
    drive = config.devices[config.roles.wheels]
    if not isinstance(drive, DriveSettings):
        raise ConfigError(f"device '{config.roles.wheels}' turns no wheels")
    return drive.make_emergency_stop()


def require_uninterrupted(result: RunResult) -> None:
    """Go on only where nobody ended a drive: what follows must not move the rover again.

    Raises:
        KeyboardInterrupt: The drive ended by ctrl-C.
        SystemExit: The program was to end, or the terminal was lost.
    """
    if result.end is End.STOPPED_BY_USER:
        raise KeyboardInterrupt
    if result.end is End.TERMINATED:
        exit_terminated(result.reason)


def require_finished(result: RunResult, drive: str) -> None:
    """Go on only where a drive was completed: what follows moves the rover again.

    Args:
        result: Of the drive.
        drive: Its name.

    Raises:
        KeyboardInterrupt: The drive ended by ctrl-C.
        SystemExit: It ended in another way before its time, e.g. with an emergency stop.
    """
    require_uninterrupted(result)
    if result.end is not End.FINISHED:
        exit_unfinished(f"the drive {drive} was not completed, the rover stays at rest: {result.reason}")


def _open_log(
    part: Path, path: Path, config: Config, start_ns: int, origin: str, mirror: Mirror | None
) -> LogWriter:
    """Return a log that is written to `part`, which becomes `path` when the run begins."""
    config_json = config.model_dump_json(by_alias=True).encode()
    data_files = collect_data_files(config)
    try:
        return LogWriter(part, start_ns, config_json, data_files, origin, final_path=path, mirror=mirror)
    except OSError as error:
        raise ConfigError(f"cannot write {path}: {error.strerror}; choose another --out") from error


def _log_mission_path(log: LogWriter, config: Config, t_ns: int) -> None:
    if config.mission is not None:
        log.path(t_ns, config.mission.corners())


def _execute(executive: Executive, log: LogWriter, limit_s: float, request: EndRequest) -> RunResult:
    result = executive.run(limit_s)
    if request.number is not None and (result.end, result.reason) == end_by(request.number):
        request.answer()
    log.write_json(END, executive.now_ns(), end_record(result))
    return result


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
        f"{result.skipped} of {due} cycles were skipped. Lower the rate, end other programs, or use "
        "--realtime"
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
