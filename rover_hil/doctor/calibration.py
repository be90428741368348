"""Check whether headings are calibrated, and how old that and the scale of the ground camera are."""

import datetime as dt
from pathlib import Path

from controllers.ground_motion.rig_tolerance import RigTolerance
from drivers.heading_calibration import DeviationTable, MagnetometerCalibration, load_calibration
from drivers.nmea_compass.settings import NmeaCompassSettings
from drivers.witmotion.settings import WitMotionSettings
from rover_hil.config import Config
from rover_hil.doctor.finding import Finding, ok, warning

CHECK = "calibration"
OLDEST_DAYS = 365


def check_calibration(config: Config, today: dt.date) -> list[Finding]:
    """Check the calibration file of every compass, and the scale of the ground camera where it has one."""
    findings: list[Finding] = []
    for name, settings in config.devices.items():
        if isinstance(settings, NmeaCompassSettings | WitMotionSettings):
            findings += _check_file(name, settings, today, is_used=name in config.roles.headings)
    if config.ground_motion is not None and config.roles.camera is not None:
        findings += _check_scale(config.roles.camera, config.ground_motion.tolerance, today)
    return findings


def _check_scale(name: str, tolerance: RigTolerance, today: dt.date) -> list[Finding]:
    if tolerance.scale_date is None:
        return []
    try:
        age_days = (today - dt.date.fromisoformat(tolerance.scale_date)).days
    except ValueError:
        age_days = -1
    if 0 <= age_days <= OLDEST_DAYS:
        return [ok(CHECK, name, f"scale {tolerance.scale:g} of {tolerance.scale_date}")]
    return [
        warning(
            CHECK,
            name,
            f"its scale is of {tolerance.scale_date}, today is {today}",
            "a camera whose height or pitch has changed measures another distance; or one of the dates is "
            "wrong",
            "`rover-hil calibrate camera CONFIG --scale --enter --out FILE`; check the host's date with "
            "`date`",
        )
    ]


def _check_file(
    name: str, settings: NmeaCompassSettings | WitMotionSettings, today: dt.date, *, is_used: bool
) -> list[Finding]:
    path = settings.calibration
    if path is None:
        return [_uncalibrated(name)] if is_used else []
    if isinstance(settings, NmeaCompassSettings):
        date = load_calibration(Path(path), DeviationTable).date
    else:
        date = load_calibration(Path(path), MagnetometerCalibration).date
    age_days = (today - date).days
    if 0 <= age_days <= OLDEST_DAYS:
        return [ok(CHECK, name, f"{path} of {date}")]
    return [
        warning(
            CHECK,
            name,
            f"{path} was made on {date}, today is {today}",
            "every rebuild moves iron on the rover, so old tables are wrong; or one of the dates is wrong",
            f"`rover-hil calibrate compass CONFIG --device {name} --force`; check the host's date with "
            f"`date`",
        )
    ]


def _uncalibrated(name: str) -> Finding:
    return warning(
        CHECK,
        name,
        "its headings are used without a calibration",
        "iron and currents on the rover bend the magnetic field by several degrees",
        f"`rover-hil calibrate compass CONFIG --device {name} --enter` "
        f"(docs/how-to/calibrate_the_compass.md)",
    )
