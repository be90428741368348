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

from controllers.motion.rover_geometry import (
    OmniRoverSettings,
    RoverSettings,
    SkidSteerRoverSettings,
    WheelsRoverSettings,
)
from controllers.motion.wheel_constraints import skids_in_turns
from drivers.errors import LogError
from rover_hil.drives.arrays import Array
from rover_hil.drives.drive import Drive
from rover_hil.recording import schema

CONFIDENCE = 0.95
NORMAL_95 = 1.96
LEAST_DISTANCE_M = 0.3
LEAST_TURN_RAD = math.pi
GREATEST_CHANGE = 0.25
"""A factor further from 1 is a mistake in units, gears or counts, not a tolerance."""
GREATEST_EFFECTIVE_TRACK = 4.0
"""Of a rover that skids in turns, over the configured track; chosen by hand, against wrong counts."""
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


@dataclass(frozen=True, slots=True, kw_only=True)
class WheelsFit:
    """What came out.

    Attributes:
        rover: The geometry of the drives.
        radius: Known distance over odometry; None where no distance is known.
        turn: Known turn over odometry; None where no turn is known.
    """

    rover: RoverSettings
    radius: Factor | None
    turn: Factor | None

    @property
    def skids(self) -> bool:
        """Whether the rover turns by skidding, so that its wheels roll further than its track says."""
        if isinstance(self.rover, SkidSteerRoverSettings):
            return True
        return isinstance(self.rover, WheelsRoverSettings) and skids_in_turns(self.rover.wheels)

    @property
    def problem(self) -> str:
        """Why the factors must not be used; empty where they may."""
        for factor, smallest in (
            (self.radius, 1.0 - GREATEST_CHANGE),
            (self.turn, 1.0 / GREATEST_EFFECTIVE_TRACK if self.skids else 1.0 - GREATEST_CHANGE),
        ):
            if factor is None:
                continue
            if not smallest <= factor.value <= 1.0 + GREATEST_CHANGE:
                return (
                    f"odometry is wrong by a factor of {1.0 / factor.value:.3g}: correct ticks, gear "
                    "ratio, sign or units of the drive first"
                )
            if factor.half_width > GREATEST_HALF_WIDTH:
                return (
                    f"the factor is uncertain by {100 * factor.half_width:.1f} %: drive further, repeat it, "
                    "or measure more accurately"
                )
        return ""

    @property
    def values(self) -> dict[str, float]:
        """New values of the section [rover] by key; of a rover with [[rover.wheels]] see `wheels`."""
        scale, base = self._scale_and_base
        if isinstance(self.rover, OmniRoverSettings):
            key, base_m = "base_radius_m", self.rover.base_radius_m
        elif isinstance(self.rover, SkidSteerRoverSettings):
            key, base_m = "track_m", self.rover.track_m
        else:
            return {}
        values = (
            {} if self.radius is None else {"wheel_radius_m": _rounded(scale * self.rover.wheel_radius_m)}
        )
        return {**values, key: _rounded(base * base_m)}

    @property
    def wheels(self) -> list[dict[str, float]]:
        """New places and radii of [[rover.wheels]]; empty for other rovers."""
        if not isinstance(self.rover, WheelsRoverSettings):
            return []
        scale, base = self._scale_and_base
        return [
            {
                # Where wheels skid the distance of the axles has no part in the turn.
                "x_m": _rounded(wheel.x_m if self.skids else base * wheel.x_m),
                "y_m": _rounded(base * wheel.y_m),
                "radius_m": _rounded(scale * wheel.radius_m),
            }
            for wheel in self.rover.wheels
        ]

    @property
    def _scale_and_base(self) -> tuple[float, float]:
        scale = 1.0 if self.radius is None else self.radius.value
        # Without turns known, odometry turns as before.
        return scale, scale / (1.0 if self.turn is None else self.turn.value)


def read_odometry(path: Path) -> Odometry:
    """Return what the wheels say of a drive.

    Raises:
        LogError: The log is damaged, holds no run, or the wheels lost their base on the way.
    """
    drive = Drive(path)
    poses: list[tuple[float, float, float]] = []
    rebases = set()

    def take(_: int, record: schema.EstimateRecord) -> None:
        pose = record["odometry"]
        poses.append((pose["x_m"], pose["y_m"], pose["yaw_rad"]))
        rebases.add(record["odometry_rebases"])

    drive.read(take_estimate=take)
    if len(poses) < 2:
        raise LogError(f"log {path} holds no run: record one with `rover-hil run`")
    table = np.array(poses)
    if len(rebases) > 2 or not np.isfinite(table).all():
        raise LogError(
            f"log {path}: the wheels fell silent on the way, so that a part of the drive is missing"
        )
    moved = table[-1] - table[0]
    return Odometry(
        path, drive.config.rover, float(np.hypot(*moved[:2])), float(np.diff(np.unwrap(table[:, 2])).sum())
    )


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
        residual = known - value * by_wheels
        scatter = math.sqrt(float(residual @ residual) / (len(known) - 1) / weight)
        half_width = max(half_width, float(student.ppf(0.5 + 0.5 * CONFIDENCE, len(known) - 1)) * scatter)
    return Factor(value=value, half_width=half_width, measured=known, odometry=by_wheels)


def _rounded(value: float) -> float:
    return float(f"{value:.5g}")
