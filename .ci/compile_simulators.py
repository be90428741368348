"""Compile the simulators, so that no test and no first run waits for it: a minute or two in a new clone."""

import sys
import tempfile
from concurrent.futures import ProcessPoolExecutor
from importlib import import_module
from pathlib import Path

import numpy as np

from rover_hil.config import load_config
from rover_hil.run.driving import run_virtual
from sim_backends.terramechanics.slope.rover import Conditions, paper_rover
from sim_backends.terramechanics.slope.steady_state import solve_steady_state
from sim_backends.terramechanics.soil.compiled import compiled_kernel
from sim_backends.terramechanics.soil.library import load_soil

SHORT_S = 0.5
ROVERS = ("robotino", "el-dorado", "docs/examples/differential.toml")
"""One on each plant."""


def balance() -> None:
    """Balance a rover on a slope."""
    solve_steady_state(paper_rover(), load_soil("toyoura"), Conditions(0.1), kernel=compiled_kernel)


def drive(name: str) -> None:
    """Drive a rover for a moment."""
    with tempfile.TemporaryDirectory() as folder:
        run_virtual(load_config(name), Path(folder) / "run.mcap", SHORT_S, None)


def true_machines() -> None:
    """Compile the machines of the tests, which each worker of the tests would do as it collects them."""
    sys.path.insert(0, str(Path(__file__).parents[1]))
    import_module("tests.nature.machines.make")
    machines = import_module("tests.sim_backends.state_model.machines")
    machines.mass().predict([machines.run_of(np.zeros(9))], {}, {})


def main() -> int:
    """Do each in a process of its own; return 0."""
    with ProcessPoolExecutor() as pool:
        jobs = [pool.submit(true_machines), *(pool.submit(drive, name) for name in ROVERS)]
        jobs.append(pool.submit(balance))
        for job in jobs:
            job.result()
    return 0


if __name__ == "__main__":
    sys.exit(main())
