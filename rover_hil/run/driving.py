"""Drive a rover into a log: the simulated one on simulated time, the real one on its ports."""

import gc
import math
from collections.abc import Callable, Sequence
from contextlib import ExitStack, closing
from pathlib import Path

from controllers.control_loop import StepOutput
from drivers.clock import SystemClock, VirtualClock
from drivers.device_settings import DriveSettings
from drivers.driver import Health
from drivers.emergency_stop import EmergencyStop
from drivers.errors import ConfigError, NotConnectedError
from rover_hil.config import Config
from rover_hil.console.exit_codes import exit_terminated, exit_unfinished
from rover_hil.console.output import tell
from rover_hil.pages.atomic_write import unfinished
from rover_hil.recording.data_files import collect_data_files
from rover_hil.recording.schema import END, end_record
from rover_hil.recording.watchdog_note import note_path
from rover_hil.recording.writer import LogWriter, Mirror
from rover_hil.run.check_manoeuvre import without_check_manoeuvre
from rover_hil.run.composition import build_real_rig, build_virtual_rig
from rover_hil.run.drive_order import DriveOrder
from rover_hil.run.end_signals import EndRequest, held_signals
from rover_hil.run.executive import End, Executive, Operator, RunResult, end_by
from rover_hil.run.linear_algebra import allocate_linear_algebra
from rover_hil.run.real_time import enter_realtime
from rover_hil.run.watchdog_process import WatchdogProcess
from sim_backends.world.plant import Truth

CONNECT_TIMEOUT_S = 2.0
REALTIME_SPIN_S = 0.0006

StatusDisplay = Callable[[StepOutput, Sequence[Health]], None]


def run_virtual(
    config: Config,
    log_path: Path,
    limit_s: float,
    show: StatusDisplay | None,
    mirror: Mirror | None = None,
    *,
    clock: VirtualClock | None = None,
    operator: Operator | None = None,
    longest_stop_s: float = math.inf,
    check_manoeuvre: bool = False,
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
        longest_stop_s: End also when a reason has kept the rover stopped for this long.
        check_manoeuvre: The room for the check manoeuvre is confirmed, so that it is driven where the
            configuration wants it.

    Raises:
        ConfigError: The simulation is missing or does not fit the devices.
    """
    clock = clock or VirtualClock()
    config = config if check_manoeuvre else without_check_manoeuvre(config)
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
                longest_stop_s=longest_stop_s,
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
    longest_stop_s: float = math.inf,
    check_manoeuvre: bool = False,
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
        longest_stop_s: As there.
        check_manoeuvre: As there.

    Raises:
        ConfigError: The user has no right to use the scheduler.
        WatchdogError: The watchdog cannot be started, or cannot open the port of the drive.
        NotConnectedError: A device cannot be opened.
        KeyboardInterrupt: Ctrl-C came before the drive was opened.
        Terminated: Another signal came before.
    """
    clock = SystemClock(REALTIME_SPIN_S if realtime else 0.0)
    config = config if check_manoeuvre else without_check_manoeuvre(config)
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
                longest_stop_s=longest_stop_s,
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
