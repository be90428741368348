"""What each drive does when the loop is stuck, stopped or gone, as two processes in real time.

    python -m benchmarks.safety.hung_loop [--rover NAME] [--case NAME] [--times N]
    python -m benchmarks.safety.hung_loop --healthy N      # ends of healthy runs on a loaded machine
    python -m benchmarks.safety.hung_loop --healthy N --loaded   # the same where other programs load it
    python -m benchmarks.safety.hung_loop --starts N       # processes left behind

Stuck: a library sleeps with the interpreter's lock held. Out of memory: the loop gets no more than it has.
Swapped: the kernel takes its memory away, again and again, and gives it back page by page from a file; needs
root and the memory controller of cgroups, version 1. The simulated rover is a process of its own, behind
serial ports and slcan, and writes down how fast its wheels really turn. Exit code 1 where a bar is missed.
"""

import argparse
import ctypes
import os
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, nullcontext, suppress
from itertools import pairwise
from pathlib import Path
from timeit import repeat

from benchmarks.program.machine_load import loaded_machine
from benchmarks.safety.faults.process_cases import ROLL_OUT_S, fill_memory
from benchmarks.safety.faults.processes import CAMERA, CONFIGS, REST_RAD_S
from benchmarks.safety.faults.server import serve
from drivers.clock import SystemClock, nanoseconds, seconds
from drivers.emergency_stop import EmergencyStop, PortKind, StopPort
from drivers.errors import LogError
from rover_hil.app.program import main as run_program
from rover_hil.config import load_config
from rover_hil.recording.reader import LogReader
from rover_hil.run.watchdog_process import WatchdogProcess

ROOT = Path(__file__).parents[2]
EXAMPLES = ROOT / "docs" / "examples"
ROVERS = {
    "Robotino, board EA05": CONFIGS / "robotino.toml",
    "Robotino 3, board EA09": EXAMPLES / "robotino3_board.toml",
    "CAN by DBC": CONFIGS / "el-dorado.toml",
    "ODrive": CONFIGS / "el-dorado.toml",
    "steered CAN wheels": CONFIGS / "el-dorado-crab.toml",
    "CANopen": EXAMPLES / "canopen_wheels.toml",
    "VESC": EXAMPLES / "vesc.toml",
}
MAPPINGS = {"ODrive": "odrive_0_6"}
"""Used instead of the configuration's own."""
STUCK_FILE = "stuck"
STUCK_S = 600
BAR_S = 0.3
SLOWER = 0.9
"""A wheel below this share of its speed slows down: it was commanded to, or its drive has given up."""
WAIT_S = 300.0
SWAPPED = "swapped"
SWAP_BYTES = 1 << 30
KEPT_BYTES = 1 << 22
CASE_S = 4.0
MOST_TRIES = 5
UNWRITTEN_S = 0.6
"""So much of the log's end is lost where a loop is killed (benchmarks/results/program.md)."""
LAST_LINES = 3
STALL_S = 0.15
"""The simulator writes its wheels' speed every 0.01 s."""
MEMORY_GROUP = Path(f"/sys/fs/cgroup/memory/rover_hil_hung_loop_{os.getpid()}")
COST_BAR_US = 10.0
CLOCK = SystemClock()


def get_stuck() -> None:
    """Wait for the file, then sleep in C without giving the interpreter's lock back."""
    while not Path(STUCK_FILE).exists():
        CLOCK.sleep_until(CLOCK.now_ns() + nanoseconds(0.01))
    ctypes.PyDLL(None).sleep(STUCK_S)


def stick(program: int, folder: Path) -> None:
    """Let the program get stuck."""
    (folder / STUCK_FILE).touch()


def send(number: signal.Signals) -> Callable[[int, Path], None]:
    """Return the deed of sending a signal."""
    return lambda program, _: os.kill(program, number)


def swap_out(program: int, folder: Path) -> None:
    """Take all that the kernel can take of the loop's memory, again and again for the time of a case."""
    end_ns = CLOCK.now_ns() + nanoseconds(CASE_S)
    while CLOCK.now_ns() < end_ns:
        with suppress(OSError):  # busy: the rest was in use
            (MEMORY_GROUP / "memory.limit_in_bytes").write_text(str(KEPT_BYTES))
        CLOCK.sleep_until(CLOCK.now_ns() + nanoseconds(0.05))


CASES: dict[str, Callable[[int, Path], None]] = {
    "stuck in C": stick,
    "stopped": send(signal.SIGSTOP),
    "killed": send(signal.SIGKILL),
    "out of memory": lambda program, folder: fill_memory(program, 0, folder),
    SWAPPED: swap_out,
}
MAY_DRIVE_ON = ("out of memory", SWAPPED)


@contextmanager
def swapping() -> Iterator[None]:
    """Give a file for swapping, and a group of processes whose memory can be limited."""
    with tempfile.NamedTemporaryFile() as file:
        os.posix_fallocate(file.fileno(), 0, SWAP_BYTES)
        subprocess.run(["/sbin/mkswap", file.name], check=True, stdout=subprocess.DEVNULL)
        subprocess.run(["/sbin/swapon", file.name], check=True)
        try:
            MEMORY_GROUP.mkdir()
            try:
                yield
            finally:
                wait_for(
                    lambda: not (MEMORY_GROUP / "cgroup.procs").read_text(), "a process of the loop is left"
                )
                MEMORY_GROUP.rmdir()
        finally:
            subprocess.run(["/sbin/swapoff", file.name], check=True)


@contextmanager
def started(folder: Path, *command: str, group: Path | None = None) -> "Iterator[subprocess.Popen[bytes]]":
    """Run one of the two processes, in a group of processes where one is given."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "COLUMNS": "400"}
    join = [] if group is None else ["/bin/sh", "-c", f'echo $$ > {group / "cgroup.procs"}; exec "$@"', "sh"]
    with (folder / f"{command[1]}.txt").open("wb") as said:
        process = subprocess.Popen(
            [*join, sys.executable, "-m", *command], cwd=folder, env=environment, stdout=said, stderr=said
        )
        try:
            yield process
        finally:
            with suppress(ProcessLookupError):
                process.send_signal(signal.SIGCONT)
            process.terminate()
            with suppress(subprocess.TimeoutExpired):
                process.wait(10.0)
            process.kill()
            process.wait()


def wait_for(is_done: Callable[[], bool], what: str) -> None:
    """Wait for a condition."""
    deadline_ns = CLOCK.now_ns() + nanoseconds(WAIT_S)
    while not is_done():
        if CLOCK.now_ns() > deadline_ns:
            raise TimeoutError(what)
        CLOCK.sleep_until(CLOCK.now_ns() + nanoseconds(0.02))


def speeds(folder: Path) -> list[tuple[int, float]]:
    """Return time and speed of the fastest wheel, by the simulated rover."""
    lines = (folder / "truth.txt").read_text().splitlines()[:-1]
    return [(int(words[0]), float(words[5])) for words in map(str.split, lines)]


@contextmanager
def driving(name: str, folder: Path, group: Path | None = None) -> "Iterator[subprocess.Popen[bytes]]":
    """Give the process of a loop that drives its simulated rover."""
    text = CAMERA.sub("", ROVERS[name].read_text())
    (folder / "rover.toml").write_text(text.replace("generic_wheel", MAPPINGS.get(name, "generic_wheel")))
    itself = "benchmarks.safety.hung_loop"
    with started(folder, itself, "--serve"):
        wait_for((folder / "truth.txt").exists, "the simulated rover does not begin")
        with started(folder, itself, "--loop", "run", "rover.toml", "--out", "out", group=group) as program:
            wait_for(lambda: moves(folder) or program.poll() is not None, "the rover does not move")
            yield program


def moves(folder: Path) -> bool:
    """Return whether the wheels have turned for half a second."""
    last = [speed for _, speed in speeds(folder)[-50:]]
    return len(last) == 50 and min(last) > 4 * REST_RAD_S


def measure(name: str, case: str) -> tuple[bool, str]:
    """Return whether a case is within its bar, and its row; tried again where nothing could be measured."""
    for _ in range(MOST_TRIES):
        measured = measure_once(name, case)
        if measured is not None:
            return measured
    return False, f"| {name} | {case} | not measured in {MOST_TRIES} tries: other programs load the machine |"


def measure_once(name: str, case: str) -> tuple[bool, str] | None:
    """Return whether a case is within its bar, and its row; None where it could not be measured."""
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        group = None
        if case == SWAPPED:
            stack.enter_context(swapping())
            group = MEMORY_GROUP
        with driving(name, folder, group) as program:
            before = max(speed for _, speed in speeds(folder)[-5:])
            if before < 4 * REST_RAD_S or program.poll() is not None:
                print(f"{name}, {case}: not measured, the rover had stopped by itself", flush=True)
                return None
            act_ns = CLOCK.now_ns()
            behind_s = seconds(act_ns - speeds(folder)[-1][0])
            CASES[case](program.pid, folder)
            CLOCK.sleep_until(act_ns + nanoseconds(CASE_S))
            after = [(t_ns, speed) for t_ns, speed in speeds(folder) if t_ns > act_ns]
            exit_code = program.poll()
            if group is not None:
                (group / "memory.limit_in_bytes").write_text("-1")
        said = (folder / "--loop.txt").read_text(errors="replace")
        cycles_ns = readable_cycles_ns(folder / "out" / "run.mcap.part", folder / "out" / "run.mcap")
    late_s = max(behind_s, *(seconds(later[0] - earlier[0]) for earlier, later in pairwise(after)))
    if late_s > STALL_S:
        print(f"{name}, {case}: not measured, the simulator itself was {late_s:.2f} s late", flush=True)
        return None
    slower_s = first_s(after, act_ns, SLOWER * before)
    rest_s = first_s(after, act_ns, REST_RAD_S)
    lines = [line.strip() for line in said.splitlines() if line.strip()]
    told = next((line for line in lines if "watchdog:" in line), "")
    if case in MAY_DRIVE_ON:
        silence_s = longest_drive_without_a_loop_s(cycles_ns, after, SLOWER * before)
        if exit_code is not None and exit_code >= 0:  # the loop ended by itself, and says why
            told = f"exit {exit_code}: {' '.join(lines[-LAST_LINES:])}"
        unwritten_s = UNWRITTEN_S if exit_code is not None and exit_code < 0 else 0.0
        is_well = silence_s <= BAR_S + unwritten_s and (exit_code is None or bool(told))
        told = f"{silence_s:.2f} s of driving without a cycle in the log {told}"
    else:
        is_well = slower_s is not None and slower_s <= BAR_S and rest_s is not None
        is_well &= rest_s is None or rest_s <= BAR_S + ROLL_OUT_S
        is_well &= case == "stopped" or bool(told)
    is_well &= bool(cycles_ns)
    return is_well, f"| {name} | {case} | {text(slower_s)} | {text(rest_s)} | {len(cycles_ns)} | {told} |"


def longest_drive_without_a_loop_s(
    cycles_ns: list[int], after: list[tuple[int, float]], limit: float
) -> float:
    """Return for how long the wheels went on at most, at their speed, while the loop made no cycle."""
    longest_s = 0.0
    for begin_ns, end_ns in pairwise([*cycles_ns, after[-1][0]]):
        if end_ns > after[0][0]:
            in_silence = [row for row in after if begin_ns < row[0] < end_ns]
            slower_s = first_s(in_silence, begin_ns, limit)
            longest_s = max(longest_s, seconds(end_ns - begin_ns) if slower_s is None else slower_s)
    return longest_s


def first_s(after: list[tuple[int, float]], act_ns: int, limit: float) -> float | None:
    """Return when the fastest wheel was below a limit for good; None where it never was."""
    above = [t_ns for t_ns, speed in after if speed >= limit]
    if not above:
        return 0.0
    return None if above[-1] == after[-1][0] else seconds(above[-1] - act_ns)


def text(value: float | None) -> str:
    return "never" if value is None else f"{value:.2f}"


def readable_cycles_ns(*paths: Path) -> list[int]:
    """Return the times of the cycles that the log has."""
    for path in paths:
        if path.exists():
            with suppress(LogError):
                return [item.t_ns for item in LogReader(path).messages() if item.topic == "/estimate"]
    return []


def cost_us() -> float:
    """Return what the watchdog costs in a cycle."""
    with tempfile.NamedTemporaryFile() as port:
        stop = EmergencyStop(StopPort(PortKind.SERIAL, port.name, 115_200), (b"stop",))
        with WatchdogProcess(stop, 600.0) as watchdog:

            def cycle() -> None:
                watchdog.has_stopped_drive()
                watchdog.stop_reason(CLOCK.now_ns())
                watchdog.feed()

            return 1e6 * min(repeat(cycle, number=2000, repeat=20)) / 2000


def count_ends(times: int, *, is_loaded: bool) -> int:
    """Drive healthy rovers on a loaded machine; return how many were ended or stopped by the watchdog."""
    ends = 0
    start_ns = CLOCK.now_ns()
    for number in range(times):
        load = nullcontext() if is_loaded else loaded_machine()
        with tempfile.TemporaryDirectory() as folder_name, load:
            folder = Path(folder_name)
            name = list(ROVERS)[number % len(ROVERS)]
            with driving(name, folder) as program:
                program.wait(WAIT_S)
            said = (folder / "--loop.txt").read_text(errors="replace")
            told = [line.strip() for line in said.splitlines() if "watchdog" in line]
            ends += program.returncode < 0
            elapsed_s = seconds(CLOCK.now_ns() - start_ns)
            print(
                f"{name}: exit {program.returncode}; {told or 'no word of the watchdog'}; load "
                f"{os.getloadavg()[0]:.0f}; {elapsed_s:.0f} s so far",
                flush=True,
            )
    return ends


LIFE = """
import os, signal, sys
from drivers.emergency_stop import EmergencyStop, PortKind, StopPort
from rover_hil.run.watchdog_process import WatchdogProcess
stop = EmergencyStop(StopPort(PortKind.SERIAL, sys.argv[1], 115200), (b"stop",))
with WatchdogProcess(stop, 0.1) as watchdog:
    watchdog.check_port()
    watchdog.arm()
    end = sys.argv[2]
    if end == "loop killed":
        os.kill(os.getpid(), signal.SIGKILL)
    if end == "watchdog killed":
        os.kill(watchdog._process.pid, signal.SIGKILL)
    if end == "error":
        raise SystemExit(1)
"""
ENDS = ("by itself", "loop killed", "watchdog killed", "error")


def count_left(starts: int) -> int:
    """Start and end loops with a watchdog in each way; return how many of their processes are left."""
    with tempfile.NamedTemporaryFile() as port:
        for number in range(starts):
            end = ENDS[number % len(ENDS)]
            command = [sys.executable, "-c", LIFE, port.name, end]
            subprocess.run(command, check=False, cwd=ROOT, stderr=subprocess.DEVNULL)
        CLOCK.sleep_until(CLOCK.now_ns() + nanoseconds(1.0))
        commands = [path.read_bytes() for path in Path("/proc").glob("[0-9]*/cmdline") if path.exists()]
        left = sum(port.name.encode() in command for command in commands)
    print(f"{starts} starts and ends, {', '.join(ENDS)} in turn: {left} processes left")
    return left


def main() -> int:
    if sys.argv[1:2] == ["--serve"]:
        signal.signal(signal.SIGTERM, signal.default_int_handler)
        with suppress(KeyboardInterrupt):
            serve(load_config("rover.toml"), Path("truth.txt"))
        return 0
    if sys.argv[1:2] == ["--loop"]:
        del sys.argv[1]
        threading.Thread(target=get_stuck, daemon=True).start()
        run_program()
        return 0
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rover", choices=ROVERS)
    parser.add_argument("--case", choices=CASES)
    parser.add_argument("--times", type=int, default=1)
    parser.add_argument("--healthy", type=int, default=0)
    parser.add_argument("--loaded", action="store_true", help="add no load: other programs are running")
    parser.add_argument("--starts", type=int, default=0)
    options = parser.parse_args()
    if options.starts:
        return 1 if count_left(options.starts) else 0
    if options.healthy:
        return 1 if count_ends(options.healthy, is_loaded=options.loaded) else 0
    cost = cost_us()
    print(f"in the loop {cost:.1f} us a cycle, bar {COST_BAR_US:g} us")
    print("| drive | loop | wheels slow down after s | at rest after s | cycles in the log | reported |")
    print("|---|---|---|---|---|---|")
    missed = cost > COST_BAR_US
    for name in [options.rover] if options.rover else ROVERS:
        for case in [options.case] if options.case else CASES:
            for _ in range(options.times):
                is_well, row = measure(name, case)
                print(row if is_well else f"{row} MISSED", flush=True)
                missed |= not is_well
    return int(missed)


if __name__ == "__main__":
    sys.exit(main())
