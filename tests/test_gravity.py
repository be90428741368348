"""One gravity in the whole product."""

import re
from pathlib import Path

from drivers.units import STANDARD_GRAVITY_M_S2

ROOT = Path(__file__).resolve().parents[1]
GRAVITY = re.compile(r"=\s*9\.8\d*\b|\*\s*9\.8\d*\b")


def test_gravity_is_written_once() -> None:
    places = [
        path.relative_to(ROOT).as_posix()
        for package in ("drivers", "controllers", "sim_backends", "rover_hil")
        for path in sorted((ROOT / package).rglob("*.py"))
        if GRAVITY.search(path.read_text("utf-8"))
    ]
    assert places == ["drivers/units.py"]
    assert STANDARD_GRAVITY_M_S2 == 9.80665
