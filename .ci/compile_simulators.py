"""Compile the simulators, so that no test and no first run waits for it: half a minute in a new clone."""

import sys
import tempfile
from pathlib import Path

from rover_hil.app.run import run_virtual
from rover_hil.config import load_config
from sim_backends.terramechanics.slope.rover import Conditions, paper_rover
from sim_backends.terramechanics.slope.steady_state import solve_steady_state
from sim_backends.terramechanics.soil.compiled import compiled_kernel
from sim_backends.terramechanics.soil.library import load_soil

SHORT_S = 0.5
ROVERS = ("robotino", "el-dorado", "docs/examples/differential.toml")
"""One on each plant."""


def main() -> int:
    """Drive a rover on every plant for a moment and balance one on a slope; return 0."""
    solve_steady_state(paper_rover(), load_soil("toyoura"), Conditions(0.1), kernel=compiled_kernel)
    with tempfile.TemporaryDirectory() as folder:
        for name in ROVERS:
            run_virtual(load_config(name), Path(folder) / f"{Path(name).stem}.mcap", SHORT_S, None)
    return 0


if __name__ == "__main__":
    sys.exit(main())
