"""How old the results are that a configuration uses: an `age.py` of each calibration with a date."""

import datetime as dt
from importlib import import_module
from pathlib import Path

from rover_hil.config import Config
from rover_hil.doctor.finding import Finding

FOLDER = Path(__file__).parent


def check_ages(config: Config, today: dt.date) -> list[Finding]:
    """Check that every result of a calibration is there where it is needed, and young enough."""
    findings: list[Finding] = []
    for path in sorted(FOLDER.glob("*/age.py")):
        findings += import_module(f"rover_hil.ready.{path.parent.name}.age").check_age(config, today)
    return findings
