"""What a replay says beside the cycles: what made the log, missing cycles, and how the run ended."""

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from benchmarks.program.kernels import environment, runnable_kernels
from drivers.errors import LogError
from rover_hil.recording.made_with import BLAS_KERNEL, FACTS, PROGRAM, made_with
from rover_hil.recording.reader import LogMessage, LogReader
from rover_hil.run.recorded_cycles import RecordedCycles
from tests.rover_hil.command import Command
from tests.rover_hil.test_malformed_files import Message, RealLog, real, replay_file

__all__ = ["real"]


def cycle_places(messages: list[Message]) -> list[int]:
    return [place for place, message in enumerate(messages) if message[0] == "/cycle"]


def changed_end(messages: list[Message], **values: object) -> list[Message]:
    return [
        (topic, t_ns, json.dumps({**json.loads(data), **values}).encode() if topic == "/end" else data)
        for topic, t_ns, data in messages
    ]


@pytest.mark.parametrize("count", [1, 7])
def test_cycles_that_are_missing_between_others_are_refused(
    real: RealLog, tmp_path: Path, count: int
) -> None:
    places = cycle_places(real.messages)
    first, last = places[20], places[20 + count]
    path = real.write(tmp_path / "gap.mcap", real.messages[: first + 1] + real.messages[last + 1 :])
    with pytest.raises(LogError, match=r"cycles are missing or not in order after 0\.\d+ s"):
        replay_file(path)


def test_a_cycle_that_is_there_twice_is_refused(real: RealLog, tmp_path: Path) -> None:
    places = cycle_places(real.messages)
    again = real.messages[places[3] + 1 : places[4] + 1]
    messages = real.messages[: places[4] + 1] + again + real.messages[places[4] + 1 :]
    with pytest.raises(LogError, match="cycles are missing or not in order"):
        replay_file(real.write(tmp_path / "twice.mcap", messages))


@pytest.mark.parametrize("is_first", [True, False])
def test_cycles_that_are_missing_at_either_end_are_refused(
    real: RealLog, tmp_path: Path, is_first: bool
) -> None:
    places = cycle_places(real.messages)
    kept = (
        real.messages[places[2] + 1 :]
        if is_first
        else real.messages[: places[-3] + 1] + real.messages[places[-1] + 1 :]
    )
    with pytest.raises(LogError, match=r"its run had \d+ cycles, the log holds \d+"):
        replay_file(real.write(tmp_path / "short.mcap", kept))


def test_skipped_cycles_are_no_missing_ones(real: RealLog, tmp_path: Path) -> None:
    """A cycle that is 2.5 periods late skips two; the next one is on the grid again."""
    log = LogReader(real.write(tmp_path / "same.mcap"))
    cycles = RecordedCycles(log, 50.0)
    start_ns, period_ns = 10**9, 20_000_000
    for deadline, late_ns in ((1, 0), (2, 50_000_000), (5, 0), (6, 19_999_999), (7, 20_000_000), (9, 5)):
        t_ns = start_ns + deadline * period_ns + late_ns
        record = json.dumps({"late_ns": late_ns, "work_ns": 0}).encode()
        cycles.take(LogMessage("/cycle", t_ns, record))
    assert (cycles.count, cycles.skipped) == (6, 3)
    assert cycles.duration_s == pytest.approx(9 * 0.02 + 5e-9)


@pytest.mark.parametrize(
    ("changes", "fields"),
    [
        ({"end": "mission finished"}, ["end.end", "end.reason"]),
        ({"end": "emergency stop", "reason": "bumper", "mode": "emergency_stop"}, ["end.mode"]),
        ({"end": "emergency stop", "reason": "stopped on the page"}, []),
        ({"mode": "finished"}, ["end.mode"]),
        ({"reason": "time over in mode 'stopped'"}, ["end.reason"]),
        ({"skipped": 3}, ["end.skipped"]),
        ({"duration_s": 0.5}, ["end.duration_s"]),
        ({"cycles": 1}, ["end.cycles"]),
        ({"end": "stopped by user", "reason": "stopped by the user"}, []),
        ({}, []),
    ],
)
def test_a_run_that_ended_otherwise_is_different(
    real: RealLog, tmp_path: Path, changes: dict[str, object], fields: list[str]
) -> None:
    path = real.write(tmp_path / "end.mcap", changed_end(real.messages, **changes))
    result = replay_file(path)
    assert sorted(difference.field for difference in result.differences) == fields
    assert result.has_end


def without(*topics: str) -> Callable[[Message], bool]:
    return lambda message: message[0] not in topics


def test_a_log_without_its_end_is_told(real: RealLog, tmp_path: Path, command: Command) -> None:
    path = real.write(tmp_path / "open.mcap", list(filter(without("/end"), real.messages)))
    assert command("replay", str(path)) == 0
    assert "does not say how the run ended" in " ".join(command.out.split())
    assert command("replay", str(path), "--json") == 0
    assert json.loads(command.out)["log_is_complete"] is False


def test_set_points_that_are_missing_are_different(real: RealLog, tmp_path: Path) -> None:
    place = next(place for place, message in enumerate(real.messages) if message[0] == "/command")
    messages = real.messages[:place] + real.messages[place + 1 :]
    fields = {
        difference.field for difference in replay_file(real.write(tmp_path / "c.mcap", messages)).differences
    }
    assert "command" in fields


def made_elsewhere(real: RealLog, path: Path, **facts: str) -> Path:
    return real.write(path, metadata={**real.metadata, **made_with(), **facts})


def test_a_log_of_this_program_on_this_processor_needs_no_word(
    real: RealLog, tmp_path: Path, command: Command
) -> None:
    path = made_elsewhere(real, tmp_path / "here.mcap")
    assert LogReader(path).made_with == dict(made_with())
    assert set(made_with()) == set(FACTS)
    assert command("replay", str(path)) == 0
    assert command.out == "50 cycles replayed, every output identical\n"


def test_another_version_is_said_first_and_another_kernel_before_a_difference(
    real: RealLog, tmp_path: Path, command: Command
) -> None:
    facts = {PROGRAM: "0.0.9 (source 0123456789ab)", BLAS_KERNEL: "Katmai"}
    path = real.write(
        tmp_path / "other.mcap",
        changed_end(real.messages, skipped=3),
        None,
        {**real.metadata, **made_with(), **facts},
    )
    assert command("replay", str(path)) == 1
    lines = command.out.splitlines()
    assert lines[0] == (
        f"made with rover-hil 0.0.9 (source 0123456789ab), replayed with {made_with()[PROGRAM]}"
    )
    assert lines[1] == f"made with BLAS kernel Katmai, replayed with {made_with()[BLAS_KERNEL]}"
    assert "1 fields came out different" in lines[-1]
    assert command("replay", str(path), "--json") == 1
    found = json.loads(command.out)
    assert found["made_with"][BLAS_KERNEL] == "Katmai"
    assert found["replayed_with"] == dict(made_with())


@pytest.mark.slow
def test_a_replay_with_another_kernel_names_both_and_is_identical(real: RealLog, tmp_path: Path) -> None:
    path = made_elsewhere(real, tmp_path / "run.mcap")
    kernel = next((name for name in runnable_kernels() if name != made_with()[BLAS_KERNEL]), None)
    if kernel is None:
        pytest.skip("this processor runs one kernel of OpenBLAS only")
    done = subprocess.run(
        [sys.executable, "-c", "from rover_hil.app.program import main; main()", "replay", str(path)],
        env=environment(kernel),
        capture_output=True,
        text=True,
        check=False,
    )
    first = done.stdout.splitlines()[0]
    assert first == f"made with BLAS kernel {made_with()[BLAS_KERNEL]}, replayed with {kernel}"
    assert done.returncode == 0, done.stdout + done.stderr


def test_an_old_log_is_said_to_name_no_version(real: RealLog, tmp_path: Path, command: Command) -> None:
    metadata = {name: value for name, value in real.metadata.items() if name not in FACTS}
    command("replay", str(real.write(tmp_path / "old.mcap", metadata=metadata)))
    assert command.out.startswith(
        "made with a rover-hil that did not note its version in a log, replayed with "
    )


def test_third_party_facts_reach_the_terminal_as_one_line_without_control_characters(
    real: RealLog, tmp_path: Path, command: Command
) -> None:
    path = made_elsewhere(real, tmp_path / "stranger.mcap", numpy="\x1b[31m\n[bold]" * 10_000)
    assert command("replay", str(path)) == 0
    first, last = command.out.splitlines()
    assert first.startswith("made with numpy ?[31m?[bold]?[31m")
    assert len(first) < 600
    assert last == "50 cycles replayed, every output identical"


def test_a_log_of_version_1_is_refused(real: RealLog, tmp_path: Path) -> None:
    metadata = {**real.metadata, "schema": "rover-hil-log/1"}
    with pytest.raises(LogError, match="is not rover-hil-log/2"):
        LogReader(real.write(tmp_path / "old.mcap", metadata=metadata))
