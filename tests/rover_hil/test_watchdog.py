"""A loop whose drive the watchdog stopped, or that has none, goes on safely, and its log replays exactly."""

import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from controllers.control_loop import StepOutput
from controllers.operator import OperatorInput
from controllers.safety import Mode
from drivers.clock import VirtualClock, nanoseconds
from drivers.samples import Sample, SentCommand, WheelCommand
from rover_hil.config import load_config
from rover_hil.recording.data_files import collect_data_files, restore_config
from rover_hil.recording.reader import LogMessage, LogReader
from rover_hil.recording.writer import LogWriter
from rover_hil.run.composition import build_virtual_rig
from rover_hil.run.executive import CycleView, End, Executive, RunResult
from rover_hil.run.replay import replay

LIMIT_NS = nanoseconds(0.15)
PATIENCE_S = 60.0
"""Only a thread that never runs needs as long, also on a busy machine."""
LOST = "watchdog: its process has ended with code -9"
PAGE_LOST = "page: lost"


@dataclass
class ScriptedWatchdog:
    """A watchdog that does what a test says, by the number of heartbeats it got.

    Attributes:
        stops: Stops of the drive after so many heartbeats.
        lost: Whether it lives no longer, after so many heartbeats.
    """

    stops: tuple[int, ...] = ()
    lost: range = range(0)
    signs: int = 0
    waits: int = 0
    told: list[int] = field(default_factory=list)

    def feed(self) -> None:
        self.signs += 1

    def note_waiting(self) -> None:
        self.waits += 1

    def has_stopped_drive(self) -> bool:
        return self.signs in self.stops

    def stop_reason(self, now_ns: int) -> str:
        self.told.append(now_ns)
        return LOST if self.signs in self.lost else ""


class ScriptedPage:
    """A page that is lost for some cycles, and wants nothing else."""

    def __init__(self, lost: range) -> None:
        self._lost = lost
        self._cycle = -1

    def wanted(self) -> OperatorInput | None:
        self._cycle += 1
        if self._cycle == self._lost.start:
            return OperatorInput(stop_reason=PAGE_LOST)
        return OperatorInput(stop_reason="") if self._cycle == self._lost.stop else None

    def end(self) -> tuple[End, str] | None:
        return None

    def show(self, view: CycleView) -> None:
        """Show nothing."""


def drive(
    path: Path, watchdog: ScriptedWatchdog, duration_s: float, page: ScriptedPage | None = None
) -> tuple[RunResult, list[tuple[Mode, str]]]:
    """Drive the simulated rover into a log; return the result, and mode and reason of each cycle."""
    config, clock = load_config("el-dorado"), VirtualClock()
    config_json = config.model_dump_json(by_alias=True).encode()
    seen: list[tuple[Mode, str]] = []
    with LogWriter(path, clock.now_ns(), config_json, collect_data_files(config), "virtual") as log:
        rig, _ = build_virtual_rig(config, clock, log)
        rig.connect(0.0)
        step_now: Callable[[int, list[Sample]], StepOutput] = rig.loop.step

        def step(now_ns: int, samples: list[Sample]) -> StepOutput:
            output = step_now(now_ns, samples)
            seen.append((output.mode, output.reason))
            return output

        rig.loop.step = step  # type: ignore[method-assign, assignment]
        executive = Executive(rig, log, config.loop.rate_hz, watchdog=watchdog, operator=page)
        assert log.on_wait == watchdog.note_waiting
        result = executive.run(duration_s)
        rig.close()
    recorded = LogReader(path)
    with restore_config(recorded) as restored:
        assert replay(recorded, restored, lambda: None).differences == []
    return result, seen


@pytest.mark.slow
def test_after_a_stop_by_the_watchdog_the_drive_is_started_again_and_the_log_replays(tmp_path: Path) -> None:
    watchdog = ScriptedWatchdog(stops=(80, 90))
    result, seen = drive(tmp_path / "run.mcap", watchdog, 2.5)
    assert result.watchdog_interventions == 2
    assert watchdog.signs == result.cycles == len(watchdog.told)
    stops_ns = [
        message.t_ns
        for message in LogReader(tmp_path / "run.mcap").messages()
        if message.topic == "/watchdog"
    ]
    assert len(stops_ns) == 2
    assert seen[-1][0] is Mode.RUNNING


@pytest.mark.slow
def test_without_a_watchdog_the_rover_rests_and_goes_on_with_a_new_one(tmp_path: Path) -> None:
    _, seen = drive(tmp_path / "run.mcap", ScriptedWatchdog(lost=range(80, 90)), 3.0)
    assert seen[79] == (Mode.RUNNING, "")
    assert seen[80] == seen[89] == (Mode.SAFE_STOP, LOST)
    assert seen[-1][0] is Mode.RUNNING


@pytest.mark.slow
def test_a_new_watchdog_does_not_let_the_rover_go_that_the_page_stops(tmp_path: Path) -> None:
    page = ScriptedPage(range(85, 100))
    _, seen = drive(tmp_path / "run.mcap", ScriptedWatchdog(lost=range(80, 90)), 3.0, page)
    assert [reason for _, reason in seen[80:100]] == [LOST] * 10 + [PAGE_LOST] * 10
    assert seen[-1][0] is Mode.RUNNING


@pytest.mark.slow
def test_a_page_that_is_back_does_not_let_the_rover_go_without_a_watchdog(tmp_path: Path) -> None:
    page = ScriptedPage(range(75, 85))
    _, seen = drive(tmp_path / "run.mcap", ScriptedWatchdog(lost=range(80, 90)), 3.0, page)
    assert [reason for _, reason in seen[75:90]] == [PAGE_LOST] * 5 + [LOST] * 10
    assert seen[-1][0] is Mode.RUNNING


class LateStops(LogReader):
    """A log in which a stop by the watchdog was written after the cycle before whose command it came."""

    def messages(self) -> Iterator[LogMessage]:
        """Yield them late."""
        every = list(super().messages())
        stops_ns = {message.t_ns for message in every if message.topic == "/watchdog"}
        late: list[LogMessage] = []
        for message in every:
            if message.topic.startswith(("/sent/", "/watchdog")) and message.t_ns in stops_ns:
                late.append(message)
                continue
            yield message
            if message.topic == "/cycle":
                yield from late
                late.clear()


@pytest.mark.parametrize("reader", [LogReader, LateStops])
@pytest.mark.parametrize(
    "stalls",
    [
        ("in the step",),
        ("while logging",),
        ("in the step", "while logging"),
        ("in the step, stopped after the command",),
    ],
)
@pytest.mark.slow
def test_a_run_of_an_earlier_version_in_which_it_stopped_the_drive_replays_exactly(
    stalls: tuple[str, ...], reader: type[LogReader], tmp_path: Path
) -> None:
    config, clock, path = load_config("el-dorado"), VirtualClock(), tmp_path / "run.mcap"
    config_json = config.model_dump_json(by_alias=True).encode()
    with LogWriter(path, clock.now_ns(), config_json, collect_data_files(config), "virtual") as log:
        rig, _ = build_virtual_rig(config, clock, log)
        rig.connect(0.0)

        def stop_by_thread() -> None:
            """Stop the drive as the watchdog of earlier versions did, which was a thread."""
            log.write_json("/watchdog", rig.drive.stop(), None)

        def stall() -> None:
            clock.sleep_until(clock.now_ns() + 2 * LIMIT_NS)
            stop_by_thread()
            clock.sleep_until(clock.now_ns() + 1000)

        def command_before_the_stop() -> None:
            """Let the loop send its command between the check and the stop of the watchdog."""
            clock.sleep_until(clock.now_ns() + 2 * LIMIT_NS)
            is_checked, may_stop = threading.Event(), threading.Event()
            stop_now, command_now = rig.drive.stop, rig.drive.command

            def stop() -> int:
                is_checked.set()
                assert may_stop.wait(PATIENCE_S)
                return stop_now()

            def command(speeds: WheelCommand) -> SentCommand:
                clock.sleep_until(clock.now_ns() + 1000)
                sent = command_now(speeds)
                clock.sleep_until(clock.now_ns() + 1000)
                may_stop.set()
                checking.join()
                clock.sleep_until(clock.now_ns() + 1000)
                rig.drive.stop, rig.drive.command = stop_now, command_now  # type: ignore[method-assign]
                return sent

            rig.drive.stop, rig.drive.command = stop, command  # type: ignore[method-assign, assignment]
            checking = threading.Thread(target=stop_by_thread)
            checking.start()
            assert is_checked.wait(PATIENCE_S)

        step_now: Callable[[int, list[Sample]], StepOutput] = rig.loop.step
        steps = 0

        def step(now_ns: int, samples: list[Sample]) -> StepOutput:
            nonlocal steps
            steps += 1
            output = step_now(now_ns, samples)
            if steps == 90 and stalls[0].startswith("in the step"):
                assert output.mode is Mode.RUNNING
                (stall if stalls[0] == "in the step" else command_before_the_stop)()
            return output

        def on_cycle(now_ns: int) -> None:
            if steps == 90 and "while logging" in stalls:
                stall()

        rig.loop.step = step  # type: ignore[method-assign, assignment]
        executive = Executive(rig, log, config.loop.rate_hz, on_cycle=on_cycle)
        executive.run(2.5)
        rig.close()
    recorded = reader(path)
    with restore_config(recorded) as restored:
        result = replay(recorded, restored, lambda: None)
    assert result.cycles > 90
    assert result.differences == []
