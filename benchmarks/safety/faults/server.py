"""Serve the simulated rover of `rover.toml` with the fault of one case, and write down the truth.

    python -m benchmarks.safety.faults.server TITLE TRUTH_FILE

Runs until it is ended. Each line of the truth file: time, begin of the fault (both ns, monotonic; -1 while
the rover has not moved), x, y in m, yaw in rad, largest wheel speed in rad/s. The log has the same clock.
"""

import signal
import sys
from pathlib import Path

from benchmarks.safety.faults.cases import all_cases
from benchmarks.safety.faults.process_cases import process_cases
from benchmarks.safety.faults.runs import FaultTimer
from drivers.clock import SystemClock
from rover_hil.config import load_config
from sim_backends.build import build_world
from sim_backends.serving.server import Server, put_on_ports
from sim_backends.world.line import NEVER_NS

PERIOD_S = 0.01


def serve(title: str, truth_path: Path) -> None:
    """Serve until interrupted."""
    case = next(case for case in (*all_cases(), *process_cases()) if case.title == title)
    config = load_config("rover.toml")
    clock = SystemClock()
    world = build_world(config.devices, config.require_simulation(), clock.now_ns())
    timer = FaultTimer(case, world)
    with Server(world, put_on_ports(world, config.devices), clock) as server, truth_path.open("w") as lines:
        while True:
            server.run(PERIOD_S)
            now_ns = clock.now_ns()
            timer.watch(now_ns)
            truth = world.plant.truth()
            begin_ns = -1 if timer.window.begin_ns == NEVER_NS else timer.window.begin_ns
            fastest_rad_s = max(map(abs, truth.wheel_speed_rad_s))
            lines.write(f"{truth.t_ns} {begin_ns} {truth.x_m} {truth.y_m} {truth.yaw_rad} {fastest_rad_s}\n")
            lines.flush()


if __name__ == "__main__":
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        serve(sys.argv[1], Path(sys.argv[2]))
    except KeyboardInterrupt:
        sys.exit(0)
