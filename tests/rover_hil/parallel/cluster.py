"""A real scheduler and real workers on this machine, and work for them."""

import os
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from drivers.clock import SystemClock, nanoseconds
from rover_hil.config import Config
from rover_hil.tune.simulated_mission import SimulatedMission
from tests.rover_hil.tune.tuning import answer

ROOT = Path(__file__).parents[3]
DELAY = "ROVER_HIL_TEST_DELAY_S"
HOST = "127.0.0.1"
START_LIMIT_S = 60.0
HIDE_PACKAGE = "import sys; sys.modules['rover_hil'] = None; from dask.__main__ import main; main()"


@contextmanager
def running_scheduler() -> Iterator[str]:
    """Give the address of a scheduler on a free port."""
    with socket.socket() as probe:
        probe.bind((HOST, 0))
        port = probe.getsockname()[1]
    arguments = ["scheduler", "--host", HOST, "--port", str(port), "--no-dashboard"]
    with _process(arguments, {}):
        yield f"tcp://{HOST}:{port}"


@contextmanager
def running_worker(
    address: str, *, delay_s: float = 0.0, threads: int = 1, has_package: bool = True
) -> Iterator[subprocess.Popen[bytes]]:
    """Give a worker, which waits before each call of `slow_answer`."""
    arguments = ["worker", address, "--nthreads", str(threads), "--no-nanny", "--no-dashboard"]
    with _process(arguments, {DELAY: str(delay_s)}, has_package=has_package) as process:
        yield process


def wait_for_workers(address: str, count: int) -> None:
    """Wait until a scheduler has so many workers."""
    from distributed import Client

    with Client(address, timeout=START_LIMIT_S, set_as_default=False) as client:
        client.wait_for_workers(count, timeout=START_LIMIT_S)


@contextmanager
def _process(
    arguments: list[str], environment: dict[str, str], *, has_package: bool = True
) -> Iterator[subprocess.Popen[bytes]]:
    start = ["-m", "dask"] if has_package else ["-c", HIDE_PACKAGE]
    with ExitStack() as stack:
        process = stack.enter_context(
            subprocess.Popen(
                [sys.executable, *start, *arguments],
                cwd=ROOT,
                env={**os.environ, "PYTHONPATH": str(ROOT), **environment},
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
            )
        )
        stack.callback(process.kill)
        yield process


def slow_answer(config: Config, seed: int) -> SimulatedMission:
    """Return the answer of `answer` after the delay of this worker."""
    clock = SystemClock()
    clock.sleep_until(clock.now_ns() + nanoseconds(float(os.environ.get(DELAY, "0"))))
    return answer(config, seed)
