"""Run one case in real time as two processes, over pseudo-terminals and slcan, and judge it."""

import os
import re
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.safety.faults.cases import Case
from benchmarks.safety.faults.measures import Row, add_truth, check_replay, judge, read_story
from benchmarks.safety.faults.process_cases import ROLL_OUT_S, ProcessCase
from benchmarks.safety.faults.runs import rover_config, run_length_s
from drivers.clock import SystemClock, nanoseconds, seconds
from drivers.errors import LogError

CONFIGS = Path(__file__).parents[3] / "rover_hil" / "config" / "shipped" / "configs"
CAMERA = re.compile(r"^camera = .*\n|^rig = .*\n|^\[devices\.camera\]\n(?:.+\n)+", re.MULTILINE)
FOLDERS = re.compile(r"(?<![\w.])/(?:[\w.@+-]+/)+")
"""Of this machine; names of files are kept."""
REST_RAD_S = 0.05
MOVE_LIMIT_S = 90.0
START_UP_S = 15.0
REPORT_S = 60.0
CLOCK = SystemClock()


def measure_processes(case: Case) -> Row:
    """Run a case and return its row."""
    with tempfile.TemporaryDirectory() as folder_name:
        folder = Path(folder_name)
        text = (CONFIGS / f"{case.rover}.toml").read_text()
        (folder / "rover.toml").write_text(with_safety(CAMERA.sub("", text), case))
        with _simulator(case, folder) as simulator, _program(case, folder) as program:
            try:
                begin_ns = _wait_for_begin(folder, program)
            except TimeoutError as error:
                row = Row(case.rover, case.device, case.fault, "two processes", case.duty.value)
                row.failures.append(str(error))
                return row
            if isinstance(case, ProcessCase):
                _act(case, program, simulator, folder, begin_ns)
            with suppress(subprocess.TimeoutExpired):
                program.wait(START_UP_S + 2 * run_length_s(rover_config(case), case) + REPORT_S)
            CLOCK.sleep_until(CLOCK.now_ns() + nanoseconds(2 * ROLL_OUT_S))  # the wheels come to rest
        return _judge(case, folder, begin_ns, program.poll())


def with_safety(text: str, case: Case) -> str:
    """Return a configuration with the keys of [safety] of a case."""
    keys = "".join(f"{key} = {value}\n" for key, value in case.safety.items())
    if "\n[safety]\n" in text:
        return text.replace("\n[safety]\n", f"\n[safety]\n{keys}")
    return f"{text}\n[safety]\n{keys}"


@contextmanager
def _simulator(case: Case, folder: Path) -> Iterator[subprocess.Popen[bytes]]:
    command = [sys.executable, "-m", "benchmarks.safety.faults.server", case.title, "truth.txt"]
    process = subprocess.Popen(command, cwd=folder, env=_environment())
    try:
        _wait((folder / "truth.txt").exists, process)
        yield process
    finally:
        process.send_signal(signal.SIGCONT)
        process.terminate()
        process.wait()


@contextmanager
def _program(case: Case, folder: Path) -> Iterator[subprocess.Popen[bytes]]:
    length_s = START_UP_S + run_length_s(rover_config(case), case)
    command = [sys.executable, "-m", "benchmarks.safety.faults.hanging_program", "run", "rover.toml"]
    command += ["--duration", f"{length_s:g}", "--out", "out"]
    with (folder / "said.txt").open("wb") as said:
        process = subprocess.Popen(command, cwd=folder, env=_environment(), stdout=said, stderr=said)
        try:
            yield process
        finally:
            if process.poll() is None:
                process.kill()
                process.wait()


def _environment() -> dict[str, str]:
    return {**os.environ, "PYTHONPATH": str(Path(__file__).parents[3]), "COLUMNS": "400"}


def _wait_for_begin(folder: Path, program: subprocess.Popen[bytes]) -> int:
    """Return when the fault begins, and not before."""

    def begin_ns() -> int:
        lines = (folder / "truth.txt").read_text().splitlines()[-2:]
        return int(lines[0].split()[1]) if len(lines) == 2 else -1

    _wait(lambda: begin_ns() > 0, program)
    found_ns = begin_ns()
    CLOCK.sleep_until(found_ns)
    return found_ns


def _wait(is_done: Callable[[], bool], process: subprocess.Popen[bytes]) -> None:
    end_ns = CLOCK.now_ns() + nanoseconds(MOVE_LIMIT_S)
    while not is_done():
        if process.poll() is not None or CLOCK.now_ns() > end_ns:
            raise TimeoutError(f"the rover did not move; exit code {process.poll()}")
        CLOCK.sleep_until(CLOCK.now_ns() + nanoseconds(0.05))


def _act(
    case: ProcessCase,
    program: subprocess.Popen[bytes],
    simulator: subprocess.Popen[bytes],
    folder: Path,
    begin_ns: int,
) -> None:
    case.begin(program.pid, simulator.pid, folder)
    if case.end is not None:
        CLOCK.sleep_until(begin_ns + nanoseconds(case.duration_s))
        case.end(program.pid, simulator.pid, folder)
    elif case.exit_code is None:
        CLOCK.sleep_until(begin_ns + nanoseconds(4.0))


def _judge(case: Case, folder: Path, begin_ns: int, exit_code: int | None) -> Row:
    truth = _load(folder)
    said = _last_line((folder / "said.txt").read_text(errors="replace"))
    path = folder / "out" / "run.mcap"
    row = Row(case.rover, case.device, case.fault, "two processes", case.duty.value, why=case.why)
    if path.exists():
        try:
            story = read_story(path, case.device)
            story.truth = [(int(t_ns), x, y, yaw) for t_ns, _, x, y, yaw, _ in truth.tolist()]
            add_truth(story)
            row = judge(case, story, rover_config(case), begin_ns, "two processes")
        except LogError as error:
            row.failures.append(str(error))
        check_replay(row, path)
    if isinstance(case, ProcessCase):
        _judge_process(case, row, truth, begin_ns, exit_code, said)
    return row


def _load(folder: Path) -> NDArray[np.float64]:
    lines = (folder / "truth.txt").read_text().splitlines()[:-1]
    return np.array([[float(word) for word in line.split()] for line in lines])


def _last_line(text: str) -> str:
    lines = [line for line in re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", text).splitlines() if line.strip()]
    return FOLDERS.sub("", " / ".join(line.strip() for line in lines[-2:]))


def _judge_process(
    case: ProcessCase,
    row: Row,
    truth: NDArray[np.float64],
    begin_ns: int,
    exit_code: int | None,
    said: str,
) -> None:
    """Fill in what the wheels really did, and what the program said."""
    after = truth[truth[:, 0] >= begin_ns]
    is_at_rest = after[:, 5] < REST_RAD_S
    first_at_rest = int(np.argmax(is_at_rest)) if is_at_rest.any() else len(after) - 1
    row.stop_s = round(seconds(int(after[first_at_rest, 0]) - begin_ns), 2) if is_at_rest.any() else None
    row.driven_m = round(float(np.hypot(*np.diff(after[: first_at_rest + 1, 2:4], axis=0).T).sum()), 3)
    row.message = f"[exit {exit_code}] {said}"
    row.failures = [failure for failure in row.failures if not failure.startswith("ended before")]
    if case.rest_bar_s is not None and (row.stop_s is None or row.stop_s > case.rest_bar_s):
        row.failures.append(f"wheels at rest after {row.stop_s} s, bar {case.rest_bar_s:.2f} s")
    if case.exit_code is not None and exit_code != case.exit_code:
        row.failures.append(f"exit code {exit_code}, not {case.exit_code}")
    if case.said not in said:
        row.failures.append(f"does not say {case.said!r}")
