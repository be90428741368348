"""Settings of estimation and control, with ranges that detect a wrong unit."""

import math
from collections.abc import Iterator
from itertools import combinations
from typing import Annotated, Literal, Self, TypeAlias

from pydantic import AliasChoices, Field, model_validator

from controllers.safety.settings import SafetySettings
from controllers.slip.effort.settings import SlipSettings
from controllers.slip.scomp.settings import ScompSettings
from drivers.settings import Settings

WheelRadius = Annotated[float, Field(ge=0.005, le=1.0)]
PathLength = Annotated[float, Field(ge=0.05, le=100.0)]
Coordinate = Annotated[float, Field(ge=-500.0, le=500.0)]

CLOSEST_WHEELS_DEG = 15.0
OLD_SCOMP_KEY = "trace_slip"
"""Name of the section `scomp` in older configurations and logs."""


class OmniRoverSettings(Settings):
    """Three omnidirectional wheels on a circle around the origin of the body frame.

    Attributes:
        base_radius_m: Distance of each wheel from the origin.
        wheel_angles_deg: Angle of each wheel, counter-clockwise from x; positive speed is counter-clockwise.
    """

    kinematics: Literal["omni3"]
    wheel_radius_m: WheelRadius
    base_radius_m: Annotated[float, Field(ge=0.02, le=2.0)]
    wheel_angles_deg: tuple[float, float, float] = (60.0, 180.0, 300.0)

    @model_validator(mode="after")
    def _check_angles(self) -> Self:
        for first, second in combinations(self.wheel_angles_deg, 2):
            if abs(math.remainder(first - second, 360.0)) < CLOSEST_WHEELS_DEG:
                raise ValueError(
                    f"wheel_angles_deg: wheels at {first:g} and {second:g} deg are closer than "
                    f"{CLOSEST_WHEELS_DEG:g} deg; give the three angles in degrees"
                )
        return self


class SkidSteerRoverSettings(Settings):
    """Four wheels that do not steer, in the order front left, front right, rear left, rear right.

    Attributes:
        track_m: Distance between the left and the right wheels' contact patches. Skidding makes the
            effective track wider than that of the drawing: identify it by turning on the spot.
    """

    kinematics: Literal["skid_steer_4"]
    wheel_radius_m: WheelRadius
    track_m: Annotated[float, Field(ge=0.05, le=5.0)]


RoverSettings: TypeAlias = Annotated[
    OmniRoverSettings | SkidSteerRoverSettings, Field(discriminator="kinematics")
]


class FilterSettings(Settings):
    """Noise of the pose filter. Variances grow with distance, angle and time, never per cycle.

    Attributes:
        position_noise_m_sqrt_m: Standard deviation of the position after one metre, from wheel slip.
        unsure_position_noise_m_sqrt_m: The same where the compensated slip is flagged as not valid.
        wheel_yaw_noise_rad_sqrt_rad: Of the wheels' yaw after turning by one radian.
        wheel_yaw_noise_rad_sqrt_m: Of the wheels' yaw after driving one metre.
        gyro_noise_rad_sqrt_s: Of the integrated gyro after one second (angle random walk).
        gyro_rate_noise_rad_s: Of one gyro reading.
        gyro_bias_rad_s: Of the gyro's bias at start.
        gyro_bias_walk_rad_s_sqrt_s: Of the bias' change within one second.
        heading_noise_rad: Of one heading reading; larger where successive errors are correlated.
        heading_lag_s: Lag of the heading device.
        standstill_s: The rover is at rest after its wheels have not moved for this time.
        gate_probability: Share of correct measurements that pass the gate.
    """

    position_noise_m_sqrt_m: Annotated[float, Field(ge=1e-4, le=1.0)] = 0.05
    unsure_position_noise_m_sqrt_m: Annotated[float, Field(ge=1e-4, le=1.0)] = 0.2
    wheel_yaw_noise_rad_sqrt_rad: Annotated[float, Field(ge=1e-4, le=1.0)] = 0.1
    wheel_yaw_noise_rad_sqrt_m: Annotated[float, Field(ge=1e-4, le=1.0)] = 0.05
    gyro_noise_rad_sqrt_s: Annotated[float, Field(ge=1e-6, le=0.1)] = 0.002
    gyro_rate_noise_rad_s: Annotated[float, Field(ge=1e-5, le=0.5)] = 0.01
    gyro_bias_rad_s: Annotated[float, Field(ge=1e-6, le=0.5)] = 0.02
    gyro_bias_walk_rad_s_sqrt_s: Annotated[float, Field(ge=1e-7, le=0.01)] = 1e-4
    heading_noise_rad: Annotated[float, Field(ge=1e-3, le=0.8)] = 0.05
    heading_lag_s: Annotated[float, Field(ge=0, le=2.0)] = 0.0
    standstill_s: Annotated[float, Field(ge=0.05, le=10.0)] = 0.3
    gate_probability: Annotated[float, Field(ge=0.5, lt=1.0)] = 0.9995


class PathSettings(Settings):
    """Path following; the base of every mission.

    Attributes:
        speed_m_s: Speed along the path away from corners.
        heading: `hold` keeps the heading at start, `along_path` looks ahead. A skid-steer rover can only do
            the latter.
        position_tolerance_m: A corner or the end is reached at this distance before it, along the path.
        lookahead_m: The rover steers to the point of the path at this distance ahead.
        approach_gain_per_s: Speed per remaining distance to the next corner.
        heading_gain_per_s: Yaw rate per radian of heading error.
        yaw_rate_limit_rad_s: Greatest commanded yaw rate.
    """

    speed_m_s: Annotated[float, Field(ge=0.005, le=3.0)] = 0.1
    heading: Literal["hold", "along_path"] = "hold"
    position_tolerance_m: Annotated[float, Field(ge=0.001, le=0.5)] = 0.01
    lookahead_m: Annotated[float, Field(ge=0.02, le=5.0)] = 0.2
    approach_gain_per_s: Annotated[float, Field(ge=0.05, le=10.0)] = 1.5
    heading_gain_per_s: Annotated[float, Field(ge=0.05, le=10.0)] = 2.0
    yaw_rate_limit_rad_s: Annotated[float, Field(ge=0.01, le=5.0)] = 0.5


class RectangleMission(PathSettings):
    """A rectangle driven once, counter-clockwise, the first side along x, back to the start."""

    type: Literal["rectangle"]
    length_m: PathLength
    width_m: PathLength


class LineMission(PathSettings):
    """A straight line along x."""

    type: Literal["line"]
    length_m: PathLength


class WaypointsMission(PathSettings):
    """Straight lines from the start through `points`, given as (x, y) in m in the local frame."""

    type: Literal["waypoints"]
    points: Annotated[tuple[tuple[Coordinate, Coordinate], ...], Field(min_length=1, max_length=10_000)]


MissionSettings: TypeAlias = Annotated[
    RectangleMission | LineMission | WaypointsMission, Field(discriminator="type")
]


class LimitSettings(Settings):
    """Limits of the wheel set-points.

    Attributes:
        wheel_speed_rad_s: Greatest magnitude of a set-point.
        wheel_acceleration_rad_s2: Greatest change of a set-point per second.
    """

    wheel_speed_rad_s: Annotated[float, Field(ge=0.1, le=200.0)]
    wheel_acceleration_rad_s2: Annotated[float, Field(ge=0.1, le=2000.0)]


class ControlSettings(Settings):
    """The whole controller. Without a mission it only observes, with zero set-points.

    Without `slip` (three omnidirectional wheels) or `scomp` (four wheels) the wheels are assumed to roll.
    """

    rover: RoverSettings
    limits: LimitSettings
    filter: FilterSettings = FilterSettings()
    safety: SafetySettings = SafetySettings()
    mission: MissionSettings | None = None
    slip: SlipSettings | None = None
    scomp: Annotated[ScompSettings | None, Field(validation_alias=AliasChoices("scomp", OLD_SCOMP_KEY))] = (
        None
    )

    @model_validator(mode="after")
    def _check_slip(self) -> Self:
        for conflict in find_slip_conflicts(self.rover, self.slip, self.scomp):
            raise ValueError(conflict)
        return self


def find_slip_conflicts(
    rover: RoverSettings, slip: SlipSettings | None, scomp: ScompSettings | None
) -> Iterator[str]:
    """Yield which slip compensation is not for this kind of rover, with the fix."""
    if slip is not None and not isinstance(rover, OmniRoverSettings):
        yield (
            f"slip: its maps are of three omnidirectional wheels, but rover.kinematics is "
            f"'{rover.kinematics}': leave [slip] out"
        )
    if scomp is not None and not isinstance(rover, SkidSteerRoverSettings):
        yield (
            f"scomp: it is for a rover with four wheels, but rover.kinematics is "
            f"'{rover.kinematics}': leave [scomp] out"
        )
