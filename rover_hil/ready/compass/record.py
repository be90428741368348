"""What a log holds for the calibration of one compass: its bytes, and the turns by another sensor."""

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from drivers.angles import wrap_rad
from drivers.errors import ConfigError, LogError
from drivers.link import Received
from drivers.nmea_compass.settings import NmeaCompassSettings
from drivers.witmotion.settings import WitMotionSettings
from rover_hil.config import Config
from rover_hil.drives.arrays import Array
from rover_hil.drives.drive import Drive
from rover_hil.ready.compass.parameters import COMPASS_FIT

CompassSettings = NmeaCompassSettings | WitMotionSettings
LEAST_READINGS = 20


@dataclass(frozen=True, slots=True, kw_only=True)
class CompassTurns:
    """Turns of a compass.

    Attributes:
        path: The log.
        device: Name of the compass.
        settings: Its settings, without a calibration.
        payloads: Its bytes.
        start_ns: Origin of the times.
        reference: What measured the turns, in words.
        t_s: Times of the reference, shape (n,).
        yaw_rad: Its yaw, from an arbitrary start, counter-clockwise, not wrapped, (n,).
        rate_rad_s: Its yaw rate, (n,).
    """

    path: Path
    device: str
    settings: CompassSettings
    payloads: list[Received[bytes]]
    start_ns: int
    reference: str
    t_s: Array
    yaw_rad: Array
    rate_rad_s: Array

    def turn_of(self, t_s: Array) -> Array:
        """Return the number of the whole turn, either sense, in which each time lies."""
        turned = np.concatenate(([0.0], np.cumsum(np.abs(np.diff(self.yaw_rad))))) / math.tau
        return np.floor(np.interp(t_s, self.t_s, turned))

    @property
    def turns(self) -> float:
        """Turns of the reference, both senses together."""
        return float(np.abs(np.diff(self.yaw_rad)).sum() / math.tau)


def compass_of(config: Config, device: str | None) -> tuple[str, CompassSettings]:
    """Return name and settings of the compass to calibrate, without its present calibration.

    Args:
        config: The rover.
        device: Name of the compass; None where there is only one.

    Raises:
        ConfigError: There is none, there are several, or `device` is none.
    """
    compasses = {
        name: settings for name, settings in config.devices.items() if isinstance(settings, CompassSettings)
    }
    used = {name: settings for name, settings in compasses.items() if name in config.roles.headings}
    if device is not None:
        if device not in compasses:
            names = ", ".join(compasses) or "none"
            raise ConfigError(
                f"'{device}' is no compass that can be calibrated: the configuration has {names} "
                "(nmea_compass or witmotion)"
            )
        name = device
    else:
        candidates = list(used or compasses)
        if not candidates:
            raise ConfigError(
                "the configuration has no compass to calibrate: "
                "add a device of type nmea_compass or witmotion"
            )
        if len(candidates) > 1:
            raise ConfigError(f"there are several compasses: choose one with --device {candidates[0]}")
        name = candidates[0]
    return name, compasses[name].model_copy(update={"calibration": None})


def read_record(path: Path, device: str | None) -> CompassTurns:
    """Return what a log holds for the calibration of a compass.

    The turns are those of `roles.gyro`, else of the gyro in the compass, else of another gyro, else of the
    wheels.

    Raises:
        ConfigError: The log's configuration has no such compass.
        LogError: The log is damaged, or holds nothing of the compass, or no turns.
    """
    drive = Drive(path, with_devices=True).read()
    log, config = drive.log, drive.config
    name, settings = compass_of(config, device)
    payloads = [Received(each.t_ns, each.data) for each in drive.raw(name)]
    if not payloads:
        raise LogError(f"log {path} holds nothing of '{name}': was it connected?")
    rates = drive.channels.of_devices("gyro_z_rad_s")
    gyros = [each for each in (config.roles.gyro, name, *rates) if each in rates]
    reference = f"gyro '{gyros[0]}'" if gyros else "wheels"
    t_s, rate_rad_s = _yaw_rate(drive, str(gyros[0])) if gyros else _wheel_rate(drive)
    t_s, keep = np.unique(t_s, return_index=True)
    rate_rad_s = rate_rad_s[keep]
    if len(t_s) < LEAST_READINGS or not np.isfinite(rate_rad_s).all():
        raise LogError(f"log {path} shows no turns: neither a gyro nor wheel positions are in it")
    steps_s = np.diff(t_s)
    parts = np.where(
        steps_s <= COMPASS_FIT.longest_gap_s, 0.5 * steps_s * (rate_rad_s[1:] + rate_rad_s[:-1]), 0.0
    )
    return CompassTurns(
        path=path,
        device=name,
        settings=settings,
        payloads=payloads,
        start_ns=log.start_ns,
        reference=reference,
        t_s=t_s,
        yaw_rad=np.concatenate(([0.0], np.cumsum(parts))),
        rate_rad_s=rate_rad_s,
    )


def _yaw_rate(drive: Drive, gyro: str) -> tuple[Array, Array]:
    """Return times and yaw rates; of a tilted sensor by its attitude, where it reports one."""
    names = ("gyro_z_rad_s", "gyro_y_rad_s", "roll_rad", "pitch_rad")
    rate, left, roll, pitch = (drive.channels[f"{name} {gyro}"] for name in names)
    t_s = drive.seconds(rate.t_ns)
    if not (len(roll) and len(pitch)) or len(left) < len(rate):
        return t_s, rate.value
    roll_rad = np.interp(t_s, drive.seconds(roll.t_ns), np.unwrap(roll.value))
    pitch_rad = np.interp(t_s, drive.seconds(pitch.t_ns), pitch.value)
    pitch_rad = np.clip(pitch_rad, -COMPASS_FIT.steepest_rad, COMPASS_FIT.steepest_rad)
    turned: Array = (left.value * np.sin(roll_rad) + rate.value * np.cos(roll_rad)) / np.cos(pitch_rad)
    return t_s, turned


def _wheel_rate(drive: Drive) -> tuple[Array, Array]:
    rolled = drive.rolled(LEAST_READINGS)
    if rolled is None:
        return np.zeros(0), np.zeros(0)
    t_s, motion = drive.seconds(rolled[0]), rolled[1]
    return 0.5 * (t_s[1:] + t_s[:-1]), np.diff(motion[:, 2]) / np.diff(t_s)


def aligned(angles_rad: Array, near_rad: Array) -> Array:
    """Return the same directions, each within half a turn of `near_rad` plus a slowly changing difference."""
    difference = np.unwrap([wrap_rad(value) for value in (angles_rad - near_rad).tolist()])
    return near_rad + difference
