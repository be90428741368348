"""Radius and base of a rover's wheels from drives of which distance or turns are known, with intervals.

Odometry is proportional to the radius, its turns also to radius over base: the known distances give the
radius, the known turns then the base. Each factor is the least squares over its drives through zero. Its
interval is the larger one of two: from the accuracy of the measurement, and from the scatter of the drives.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.stats import t as student

from controllers.motion.rover_geometry import OmniRoverSettings, RoverSettings, SkidSteerRoverSettings
from drivers.errors import LogError
from rover_hil.datasets.arrays import Array
from rover_hil.recording import schema
from rover_hil.recording.data_files import restore_config
from rover_hil.recording.reader import LogReader

CONFIDENCE = 0.95
NORMAL_95 = 1.96
LEAST_DISTANCE_M = 0.3
LEAST_TURN_RAD = math.pi
GREATEST_CHANGE = 0.25
"""A factor further from 1 is a mistake in units, gears or counts, not a tolerance."""
GREATEST_HALF_WIDTH = 0.03
"""A factor that is less certain is not proposed."""


@dataclass(frozen=True, slots=True)
class Odometry:
    """What the wheels alone say of a drive.

    Attributes:
        path: The log.
        rover: The geometry that they were read with.
        distance_m: From start to end, in a straight line.
        turn_rad: Sum of all turns, counter-clockwise positive.
    """

    path: Path
    rover: RoverSettings
    distance_m: float
    turn_rad: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Factor:
    """A factor with its interval: `value` +- `half_width` at 95 %.

    Attributes:
        measured: What is known of each drive, (n,).
        odometry: The same by the wheels, (n,).
    """

    value: float
    half_width: float
    measured: Array
    odometry: Array

    @property
    def problem(self) -> str:
        """Why the factor must not be used; empty where it may."""
        if abs(self.value - 1.0) > GREATEST_CHANGE:
            return (
                f"odometry is wrong by a factor of {1.0 / self.value:.3g}: correct ticks, gear ratio, sign "
                f"or units "
                "of the drive first"
            )
        if self.half_width > GREATEST_HALF_WIDTH:
            return (
                f"the factor is uncertain by {100 * self.half_width:.1f} %: drive further, repeat it, or "
                f"measure "
                "more accurately"
            )
        return ""


def read_odometry(path: Path) -> Odometry:
    """Return what the wheels say of a drive.

    Raises:
        LogError: The log is damaged, holds no run, or the wheels lost their base on the way.
    """
    log = LogReader(path)
    with restore_config(log) as config:
        rover = config.rover
    poses: list[tuple[float, float, float]] = []
    rebases = set()
    for message in log.messages():
        if message.topic == schema.ESTIMATE:
            record = log.parse(message, schema.ESTIMATE_SHAPE)
            pose = record["odometry"]
            poses.append((pose["x_m"], pose["y_m"], pose["yaw_rad"]))
            rebases.add(record["odometry_rebases"])
    if len(poses) < 2:
        raise LogError(f"log {path} holds no run: record one with `rover-hil run`")
    table = np.array(poses)
    if len(rebases) > 2 or not np.isfinite(table).all():
        raise LogError(
            f"log {path}: the wheels fell silent on the way, so that a part of the drive is missing"
        )
    moved = table[-1] - table[0]
    return Odometry(path, rover, float(np.hypot(*moved[:2])), float(np.diff(np.unwrap(table[:, 2])).sum()))


def fit_factor(measured: Sequence[float], odometry: Sequence[float], accuracy: float) -> Factor:
    """Return measured over odometry, with its interval.

    Args:
        measured: What is known of each drive, one or more.
        odometry: The same by the wheels; not 0.
        accuracy: Standard deviation of what is known, in its unit.
    """
    known, by_wheels = np.array(measured), np.array(odometry)
    weight = float(by_wheels @ by_wheels)
    value = float(known @ by_wheels) / weight
    half_width = NORMAL_95 * accuracy / math.sqrt(weight)
    if len(known) > 1:
        rest = known - value * by_wheels
        scatter = math.sqrt(float(rest @ rest) / (len(known) - 1) / weight)
        half_width = max(half_width, float(student.ppf(0.5 + 0.5 * CONFIDENCE, len(known) - 1)) * scatter)
    return Factor(value=value, half_width=half_width, measured=known, odometry=by_wheels)


def proposal(rover: RoverSettings, radius: Factor | None, turn: Factor | None) -> dict[str, object]:
    """Return the new values of the section [rover] by key.

    Args:
        rover: Present geometry.
        radius: Known distance over odometry; None where no distance is known.
        turn: Known turn over odometry; None where no turn is known.
    """
    scale = 1.0 if radius is None else radius.value
    base = scale / (1.0 if turn is None else turn.value)  # without turns known, odometry turns as before
    if isinstance(rover, OmniRoverSettings):
        values = {"wheel_radius_m": scale * rover.wheel_radius_m, "base_radius_m": base * rover.base_radius_m}
    elif isinstance(rover, SkidSteerRoverSettings):
        values = {"wheel_radius_m": scale * rover.wheel_radius_m, "track_m": base * rover.track_m}
    else:
        return {
            "wheels": [
                {
                    "x_m": _rounded(base * each.x_m),
                    "y_m": _rounded(base * each.y_m),
                    "radius_m": _rounded(scale * each.radius_m),
                }
                for each in rover.wheels
            ]
        }
    radius_key, base_key = values
    kept = {radius_key: radius is not None, base_key: turn is not None or radius is not None}
    return {key: _rounded(value) for key, value in values.items() if kept[key]}


def _rounded(value: float) -> float:
    return float(f"{value:.5g}")
