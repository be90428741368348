"""Are headings calibrated, and is the calibration recent?"""

import datetime as dt

from drivers.errors import ConfigError
from drivers.heading_calibration import DeviationTable, MagnetometerCalibration, load_calibration
from drivers.nmea_compass.settings import NmeaCompassSettings
from drivers.witmotion.settings import WitMotionSettings
from rover_hil.config import Config
from rover_hil.doctor.finding import Finding, ok, problem, warning

CHECK = "calibration"
OLDEST_DAYS = 365


def check_calibration(config: Config, today: dt.date) -> list[Finding]:
    """Look at the calibration file of every compass."""
    findings: list[Finding] = []
    for name, settings in config.devices.items():
        if isinstance(settings, NmeaCompassSettings | WitMotionSettings):
            findings += _check_file(name, settings, today, is_used=name in config.roles.headings)
    return findings


def _check_file(
    name: str, settings: NmeaCompassSettings | WitMotionSettings, today: dt.date, *, is_used: bool
) -> list[Finding]:
    is_nmea = isinstance(settings, NmeaCompassSettings)
    kind = DeviationTable if is_nmea else MagnetometerCalibration
    if settings.calibration is None:
        return [_uncalibrated(name, kind)] if is_used else []
    try:
        date = _load_date(settings)
    except ConfigError as error:
        keys = ", ".join(kind.model_fields)
        return [
            problem(
                CHECK,
                name,
                str(error),
                "the file is missing or not what the device needs",
                f"correct calibration in [devices.{name}] or the file's keys: {keys}",
            )
        ]
    age_days = (today - date).days
    if 0 <= age_days <= OLDEST_DAYS:
        return [ok(CHECK, name, f"{settings.calibration} of {date}")]
    return [
        warning(
            CHECK,
            name,
            f"{settings.calibration} is of {date}, {age_days} days ago",
            "iron on the rover changes with every rebuild, so old tables mislead; or a date is wrong",
            "calibrate again, and check the host's date with `date`",
        )
    ]


def _load_date(settings: NmeaCompassSettings | WitMotionSettings) -> dt.date:
    path = settings.calibration
    assert path is not None
    if isinstance(settings, NmeaCompassSettings):
        return load_calibration(path, DeviationTable).date
    return load_calibration(path, MagnetometerCalibration).date


def _uncalibrated(name: str, kind: type[DeviationTable] | type[MagnetometerCalibration]) -> Finding:
    return warning(
        CHECK,
        name,
        "headings are used without a calibration",
        "iron and currents on the rover bend the magnetic field by several degrees",
        f"write a TOML file with the keys {', '.join(kind.model_fields)} and name it as calibration in "
        f"[devices.{name}]",
    )
