"""Malformed files of `import` take neither the machine nor the results: a child with limits reads them."""

import os
import random
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.datasets.bad_files import Bad, arguments_of
from benchmarks.malformed import imports
from drivers.can_wheels.mapping_file import read_dbc
from drivers.errors import ConfigError, LogError, RoverHilError
from drivers.files import read_bytes
from rover_hil.drives.formats import reading_process
from rover_hil.drives.formats.limits import Limits, LimitSettings
from rover_hil.drives.formats.reading_process import Report, read_in_child
from tests.rover_hil.command import Command, assert_one_sentence

FILE = Path("drive.csv")
LIMITS = Limits(memory_bytes=200_000_000, silent_s=2.0, total_s=3.0, file_bytes=1_000_000)
SMALL = 1000
TAKERS = {
    "nested formats": (
        imports.of_bytes("", "flight", "drive.ulg", imports.nested_ulog),
        "more than 200,000 fields",
    ),
    "headers only": (
        imports.of_bytes("", "flight", "drive.ulg", lambda: imports.empty_ulog(20_000)),
        "messages are empty",
    ),
    "one cell": (
        imports.of_bytes("", "table", "drive.parquet", lambda: imports.parquet_cell(400_000_000)),
        "no arrays of numbers",
    ),
    "record": (imports.of_bytes("", "can", "drive.mf4", imports.mf4_record), "2,147,483,648 bytes"),
    "metadata": (Bad("", "bag", imports.long_metadata), "metadata.yaml has 16.0 MB"),
    "topics of mcap": (Bad("", "bag", lambda folder: imports.topics_in_mcap(folder, 5000)), "4,000 topics"),
    "topics of sqlite": (
        Bad("", "bag", lambda folder: imports.topics_in_sqlite(folder, 5000)),
        "4,000 topics",
    ),
    "topics of ROS 1": (Bad("", "bag", lambda folder: imports.topics_in_ros1(folder, 5000)), "4,000 topics"),
    "padded topics of ROS 1": (
        Bad("", "bag", lambda folder: imports.topics_in_ros1(folder, 5000, pad=bytes(5000))),
        "more than 4,096",
    ),
    "hidden topics of ROS 1": (
        Bad("", "bag", lambda folder: imports.topics_in_ros1(folder, 5000, pad=b"conn_count=" + bytes(4))),
        "4,000 topics",
    ),
    "compressed as a whole": (Bad("", "bag", imports.compressed_whole), "compressed as a whole"),
    "columns to guess": (
        imports.of_bytes("", "propose", "drive.csv", lambda: imports.many_columns(1000)),
        "1,000 columns",
    ),
    "columns": (
        imports.of_bytes("", "table", "drive.csv", lambda: imports.many_columns(20_000)),
        "10,000, the limit",
    ),
} | {
    f"list of {name}": (
        imports.of_bytes("", "can", "drive.mf4", lambda block=block: imports.mf4_list(block)),  # type: ignore[misc]
        "contains itself",
    )
    for name, block in imports.MF4_LISTS.items()
}


def run_child(work: Callable[[Report[int]], object], limits: Limits = LIMITS) -> object:
    return read_in_child(FILE, limits, work, nullcontext(lambda _: None))


def spin() -> None:
    while True:
        pass


@pytest.mark.parametrize("name", TAKERS)
def test_a_file_that_took_the_machine_is_one_sentence(command: Command, tmp_path: Path, name: str) -> None:
    bad, words = TAKERS[name]
    file = bad.write(tmp_path)
    before = sorted(tmp_path.iterdir())
    assert command(*arguments_of(bad, file, tmp_path)) == 2
    assert_one_sentence(command.error, file.stem, words)
    described = {tmp_path / f"{each}.toml" for each in ("rover", "columns", "topics")}
    assert set(tmp_path.iterdir()) - set(before) <= described


def test_the_result_and_the_progress_of_the_child_arrive() -> None:
    seen: list[int] = []

    def work(report: Report[int]) -> str:
        for number in range(2_000_000):
            report(number)
        return "done"

    assert read_in_child(FILE, LIMITS, work, nullcontext(seen.append)) == "done"
    assert seen == sorted(seen)


def test_too_much_memory_is_one_sentence_with_the_limit_and_the_option() -> None:
    with pytest.raises(RoverHilError, match=r"drive\.csv: .* 0\.20 GB .* --most-memory-gb"):
        run_child(lambda _: np.ones(50_000_000))


def test_too_much_processor_time_is_one_sentence_with_the_limit_and_the_option() -> None:
    with pytest.raises(LogError, match=r"drive\.csv: .* 1 s of processor time.* --most-minutes"):
        run_child(lambda _: spin(), replace(LIMITS, silent_s=1.0, total_s=1.0))


@pytest.mark.parametrize("number", [signal.SIGSEGV, signal.SIGABRT, signal.SIGKILL, signal.SIGTERM])
def test_a_child_that_dies_is_one_sentence(number: signal.Signals) -> None:
    with pytest.raises(LogError, match=number.name):
        run_child(lambda _: os.kill(os.getpid(), number))


def test_a_child_that_exits_is_one_sentence() -> None:
    with pytest.raises(LogError, match="without a result"):
        run_child(lambda _: os._exit(0))


def test_a_child_that_waits_for_ever_is_one_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reading_process, "MOST_IDLE_S", 1.0)
    with pytest.raises(LogError, match="did nothing"):
        run_child(lambda _: signal.pause())


def test_an_error_of_a_library_is_one_sentence_and_its_output_is_lost(
    capfd: pytest.CaptureFixture[str],
) -> None:
    def work(_: Report[int]) -> None:
        os.write(2, b"terminate called\n")
        sys.stderr.write("Traceback")
        raise KeyError("x")

    with pytest.raises(RoverHilError, match=r"KeyError in test_import_limits\.py line"):
        run_child(work)
    assert capfd.readouterr() == ("", "")


def test_an_error_of_ours_keeps_its_words() -> None:
    def work(_: Report[int]) -> None:
        raise LogError("line 3 is wrong")

    with pytest.raises(RoverHilError, match=r"^line 3 is wrong$"):
        run_child(work)


def test_no_child_is_left() -> None:
    child = run_child(lambda _: os.getpid())
    assert isinstance(child, int)
    assert not Path(f"/proc/{child}").exists()


@pytest.fixture
def temporary(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = tmp_path / "temporary"
    folder.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    return folder


def leave_a_file() -> None:
    with tempfile.NamedTemporaryFile(delete=False) as file:
        file.write(b"left")


@pytest.mark.parametrize("number", [None, signal.SIGKILL, signal.SIGABRT])
def test_no_temporary_file_of_the_child_is_left(temporary: Path, number: signal.Signals | None) -> None:
    def work(_: Report[int]) -> int:
        leave_a_file()
        if number is not None:
            os.kill(os.getpid(), number)
        return len(list(temporary.rglob("*")))

    if number is None:
        assert run_child(work) == 2
    else:
        with pytest.raises(LogError, match=number.name):
            run_child(work)
    assert not list(temporary.iterdir())


def test_an_imported_mf4_file_leaves_no_temporary_file(
    command: Command, tmp_path: Path, temporary: Path
) -> None:
    (tmp_path / "drive.mf4").write_bytes(imports.sound_mf4())
    bad = Bad("", "list", lambda folder: folder)
    assert command(*arguments_of(bad, tmp_path / "drive.mf4", tmp_path)) == 0
    assert not list(temporary.iterdir())


def test_a_file_without_end_is_one_sentence_with_the_limit(temporary: Path) -> None:
    def work(_: Report[int]) -> None:
        with tempfile.TemporaryFile() as file:
            for _megabyte in range(3):
                file.write(bytes(2**20))

    with pytest.raises(LogError, match=r"drive\.csv: .* 0\.00 GB of a file .* --most-memory-gb"):
        run_child(work)
    assert not list(temporary.iterdir())


def test_a_missing_temporary_folder_is_one_sentence(temporary: Path) -> None:
    temporary.rmdir()
    with pytest.raises(ConfigError, match="TMPDIR"):
        run_child(lambda _: None)


def test_limits_grow_with_the_size_and_the_options_set_them() -> None:
    limits = [LimitSettings().of_size(size) for size in (1000, 1_000_000, 20_000_000, 2_000_000_000)]
    assert [each.memory_bytes for each in limits] == sorted(each.memory_bytes for each in limits)
    assert [each.total_s for each in limits] == sorted(each.total_s for each in limits)
    assert limits[1].memory_bytes < 600e6
    assert limits[1].silent_s < 20.0
    assert LimitSettings().of_size(10**12).silent_s == LimitSettings().of_size(10**13).silent_s < 20_000.0
    chosen = LimitSettings(2.0, 3.0).of_size(1000)
    assert chosen == Limits(memory_bytes=2 * 10**9, silent_s=180.0, total_s=180.0, file_bytes=2 * 10**9)


def test_holes_and_second_names_of_a_file_raise_no_limit(tmp_path: Path) -> None:
    path = tmp_path / "drive.bag"
    with path.open("wb") as file:
        file.write(b"x")
        file.truncate(10**12)
    assert LimitSettings().of(path) == LimitSettings().of_size(2**20)
    path.write_bytes(b"x" * 100_000)
    alone = LimitSettings().of(tmp_path)
    assert alone == LimitSettings().of_size(100_000)
    (tmp_path / "second.bag").hardlink_to(path)
    assert LimitSettings().of(tmp_path) == alone
    whole = tmp_path / "whole.csv"
    with whole.open("wb") as file:
        os.posix_fallocate(file.fileno(), 0, 3_000_000)
    assert LimitSettings().of(whole) == LimitSettings().of_size(3_000_000)


DBC = 'VERSION ""\nBS_:\nBU_: A\nBO_ 1 M: {length} A\n SG_ S : 0|8@1+ (1,0) [0|0] "" A\n'
MULTIPLEXED = """ SG_ S0 M : 0|8@1+ (1,0) [0|0] "" A
 SG_ S1 m0 : 8|8@1+ (1,0) [0|0] "" A
SG_MUL_VAL_ 1 S1 S0 0-5000000;
"""


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (DBC.format(length=100_000_000), "100000000 bytes"),
        (DBC.format(length="// 8\n +100000000"), "100000000 bytes"),
        (DBC.format(length=8).replace("|8@", "| +100000000@"), "100000000 bits"),
        (DBC.format(length=8) + MULTIPLEXED, "SG_MUL_VAL_"),
    ],
)
def test_a_dbc_file_with_large_numbers_is_refused(tmp_path: Path, text: str, words: str) -> None:
    (tmp_path / "drive.dbc").write_text(text)
    with pytest.raises(ConfigError, match=rf"drive\.dbc: .*{words}"):
        read_dbc(tmp_path / "drive.dbc")


@pytest.mark.parametrize("length", [0, 8, 64, 1785])
def test_a_dbc_file_with_messages_of_any_bus_is_read(tmp_path: Path, length: int) -> None:
    remark = 'CM_ "BO_ 1 M: 100000000 A // SG_MUL_VAL_ 1 S1 S0 0-5000000;";\n'
    (tmp_path / "drive.dbc").write_text(DBC.format(length=length) + remark)
    assert read_dbc(tmp_path / "drive.dbc").messages[0].length == length


@pytest.mark.parametrize(
    ("kind", "reader"),
    [
        ("table", "table.command.read_columns"),
        ("bag", "rosbag.command.read_topics"),
        ("can", "can.command.rover_of_log"),
        ("list", "can.command.read_dbc"),
    ],
)
def test_what_describes_a_drive_is_read_in_a_child(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str, reader: str
) -> None:
    def read(*_: object) -> None:
        raise ConfigError(f"process {os.getpid()}")

    monkeypatch.setattr(f"rover_hil.drives.formats.{reader}", read)
    arguments = arguments_of(Bad("", kind, lambda folder: folder), tmp_path / "drive.log", tmp_path)
    assert command(*arguments, *(["--dbc", "drive.dbc"] if kind == "list" else [])) == 2
    assert_one_sentence(command.error, "process")
    assert str(os.getpid()) not in command.error


def test_a_file_at_the_standard_input_is_read(tmp_path: Path) -> None:
    file = tmp_path / "drive.csv"
    file.write_text("t,l,r\n0,1,2\n")
    with file.open("rb") as stream:
        kept = os.dup(0)
        os.dup2(stream.fileno(), 0)
        try:
            content = run_child(lambda _: read_bytes(Path("/dev/stdin"), 100))
        finally:
            os.dup2(kept, 0)
            os.close(kept)
    assert content == file.read_bytes()


def test_a_pickle_is_refused_without_advice_to_load_it(command: Command, tmp_path: Path) -> None:
    for name in ("drive.npy", "drive.npz"):
        save = np.save if name.endswith("npy") else np.savez
        save(tmp_path / name, np.array([{}, 1], object))
        bad = Bad("", "table", lambda folder: folder)
        assert command(*arguments_of(bad, tmp_path / name, tmp_path)) == 2
        assert_one_sentence(command.error, name, "Python objects")
        assert "allow_pickle" not in command.error


@pytest.mark.parametrize("suffix", [".csv", ".npz", ".log", ".mf4", ".ulg", ".bag", ".mcap"])
def test_a_mutated_file_is_imported_or_one_sentence(command: Command, tmp_path: Path, suffix: str) -> None:
    kinds, make = imports.SOUND[suffix]
    file = tmp_path / f"drive{suffix}"
    file.write_bytes(imports.mutated(make(), random.Random(suffix)))
    bad = Bad("", kinds[0], lambda folder: folder)
    code = command(*arguments_of(bad, file, tmp_path))
    assert code in (0, 2)
    if code == 2:
        assert_one_sentence(command.error, "drive")


def long_drive(tmp_path: Path) -> list[str]:
    """Write a sound table that takes minutes; return the command that imports it, over an earlier log."""
    rows = [f"{0.05 * n:.2f},{0.25 * n:.3f},{0.275 * n:.3f}" for n in range(40_000)]
    (tmp_path / "drive.csv").write_text("\n".join(["t,l,r", *rows]))
    (tmp_path / "out.mcap").write_text("earlier")
    command = arguments_of(Bad("", "table", lambda folder: folder), tmp_path / "drive.csv", tmp_path)
    return [*command, "--force"]


def child_of(process: int) -> int:
    """Return the child of a process once it has one."""
    children = Path(f"/proc/{process}/task/{process}/children")
    while not (numbers := children.read_text().split()):
        pass
    return int(numbers[0])


def is_alive(process: int) -> bool:
    try:
        state = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0]
    except OSError:
        return False
    return state != "Z"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("number", "target", "code", "words"),
    [
        (signal.SIGINT, "program", 130, "interrupted by ctrl-C"),
        (signal.SIGTERM, "program", 143, "ended by SIGTERM"),
        (signal.SIGKILL, "child", 2, "SIGKILL"),
        (signal.SIGKILL, "program", -9, ""),
    ],
)
def test_an_interrupted_import_leaves_no_process_and_no_part(
    tmp_path: Path, number: signal.Signals, target: str, code: int, words: str
) -> None:
    command = long_drive(tmp_path)
    before = sorted(path.name for path in tmp_path.iterdir())
    program = [sys.executable, "-c", "from rover_hil.app.program import main; main()", *command]
    with subprocess.Popen(program, stderr=subprocess.PIPE, text=True) as process:
        child = child_of(process.pid)
        os.kill(child if target == "child" else process.pid, number)
        _, error = process.communicate(timeout=60)
    assert process.returncode == code
    assert words in error
    assert "Traceback" not in error
    while is_alive(child):
        pass
    if code != -9:
        assert sorted(path.name for path in tmp_path.iterdir()) == before
    assert (tmp_path / "out.mcap").read_text() == "earlier"
