"""What surrounds a run of `rover-hil run`: other programs, viewers, the line of the state, the report."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from pathlib import Path
from typing import Any

from rich.live import Live
from rich.text import Text

from controllers.control_loop import StepOutput
from controllers.safety import Mode
from controllers.unwatched_yaw import find_unwatched_yaw
from drivers.clock import PacedClock, nanoseconds, seconds
from drivers.driver import DeviceState, Health
from drivers.errors import ConfigError
from rover_hil.config import Config
from rover_hil.connect.connections import connected
from rover_hil.console.memory import ShortOfMemoryError, sentence_of
from rover_hil.console.output import can_tell
from rover_hil.live.server import HOST, LiveServer
from rover_hil.recording.writer import Mirror
from rover_hil.report.compensation import Compensation
from rover_hil.report.write import write_report
from rover_hil.run.driving import StatusDisplay
from rover_hil.run.executive import End, Operator, RunResult
from rover_hil.terminal import Terminal

SLOW_SHARE = 0.02
"""Of the cycles of a real run; with more skipped a warning is shown."""
FIRST_SAMPLE_NS = nanoseconds(2.0)
"""A device that has just been opened sends its first sample within this time."""


def connection(
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


def report(log_path: Path, folder: Path, messages: Terminal) -> str | None:
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
        raise without_memory(error, "the drive has ended", log_path, folder) from error


def without_memory(error: Exception, what: str, log_path: Path, folder: Path) -> Exception:
    """Return an error that is due to too little memory as one that says what to do with the log."""
    reason = sentence_of(error)
    if not reason or not log_path.exists():
        return error
    return ShortOfMemoryError(
        f"{reason}; {what}, and the log so far is {log_path}: with more memory "
        f"`rover-hil replay {log_path} --out {folder}` writes the report"
    )


class LostDevices:
    """Notes since when each device has sent nothing."""

    def __init__(self) -> None:
        self._start_ns: int | None = None
        self._since_ns: dict[str, int] = {}

    def lines(self, output: StepOutput, healths: Sequence[Health]) -> list[str]:
        """Return one line for each lost device that does not stop the rover, whose reason is shown anyway."""
        self._start_ns = output.t_ns if self._start_ns is None else self._start_ns
        told = []
        for health in healths:
            if health.state is DeviceState.STREAMING:
                self._since_ns.pop(health.device, None)
                continue
            since_ns = self._since_ns.setdefault(health.device, output.t_ns)
            is_starting = health.age_s is None and output.t_ns - self._start_ns < FIRST_SAMPLE_NS
            if health.device not in output.reason and not is_starting:
                since_s = seconds(since_ns - self._start_ns)
                told.append(f"warning: {health.device} lost since {since_s:.0f} s of the run")
        return told


def display(live: Live, messages: Terminal, config: Config, *begin_notes: str) -> StatusDisplay:
    """Return what shows the state of a run.

    Once, when it has begun, notes are printed, what is assumed about the ground, and that nothing would
    notice a wrong yaw. At the end of the check manoeuvre its result is printed, one line for each source.
    """
    unwatched = find_unwatched_yaw(config, config.device_roles())
    notes = [*filter(None, (*begin_notes, config.ground.words, str(unwatched or "")))][::-1]
    lost = LostDevices()

    def show(output: StepOutput, healths: Sequence[Health]) -> None:
        while notes:
            messages.print(notes.pop(), soft_wrap=True)
        for check in output.checks or ():
            messages.print(f"check manoeuvre: {check.text}", soft_wrap=True)
        lines = [_status_line(output), *map(Text, lost.lines(output, healths))]
        if can_tell():  # a terminal that ctrl-S has stopped would hold the loop
            live.update(Text("\n").join(lines), refresh=True)

    return show


def extended(config: Config, model: Path, messages: Terminal, *, virtual: bool) -> Config:
    """Return the configuration of a simulated rover with the effects of a model; says what they change."""
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


def result_line(result: RunResult, stops: int) -> str:
    """Return how a run ended, in one line."""
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


def end_text(result: RunResult, folder: Path, summary: Mapping[str, Any]) -> str:
    """Return where the report is, what slip compensation has changed and cost, and how the run ended."""
    lines = [f"report: {folder / 'report.html'}"]
    if values := summary["compensation"]:
        changed = Compensation(**values)
        lines.append(
            f"slip compensation: path changed by {1e3 * changed.moved_m:.0f} mm (rms), {changed.words}"
        )
    return "\n".join([*lines, result_line(result, len(summary["stops"]))])


def tell_slowness(result: RunResult, rate_hz: float, messages: Terminal, *, virtual: bool) -> None:
    """Warn the user of a real rover when the machine did not keep up with the loop."""
    words = "" if virtual else too_slow(result, rate_hz)
    if words:
        messages.print(words, soft_wrap=True)


def too_slow(result: RunResult, rate_hz: float) -> str:
    """Return the message for a user whose machine does not keep up with the loop; "" where it does."""
    due = result.cycles + result.skipped
    if result.skipped <= SLOW_SHARE * due:
        return ""
    return (
        f"this machine is too slow for loop.rate_hz = {rate_hz:g}, by a factor of {due / result.cycles:.2f}: "
        f"{result.skipped} of {due} cycles were skipped. Lower the rate, "
        "end other programs, or use --realtime"
    )


def went_well(result: RunResult, duration_s: float | None) -> bool:
    """Return whether the run ended as asked: mission finished, user's end, or time limit while driving."""
    if result.end is End.TIME_OVER:
        return duration_s is not None and result.mode is Mode.RUNNING
    return result.end in (End.FINISHED, End.STOPPED_BY_USER)


def _status_line(output: StepOutput) -> Text:
    estimate = output.estimate
    warning = f"warning: {output.suspicion}" if output.suspicion else ""
    return Text(
        f"{output.mode.value:<15} x {estimate.x_m:+7.3f} m  y {estimate.y_m:+7.3f} m  "
        f"yaw {estimate.yaw_rad:+6.3f} rad  {output.reason or warning}"
    )
