"""The whole loop as two processes over devices of the kernel, with unplugging while the rover drives.

Setpoints are judged on the wire, by a third listener; the truth is the simulator's.
"""

import math
import multiprocessing
import os
import re
import signal
import socket
import struct
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from multiprocessing.process import BaseProcess as Process
from pathlib import Path

import numpy as np
import pytest

from drivers.clock import nanoseconds, seconds
from rover_hil.app.program import main
from rover_hil.config import Config
from rover_hil.drive import run_surroundings
from rover_hil.recording.data_files import restore_config
from rover_hil.recording.reader import LogReader
from rover_hil.run.replay import replay
from tests.kernel import rover_server
from tests.kernel.can_wire import Wire, cards
from tests.kernel.serial_line import Line, modem, plug_in, unplug
from tests.kernel.system import CLOCK, pause, wait_until

FIRST_SET_POINT = 0x200
SET_POINT_MASK = 0x7FE
SET_POINT = struct.Struct("<h")
MAX_AGE_S = 0.10
ZERO_BAR_S = 0.15
OUTAGE_S = 0.8
QUIET_S = 0.3
"""Shorter than the time without a fault after which the rover may move."""
BETWEEN_S = 0.8
START_LIMIT_S = 60.0
REST_RAD_S = 0.05
REST_BAR_S = 0.2 + 0.6
"""The watchdog of the drives and the time in which the wheels come to rest."""
NEES_BAR = 16.27
"""99.9 % of a chi-square distribution with 3 degrees of freedom."""
FORK = multiprocessing.get_context("fork")
"""Importing takes ten seconds of the emulated processor: once is enough."""


@dataclass(frozen=True)
class Outage:
    """A fault, and what the reason of the stop must begin with."""

    begin_ns: int
    end_ns: int
    resumed_ns: int
    reason: str
    is_wire_cut: bool
    """No frame can pass: the wheels stop by the watchdog of the drives."""


@dataclass
class Drive:
    """What was seen of one drive: setpoints on the wire, and what the program left."""

    outages: dict[str, Outage] = field(default_factory=dict)
    set_points: list[tuple[int, bool]] = field(default_factory=list)
    """When each was seen, and whether it was zero."""
    folder: Path = Path()
    exit_code: int = -1
    said: str = ""
    truth: list[list[float]] = field(default_factory=list)

    def has_moved_since(self, t_ns: int) -> bool:
        return any(seen_ns > t_ns and not is_zero for seen_ns, is_zero in reversed(self.set_points))


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> Drive:
    """Return a drive with four faults, in the order of `FAULTS`."""
    found = Drive(folder=tmp_path_factory.mktemp("drive"))
    with cards() as wire, modem() as line, _simulator(found, wire, line):
        adapter, far = line.adapter, Wire(wire.far, wire.near)
        with _program(found) as program, _listener(found, wire):
            _wait(lambda: found.has_moved_since(0), program, found, START_LIMIT_S)
            _break(found, program, "drives cut off", far.down, wire.up, "wheels: ")
            _break(
                found, program, "gyro unplugged", lambda: unplug(adapter), lambda: plug_in(adapter), "imu: "
            )
            _break(
                found, program, "interface down", wire.down, wire.up, "wheels: link down", is_wire_cut=True
            )
            _break(
                found,
                program,
                "loop stopped",
                lambda: os.kill(program.pid or 0, signal.SIGSTOP),
                lambda: os.kill(program.pid or 0, signal.SIGCONT),
                "",
            )
            program.join(START_LIMIT_S)
            found.exit_code = -1 if program.exitcode is None else program.exitcode
        found.truth = _read_truth(found)
    found.said = (found.folder / "said.txt").read_text()
    return found


DEVICE_FAULTS = ["drives cut off", "gyro unplugged", "interface down"]
FAULTS = [*DEVICE_FAULTS, "loop stopped"]


@pytest.mark.parametrize("fault", FAULTS)
def test_set_points_are_zero_in_time(
    drive: Drive, fault: str, record_property: Callable[[str, object], None]
) -> None:
    outage = drive.outages[fault]
    driven_ns = [
        seen_ns
        for seen_ns, is_zero in drive.set_points
        if outage.begin_ns < seen_ns < outage.end_ns and not is_zero
    ]
    record_property("last_motion_s", seconds(max(driven_ns, default=outage.begin_ns) - outage.begin_ns))
    begin_ns = outage.begin_ns + nanoseconds(MAX_AGE_S + ZERO_BAR_S)
    end_ns = outage.end_ns + nanoseconds(QUIET_S)
    seen = [(seen_ns, is_zero) for seen_ns, is_zero in drive.set_points if begin_ns < seen_ns < end_ns]
    assert all(is_zero for _, is_zero in seen)
    assert bool(seen) is not outage.is_wire_cut


def test_behind_a_cut_wire_the_wheels_stop_and_begin_with_zero(drive: Drive) -> None:
    outage = drive.outages["interface down"]
    at_rest_ns = [line[0] for line in drive.truth if line[0] > outage.begin_ns and line[4] < REST_RAD_S]
    assert seconds(round(at_rest_ns[0]) - outage.begin_ns) < REST_BAR_S
    after = [is_zero for seen_ns, is_zero in drive.set_points if seen_ns > outage.end_ns]
    assert all(after[:4])


def test_the_watchdog_says_that_it_stopped_the_drive(drive: Drive) -> None:
    # More than one where the machine is loaded.
    assert re.search(r"\b[1-9]\d* stops? by the watchdog", drive.said)


@pytest.mark.parametrize("fault", DEVICE_FAULTS)
def test_the_reason_of_the_stop_names_the_device(drive: Drive, fault: str) -> None:
    outage = drive.outages[fault]
    modes = [
        (mode, reason)
        for t_ns, mode, reason, *_ in _estimates(drive)
        if outage.begin_ns < t_ns < outage.end_ns and mode == "safe_stop"
    ]
    assert modes
    assert all(reason.startswith(outage.reason) for _, reason in modes), modes[0]


def test_it_drives_on_after_every_fault_and_finishes(
    drive: Drive, record_property: Callable[[str, object], None]
) -> None:
    record_property("work_per_cycle_s", [seconds(int(work_ns)) for work_ns in _work(drive)])
    record_property("simulator_cycles_skipped", drive.truth[-1][5])
    assert drive.exit_code == 0, drive.said
    assert "mission finished" in drive.said
    assert list(drive.outages) == FAULTS
    x_m, y_m, _ = _true_end(drive)
    assert math.hypot(x_m - rover_server.LENGTH_M, y_m) < 0.1


def test_the_estimate_is_honest_after_all_of_it(drive: Drive) -> None:
    *_, (_, _, _, estimate, covariance) = _estimates(drive)
    error = np.array(estimate) - np.array(_true_end(drive))
    xx, xy, xt, yy, yt, tt = covariance
    matrix = np.array([[xx, xy, xt], [xy, yy, yt], [xt, yt, tt]]) + 1e-12 * np.eye(3)
    assert float(error @ np.linalg.solve(matrix, error)) < NEES_BAR


def test_the_log_replays_exactly(drive: Drive) -> None:
    log = LogReader(drive.folder / "out" / "run.mcap")
    with restore_config(log) as config:
        assert isinstance(config, Config)
        result = replay(log, config, lambda: None)
    assert log.is_complete
    assert result.cycles > 100
    assert result.differences == []


def _break(
    drive: Drive,
    program: Process,
    fault: str,
    begin: Callable[[], None],
    end: Callable[[], None],
    reason: str,
    *,
    is_wire_cut: bool = False,
) -> None:
    """Break something while the rover drives, mend it, and wait until the rover drives again."""
    pause(BETWEEN_S)
    assert drive.has_moved_since(CLOCK.now_ns() - nanoseconds(0.2)), "it had stopped before"
    begin()
    begin_ns = CLOCK.now_ns()
    pause(OUTAGE_S)
    end_ns = CLOCK.now_ns()
    end()
    _wait(lambda: drive.has_moved_since(end_ns), program, drive, START_LIMIT_S)
    drive.outages[fault] = Outage(begin_ns, end_ns, CLOCK.now_ns(), reason, is_wire_cut)


def _wait(is_done: Callable[[], bool], program: Process, drive: Drive, limit_s: float) -> None:
    def check() -> bool:
        pause(0.02)
        assert program.is_alive(), (drive.folder / "said.txt").read_text()
        return is_done()

    wait_until(check, limit_s)


@contextmanager
def _simulator(drive: Drive, wire: Wire, line: Line) -> Iterator[None]:
    config, truth = drive.folder / "rover.toml", drive.folder / "truth.txt"
    rover_server.write_config(config, wire.near, str(line.near))
    process = FORK.Process(target=rover_server.main, args=(config, wire.far, str(line.far), truth))
    process.start()
    try:
        wait_until(truth.exists, START_LIMIT_S)
        yield
    finally:
        process.terminate()
        process.join()


@contextmanager
def _program(drive: Drive) -> Iterator[Process]:
    process = FORK.Process(target=_run_program, args=(drive.folder,))
    process.start()
    try:
        yield process
    finally:
        if process.is_alive():
            process.kill()
        process.join()


def _run_program(folder: Path) -> None:
    """Be `rover-hil run`."""
    said = os.open(folder / "said.txt", os.O_WRONLY | os.O_CREAT)
    os.dup2(said, 1)
    os.dup2(said, 2)
    sys.stdout, sys.stderr = os.fdopen(1, "w"), os.fdopen(2, "w")
    sys.argv = ["rover-hil", "run", str(folder / "rover.toml"), "--out", str(folder / "out")]
    # The report takes longer than the drive, and is tested elsewhere.
    setattr(run_surroundings, "write_report", lambda log_path, out: '{"stops": []}')  # noqa: B010
    main()


@contextmanager
def _listener(drive: Drive, wire: Wire) -> Iterator[None]:
    """Write down every setpoint on the interface of the program."""
    stop = threading.Event()

    def listen() -> None:
        while not stop.is_set():
            with suppress(OSError):  # nothing for a while, or the interface is down
                payload = raw.recv(16)
                drive.set_points.append((CLOCK.now_ns(), SET_POINT.unpack_from(payload, 8) == (0,)))

    with socket.socket(socket.PF_CAN, socket.SOCK_RAW, socket.CAN_RAW) as raw:
        wanted = struct.pack("=II", FIRST_SET_POINT, SET_POINT_MASK)
        raw.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FILTER, wanted)
        raw.settimeout(0.1)
        raw.bind((wire.near,))
        thread = threading.Thread(target=listen)
        thread.start()
        try:
            yield
        finally:
            stop.set()
            thread.join()


def _read_truth(drive: Drive) -> list[list[float]]:
    lines = (drive.folder / "truth.txt").read_text().splitlines()[:-1]
    return [[float(word) for word in line.split()] for line in lines]


def _true_end(drive: Drive) -> tuple[float, float, float]:
    """Return the true pose at the end, relative to that at the start."""
    _, x0_m, y0_m, yaw0_rad, *_ = drive.truth[0]
    _, x_m, y_m, yaw_rad, *_ = drive.truth[-1]
    ahead, aside = x_m - x0_m, y_m - y0_m
    cosine, sine = math.cos(yaw0_rad), math.sin(yaw0_rad)
    yaw = math.remainder(yaw_rad - yaw0_rad, math.tau)
    return cosine * ahead + sine * aside, -sine * ahead + cosine * aside, yaw


def _work(drive: Drive) -> list[float]:
    """Return median, 99th percentile and greatest time that the program worked in a cycle, in ns."""
    messages = LogReader(drive.folder / "out" / "run.mcap").messages()
    cycles = [message.json() for message in messages if message.topic == "/cycle"]
    work_ns = [cycle["work_ns"] for cycle in cycles if isinstance(cycle, dict)]
    return [float(value) for value in np.percentile(work_ns, [50.0, 99.0, 100.0])]


def _estimates(
    drive: Drive,
) -> list[tuple[int, str, str, tuple[float, float, float], tuple[float, ...]]]:
    """Return time, mode, reason, pose and covariance of every cycle."""
    found = []
    for message in LogReader(drive.folder / "out" / "run.mcap").messages():
        if message.topic == "/estimate":
            record = message.json()
            assert isinstance(record, dict)
            pose = record["estimate"]
            place = (pose["x_m"], pose["y_m"], pose["yaw_rad"])
            found.append((message.t_ns, record["mode"], record["reason"], place, tuple(pose["covariance"])))
    return found
