"""`rover-hil import ... --no-estimate` only converts; `replay` then makes the estimate of an import."""

import json
from pathlib import Path

import pytest

from drivers.clock import seconds
from rover_hil.recording.reader import LogMessage, LogReader
from rover_hil.recording.schema import CYCLE, ESTIMATE, IMPORT, SAMPLES, VIEW
from tests.rover_hil.command import Command, assert_one_sentence

DRIVES = {
    "table": ("table", "table.csv", "--columns", "columns.toml"),
    "bag": ("rosbag", "first_rosbag2", "--topics", "topics.toml"),
    "can": ("can", "drive.log", "--config", "el-dorado"),
    "robotino": ("robotino", "exp00.csv"),
}


def messages(path: Path) -> list[LogMessage]:
    return [each for each in LogReader(path).messages() if each.topic != IMPORT]


def contents(path: Path) -> list[tuple[int, str, bytes]]:
    """Return what is in a log; in a cycle, the order of bytes and copied records is free."""
    return sorted((each.t_ns, each.topic, each.data) for each in messages(path))


def import_it(command: Command, kind: str, out: str, *options: str) -> None:
    assert command("import", *DRIVES[kind], "--out", out, *options) == 0, command.error


@pytest.mark.parametrize("kind", DRIVES)
def test_a_replay_makes_the_estimate_of_an_import(command: Command, kind: str) -> None:
    assert command("sample", kind) == 0, command.error
    import_it(command, kind, "converted/drive.mcap", "--no-estimate")
    assert "no estimate was made" in command.out
    topics = {each.topic for each in messages(Path("converted/drive.mcap"))}
    assert {SAMPLES, CYCLE} <= topics
    assert not [topic for topic in topics if topic == ESTIMATE or topic.startswith(VIEW)]
    assert command("replay", "converted/drive.mcap", "--out", "estimated") == 0, command.error
    assert "cycles estimated: estimated/drive.mcap" in command.out
    assert Path("estimated/report.html").exists()
    import_it(command, kind, "imported.mcap")
    assert contents(Path("estimated/drive.mcap")) == contents(Path("imported.mcap"))
    assert command("replay", "estimated/drive.mcap") == 0
    assert "every output identical" in command.out


def test_what_a_log_without_an_estimate_lacks_is_reported(command: Command) -> None:
    command("sample", "table")
    import_it(command, "table", "drive.mcap", "--no-estimate", "--json")
    (record,) = json.loads(command.out)
    assert record["has_estimate"] is False
    assert not record["findings"]
    assert not record["doubts"]
    log = LogReader(Path("drive.mcap"))
    times_ns = [each.t_ns for each in log.messages() if each.topic == CYCLE]
    assert record["duration_s"] == pytest.approx(seconds(times_ns[-1] - log.start_ns), abs=0.1)
    import_it(command, "table", "with.mcap", "--json")
    (with_estimate,) = json.loads(command.out)
    assert with_estimate["has_estimate"] is True
    assert with_estimate["used"] == record["used"]


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        (("replay", "drive.mcap"), "imported without an estimate"),
        (("replay", "drive.mcap", "--out", "."), "would replace"),
        (("compare", "drive.mcap", "drive.mcap", "--out", "compared"), "holds no estimate"),
    ],
)
def test_a_log_without_an_estimate_is_refused_with_the_command_that_makes_it(
    command: Command, arguments: tuple[str, ...], reason: str
) -> None:
    command("sample", "table")
    import_it(command, "table", "drive.mcap", "--no-estimate")
    before = Path("drive.mcap").read_bytes()
    assert command(*arguments) == 2
    assert reason in command.error
    assert "--out" in command.error
    assert_one_sentence(command.error)
    assert Path("drive.mcap").read_bytes() == before
