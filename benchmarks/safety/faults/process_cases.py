"""Faults of the program, its disk and its memory; and which device faults are run in real time."""

import os
import resource
import shutil
import signal
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from benchmarks.safety.faults.cases import Case, Duty, all_cases

REAL_TIME_FAULTS = ("unplug", "freeze", "stall", "garbage", "valid flood")
HANG_FILE = "hang"
HUNG_FILE = "hung"
"""Left by a program whose log really hung."""
LOG_PAUSE_S = 2.0
"""So long a rover may drive on with a log that hangs."""
ROLL_OUT_S = 0.6
"""From zero setpoints to wheels at rest, delays of command and motor included."""

Act = Callable[[int, int, Path], None]
"""From the ids of the program and of the simulator, and their folder, to the deed."""


@dataclass(frozen=True, kw_only=True)
class ProcessCase(Case):
    """A fault of the program.

    Attributes:
        begin: What is done to it.
        end: What is done after `duration_s`; None where nothing can be.
        rest_bar_s: The true wheels must be at rest this long after the fault; None where none must.
        exit_code: With which code the program must end; None where it was killed.
        said: What the last lines of its output must contain.
    """

    begin: Act
    end: Act | None = None
    rest_bar_s: float | None
    exit_code: int | None = 0
    said: str = ""


def send(number: signal.Signals, *, to_simulator: bool = False) -> Act:
    """Return the deed of sending a signal."""
    return lambda program, simulator, _: os.kill(simulator if to_simulator else program, number)


def fill_disk(program: int, simulator: int, folder: Path) -> None:
    """Let no file of the program grow: what a full disk does to the log."""
    size = (folder / "out" / "run.mcap").stat().st_size
    resource.prlimit(program, resource.RLIMIT_FSIZE, (size, size))


def fill_memory(program: int, simulator: int, folder: Path) -> None:
    """Let the program get no more memory than it has."""
    pages = int(Path(f"/proc/{program}/statm").read_text().split()[0])
    size = pages * resource.getpagesize()
    resource.prlimit(program, resource.RLIMIT_AS, (size, size))


def delete_output(program: int, simulator: int, folder: Path) -> None:
    """Delete the folder of the log."""
    shutil.rmtree(folder / "out")


def hang(program: int, simulator: int, folder: Path) -> None:
    """Let every write of the log hang."""
    (folder / HANG_FILE).touch()


def end_hang(program: int, simulator: int, folder: Path) -> None:
    """Let the log be written again."""
    (folder / HANG_FILE).unlink()
    (folder / HUNG_FILE).unlink()


DRIVE_WATCHDOG_S = {"robotino": 1.04, "el-dorado": 0.2}


def process_cases() -> list[ProcessCase]:
    """Return the faults of the program, which run in real time only."""
    return [case for rover in DRIVE_WATCHDOG_S for case in _of(rover)]


def _of(rover: str) -> list[ProcessCase]:
    watchdog_s = DRIVE_WATCHDOG_S[rover]

    def case(fault: str, begin: Act, rest_bar_s: float | None, **settings: object) -> ProcessCase:
        return ProcessCase(
            **{  # type: ignore[arg-type]
                "rover": rover,
                "device": "program",
                "fault": fault,
                "duty": Duty.HONEST,
                "begin": begin,
                "rest_bar_s": rest_bar_s,
            }
            | settings
        )

    resume, own = send(signal.SIGCONT), watchdog_s + ROLL_OUT_S
    return [
        case("stopped 1 s", send(signal.SIGSTOP), None, end=resume),
        case("stopped 3 s", send(signal.SIGSTOP), own, end=resume, duration_s=3.0),
        case(
            "all devices silent 1 s",
            send(signal.SIGSTOP, to_simulator=True),
            None,
            end=send(signal.SIGCONT, to_simulator=True),
        ),
        case("killed", send(signal.SIGKILL), own, exit_code=None),
        case("SIGTERM", send(signal.SIGTERM), 0.15 + ROLL_OUT_S, exit_code=1, said="SIGTERM"),
        # A thread of the log writes: the loop drives on.
        case("log hangs 1 s", hang, None, end=end_hang),
        case(
            "log hangs 5 s",
            hang,
            LOG_PAUSE_S + 0.25 + ROLL_OUT_S,
            end=end_hang,
            duration_s=5.0,
            said="log not written for",
        ),
        case("disk full", fill_disk, 0.25 + ROLL_OUT_S, exit_code=2, said="cannot write log"),
        case("output deleted", delete_output, 1.15 + ROLL_OUT_S, exit_code=2, said="deleted"),
        case("no more memory", fill_memory, None, exit_code=None),
    ]


def real_time_cases() -> list[Case]:
    """Return all that is run as two processes: faults of the program, and some of each device."""
    devices = [
        case
        for case in all_cases()
        if (case.fault in REAL_TIME_FAULTS and case.device not in ("camera", "process"))
        or case.zero_bar_s is not None
    ]
    return [*process_cases(), *devices]
