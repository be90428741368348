"""What a log holds of an inertial sensor in its own axes, and of the turns by another device."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from drivers.errors import ConfigError, LogError
from drivers.heading_calibration import Vector
from drivers.inertial_settings import InertialSettings
from rover_hil.config import Config
from rover_hil.drives.arrays import Array
from rover_hil.drives.drive import Drive
from rover_hil.drives.ground_truth import TruePoses

LEAST_READINGS = 100
AXES: tuple[Vector, ...] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


@dataclass(frozen=True, slots=True, kw_only=True)
class InertialTurns:
    """Readings of a sensor, in its own axes and without scale and bias.

    Attributes:
        path: The log.
        device: Name of the sensor.
        t_s: Times of the rates, shape (n,).
        rate_rad_s: Rates about x, y, z, (n, 3).
        acceleration_t_s: Times of the accelerations, (m,); empty where it sends none.
        acceleration_m_s2: Accelerations along x, y, z, (m, 3).
        expected_up: The rover's z axis by the mounting in the log's configuration, (3,).
        references: Yaw by other devices, by a name in words: times (k,) and yaw in rad (k,), not wrapped.
    """

    path: Path
    device: str
    t_s: Array
    rate_rad_s: Array
    acceleration_t_s: Array
    acceleration_m_s2: Array
    expected_up: Array
    references: dict[str, tuple[Array, Array]] = field(default_factory=dict)


def sensor_of(config: Config, device: str | None) -> tuple[str, InertialSettings]:
    """Return name and settings of the sensor to calibrate.

    Args:
        config: The rover.
        device: Name of the sensor; None for `roles.gyro`, or the only one.

    Raises:
        ConfigError: There is none, there are several, or `device` is none.
    """
    sensors = {
        name: settings for name, settings in config.devices.items() if isinstance(settings, InertialSettings)
    }
    name = device or (config.roles.gyro if config.roles.gyro in sensors else None)
    if name is None and len(sensors) == 1:
        (name,) = sensors
    if name not in sensors:
        asked = f"'{device}' is no inertial sensor" if device else "no inertial sensor is named"
        raise ConfigError(f"{asked} (witmotion, xsens, vectornav); there are: {', '.join(sensors) or 'none'}")
    return name, sensors[name]


def read_inertial(path: Path, device: str | None) -> InertialTurns:
    """Return what a log holds of an inertial sensor.

    Raises:
        ConfigError: The log's configuration has no such sensor.
        LogError: The log is damaged, or holds too few rates.
    """
    drive = Drive(path, with_devices=True).read()
    log, config, rows = drive.log, drive.config, drive.channels
    name, settings = sensor_of(config, device)
    yaw = rows[f"gyro_z_rad_s {name}"]
    if len(yaw) < LEAST_READINGS or not np.isfinite(yaw.value).all():
        raise LogError(f"log {path} holds {len(yaw)} yaw rates of '{name}': record whole turns with it")
    rates = [rows[f"gyro_{axis}_rad_s {name}"] for axis in "xyz"]
    forces = [rows[f"acceleration_{axis}_m_s2 {name}"] for axis in "xyz"]
    references = {}
    for source, heading in rows.of_devices("heading_rad").items():
        compass = source.rpartition(" ")[0]
        if compass != name:
            references[f"compass '{compass}'"] = drive.seconds(heading.t_ns), np.unwrap(heading.value)
    fixes = drive.fixes()
    if fixes is not None and len(fixes.t_ns):
        references = {"overhead camera": _yaw_of(drive, fixes), **references}
    if log.origin == "virtual":
        references = {"simulated turns": _yaw_of(drive, drive.true_poses()), **references}
    return InertialTurns(
        path=path,
        device=name,
        t_s=drive.seconds(yaw.t_ns),
        rate_rad_s=_in_sensor(
            # A sensor may report the yaw rate alone.
            np.column_stack([each.value if len(each) == len(yaw) else np.zeros(len(yaw)) for each in rates]),
            settings,
            is_rate=True,
        ),
        acceleration_t_s=drive.seconds(forces[0].t_ns),
        acceleration_m_s2=_in_sensor(
            np.column_stack([each.value for each in forces]), settings, is_rate=False
        ),
        expected_up=_axes(settings)[:, 2],
        references=references,
    )


def _yaw_of(drive: Drive, poses: TruePoses) -> tuple[Array, Array]:
    return drive.seconds(poses.t_ns), poses.yaw_rad


def _in_sensor(vectors: Array, settings: InertialSettings, *, is_rate: bool) -> Array:
    """Undo the mounting in the settings; and, of rates, scale and bias."""
    mounting = settings.make_mounting()
    if is_rate:
        vectors = (vectors + np.array([0.0, 0.0, mounting.gyro_bias_rad_s])) / mounting.gyro_scale
    turned: Array = vectors @ _axes(settings).T
    return turned


def _axes(settings: InertialSettings) -> Array:
    """Return row by row the axes of the sensor in those of the rover, by the configuration."""
    mounting = settings.make_mounting()
    return np.array([mounting.vector_to_rover(axis) for axis in AXES])
