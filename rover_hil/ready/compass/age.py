"""Age of the calibration of each compass."""

import datetime as dt
from pathlib import Path

from drivers.heading_calibration import DeviationTable, MagnetometerCalibration, load_calibration
from drivers.nmea_compass.settings import NmeaCompassSettings
from drivers.witmotion.settings import WitMotionSettings
from rover_hil.config import Config
from rover_hil.doctor.finding import Finding, warning
from rover_hil.ready.dated import CHECK, dated


def check_age(config: Config, today: dt.date) -> list[Finding]:
    """Check the file of every compass, and that one whose headings are used has one."""
    findings = []
    for name, settings in config.devices.items():
        if not isinstance(settings, NmeaCompassSettings | WitMotionSettings):
            continue
        if settings.calibration is not None:
            findings.append(_check_file(name, settings, settings.calibration, today))
        elif name in config.roles.headings:
            findings.append(_uncalibrated(name))
    return findings


def _check_file(
    name: str, settings: NmeaCompassSettings | WitMotionSettings, path: str, today: dt.date
) -> Finding:
    if isinstance(settings, NmeaCompassSettings):
        date = load_calibration(Path(path), DeviationTable).date
    else:
        date = load_calibration(Path(path), MagnetometerCalibration).date
    return dated(
        name,
        date.isoformat(),
        today,
        fresh=f"{path} of {date}",
        old=f"{path} was made on {date}",
        cause="every rebuild moves iron on the rover, so old tables are wrong",
        command=f"rover-hil calibrate compass CONFIG --device {name} --force",
    )


def _uncalibrated(name: str) -> Finding:
    return warning(
        CHECK,
        name,
        "its headings are used without a calibration",
        "iron and currents on the rover bend the magnetic field by several degrees",
        f"`rover-hil calibrate compass CONFIG --device {name} --enter` "
        "(docs/how-to/calibrate_the_compass.md)",
    )
