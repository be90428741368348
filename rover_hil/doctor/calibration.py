"""Check calibrations of headings and their ages, and those of the gyro's constants and the camera's scale."""

import datetime as dt
from pathlib import Path

from controllers.ground_motion.rig_tolerance import RigTolerance
from controllers.slip.effort.gyro_response import GyroResponse
from drivers.heading_calibration import DeviationTable, MagnetometerCalibration, load_calibration
from drivers.nmea_compass.settings import NmeaCompassSettings
from drivers.witmotion.settings import WitMotionSettings
from rover_hil.config import Config
from rover_hil.doctor.finding import Finding, ok, warning

CHECK = "calibration"
OLDEST_DAYS = 365


def check_calibration(config: Config, today: dt.date) -> list[Finding]:
    """Check the file of every compass, the constants of the gyro and the scale of the ground camera."""
    findings: list[Finding] = []
    for name, settings in config.devices.items():
        if isinstance(settings, NmeaCompassSettings | WitMotionSettings):
            findings += _check_file(name, settings, today, is_used=name in config.roles.headings)
    if config.ground_motion is not None and config.roles.camera is not None:
        findings += _check_scale(config.roles.camera, config.ground_motion.tolerance, today)
    if config.slip is not None and config.slip.gyro_response is not None and config.roles.gyro is not None:
        findings += _check_gyro(config.roles.gyro, config.slip.gyro_response, today)
    return findings


def _age_days(date: str, today: dt.date) -> int:
    """Return the age of a date as written; -1 where it is none."""
    try:
        return (today - dt.date.fromisoformat(date)).days
    except ValueError:
        return -1


def _check_gyro(name: str, gyro: GyroResponse, today: dt.date) -> list[Finding]:
    if 0 <= _age_days(gyro.identified_on, today) <= OLDEST_DAYS:
        return [ok(CHECK, name, f"delay and bandwidth of {gyro.identified_on}")]
    return [
        warning(
            CHECK,
            name,
            f"its delay and bandwidth are of {gyro.identified_on}, today is {today}",
            "another sensor, filter or baud rate delays turns by another time; or one of the dates is wrong",
            "`rover-hil calibrate imu CONFIG`; check the host's date with `date`",
        )
    ]


def _check_scale(name: str, tolerance: RigTolerance, today: dt.date) -> list[Finding]:
    if tolerance.scale_date is None:
        return []
    if 0 <= _age_days(tolerance.scale_date, today) <= OLDEST_DAYS:
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
