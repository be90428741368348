"""Check the built wheel: the four packages and nothing else at its top level, data files included."""

import re
import sys
import zipfile
from pathlib import Path

PACKAGES = {"drivers", "controllers", "sim_backends", "rover_hil"}
DATA_FILES = {
    "rover_hil/config/shipped/configs/robotino.toml",
    "rover_hil/config/shipped/configs/el-dorado.toml",
    "rover_hil/bench/static/bench.js",
    "rover_hil/bench/static/stop.js",
    "rover_hil/pages/plot.js",
    "rover_hil/pages/viewer.js",
    "rover_hil/report/report.html",
    "rover_hil/config/shipped/rigs/el-dorado.json",
    "rover_hil/config/shipped/scomp_parameters/el-dorado.toml",
    "rover_hil/config/shipped/slip_maps/robotino.toml",
    "rover_hil/terrain/report.html",
    "rover_hil/tune/report.html",
    "sim_backends/rear_scene/photographs/grass.png",
    "sim_backends/fmu/example/axis.c",
    "sim_backends/fmu/example/axis_fmi2.xml",
    "sim_backends/plants/robotino/surfaces.toml",
    "sim_backends/terramechanics/soil/library/any_angle/cmu_sand.toml",
    "sim_backends/terramechanics/soil/library/soils/toyoura.toml",
    "sim_backends/terramechanics/soil/library/wheels/paper_001.toml",
    "sim_backends/terramechanics/soil/slip_skid_wheels.toml",
    "sim_backends/plants/robotino/sites/paper_like.toml",
    "drivers/can_wheels/generic_wheel.dbc",
    "drivers/can_wheels/generic_wheel.toml",
    "drivers/can_wheels/steered_wheel.dbc",
    "drivers/can_wheels/steered_wheel.toml",
} | {f"{package}/py.typed" for package in PACKAGES}

MAN_PAGE = "share/man/man1/rover-hil.1"


def main() -> int:
    """Return 0 when the one wheel in the folder given as argument is as it must be."""
    (wheel,) = Path(sys.argv[1]).glob("*.whl")
    names = set(zipfile.ZipFile(wheel).namelist())
    top_level = {name.split("/")[0] for name in names if not re.match(r"[^/]+\.(dist-info|data)/", name)}
    problems = [f"missing {name}" for name in sorted(DATA_FILES - names)]
    if not any(name.endswith(f".data/data/{MAN_PAGE}") for name in names):
        problems.append(f"missing {MAN_PAGE}")
    if top_level != PACKAGES:
        problems.append(f"top level is {sorted(top_level)}, must be {sorted(PACKAGES)}")
    print("\n".join(problems) or f"{wheel.name}: as it must be")
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main())
