"""Serve the simulated rover of `rover.toml` with the fault of one case, and write down the truth.

    python -m benchmarks.safety.faults.server TITLE TRUTH_FILE

Runs until it is ended. Each line of the truth file: time, begin of the fault (both ns, monotonic; -1 while
the rover has not moved), x, y in m, yaw in rad, largest wheel speed in rad/s. The log has the same clock.
"""

import signal
import sys
from pathlib import Path

from benchmarks.safety.faults.cases import Case, all_cases
from benchmarks.safety.faults.process_cases import process_cases
from benchmarks.safety.faults.runs import FaultTimer
from drivers.clock import SystemClock
from rover_hil.config import Config, load_config
from sim_backends.build import build_world
from sim_backends.serving.server import Server, put_on_ports
from sim_backends.world.line import NEVER_NS

PERIOD_S = 0.01


def serve(config: Config, truth_path: Path, case: Case | None = None) -> None:
    """Serve a simulated rover until interrupted, with the fault of a case."""
    clock = SystemClock()
    world = build_world(config.devices, config.require_simulation(), clock.now_ns())
    timer = None if case is None else FaultTimer(case, world)
    with Server(world, put_on_ports(world, config.devices), clock) as server, truth_path.open("w") as lines:
        while True:
            server.run(PERIOD_S)
            begin_ns = NEVER_NS
            if timer is not None:
                timer.watch(clock.now_ns())
                begin_ns = timer.window.begin_ns
            truth = world.plant.truth()
            fastest_rad_s = max(map(abs, truth.wheel_speed_rad_s))
            begun = -1 if begin_ns == NEVER_NS else begin_ns
            lines.write(f"{truth.t_ns} {begun} {truth.x_m} {truth.y_m} {truth.yaw_rad} {fastest_rad_s}\n")
            lines.flush()


if __name__ == "__main__":
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        title = sys.argv[1]
        found = next(case for case in (*all_cases(), *process_cases()) if case.title == title)
        serve(load_config("rover.toml"), Path(sys.argv[2]), found)
    except KeyboardInterrupt:
        sys.exit(0)
