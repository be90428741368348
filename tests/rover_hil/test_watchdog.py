"""The watchdog stops the drive when the loop goes silent, once per silence."""

import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from controllers.control_loop import StepOutput
from controllers.safety import Mode
from drivers.clock import SystemClock, VirtualClock, nanoseconds
from drivers.driver import WheelDrive
from drivers.errors import LogError
from drivers.samples import Sample, SentCommand, WheelCommand
from rover_hil.config import load_config
from rover_hil.recording.data_files import collect_data_files, restore_config
from rover_hil.recording.reader import LogMessage, LogReader
from rover_hil.recording.writer import LogWriter
from rover_hil.run.composition import build_virtual_rig
from rover_hil.run.executive import Executive
from rover_hil.run.replay import replay
from rover_hil.run.watchdog import CHECK_PERIOD_S, Watchdog
from tests.drivers.test_driver import LetterCodec, ScriptedLink

LIMIT_NS = nanoseconds(0.15)
PATIENCE_S = 60.0
"""Only a thread that never runs needs as long, also on a busy machine."""


def make_drive(clock: VirtualClock | SystemClock) -> tuple[WheelDrive, ScriptedLink]:
    link = ScriptedLink()
    drive = WheelDrive("wheels", link, LetterCodec(), clock, max_age_s=0.1)
    drive.connect()
    return drive, link


def test_stops_once_per_silence_and_not_before_the_limit() -> None:
    clock = VirtualClock()
    drive, link = make_drive(clock)
    told: list[int] = []
    watchdog = Watchdog(drive, clock, LIMIT_NS, told.append)
    watchdog.feed()
    clock.sleep_until(clock.now_ns() + LIMIT_NS)
    watchdog.check()
    assert link.sent == []
    clock.sleep_until(clock.now_ns() + 1)
    watchdog.check()
    watchdog.check()
    assert link.sent == [b"(0.0, 0.0)"] * 3 + [b"off"]
    assert told == [clock.now_ns()]
    watchdog.feed()
    clock.sleep_until(clock.now_ns() + 2 * LIMIT_NS)
    watchdog.check()
    assert watchdog.interventions == 2


def test_the_limit_holds_from_the_start_on() -> None:
    clock = VirtualClock()
    drive, link = make_drive(clock)
    watchdog = Watchdog(drive, clock, LIMIT_NS, lambda _: None)
    clock.sleep_until(clock.now_ns() + LIMIT_NS)
    watchdog.check()
    assert link.sent == []
    clock.sleep_until(clock.now_ns() + 1)
    watchdog.check()
    assert link.sent[-1] == b"off"


def test_its_thread_has_a_name_and_keeps_no_program_alive() -> None:
    clock = SystemClock()
    drive, _ = make_drive(clock)
    watchdog = Watchdog(drive, clock, nanoseconds(60.0), lambda _: None)
    watchdog.start()
    (thread,) = [thread for thread in threading.enumerate() if thread.name == "watchdog"]
    assert thread.daemon
    assert CHECK_PERIOD_S == 0.02
    watchdog.end()
    assert not thread.is_alive()


def test_thread_acts_within_the_limit_and_a_check_period() -> None:
    clock = SystemClock()
    drive, link = make_drive(clock)
    acted = threading.Event()
    watchdog = Watchdog(drive, clock, nanoseconds(0.05), lambda _: acted.set())
    watchdog.start()
    assert acted.wait(PATIENCE_S)
    watchdog.end()
    assert link.sent[-1] == b"off"


def test_a_log_that_cannot_be_written_neither_keeps_it_from_stopping_nor_ends_it() -> None:
    clock = VirtualClock()
    drive, link = make_drive(clock)

    def no_space(t_ns: int) -> None:
        raise LogError("cannot write log")

    watchdog = Watchdog(drive, clock, LIMIT_NS, no_space)
    for stops in (1, 2):
        watchdog.feed()
        clock.sleep_until(clock.now_ns() + 2 * LIMIT_NS)
        watchdog.check()
        assert link.sent.count(b"off") == stops


def test_a_log_that_hangs_does_not_keep_it_from_stopping() -> None:
    clock = SystemClock()
    drive, link = make_drive(clock)
    is_asked, may_go_on = threading.Event(), threading.Event()

    def hang(t_ns: int) -> None:
        is_asked.set()
        may_go_on.wait(PATIENCE_S)

    watchdog = Watchdog(drive, clock, nanoseconds(0.05), hang)
    watchdog.start()
    assert is_asked.wait(PATIENCE_S)
    assert link.sent[-1] == b"off"
    may_go_on.set()
    watchdog.end()


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
def test_a_run_in_which_it_stopped_the_drive_replays_exactly(
    stalls: tuple[str, ...], reader: type[LogReader], tmp_path: Path
) -> None:
    config, clock, path = load_config("el-dorado"), VirtualClock(), tmp_path / "run.mcap"
    config_json = config.model_dump_json(by_alias=True).encode()
    with LogWriter(path, clock.now_ns(), config_json, collect_data_files(config), "virtual") as log:
        rig, _ = build_virtual_rig(config, clock, log)
        rig.connect(0.0)
        watchdog = Watchdog(rig.drive, clock, LIMIT_NS, lambda t_ns: log.write_json("/watchdog", t_ns, None))

        def stall() -> None:
            clock.sleep_until(clock.now_ns() + 2 * LIMIT_NS)
            watchdog.check()
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
            checking = threading.Thread(target=watchdog.check)
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
        executive = Executive(rig, log, config.loop.rate_hz, on_cycle=on_cycle, watchdog=watchdog)
        assert executive.run(2.5).watchdog_interventions == len(stalls)
        rig.close()
    recorded = reader(path)
    with restore_config(recorded) as restored:
        result = replay(recorded, restored, lambda: None)
    assert result.cycles > 90
    assert result.differences == []
