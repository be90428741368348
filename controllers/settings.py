"""The whole controller: its sections put together."""

from collections.abc import Iterator
from itertools import pairwise
from typing import Annotated, Self

from pydantic import AliasChoices, Field, model_validator

from controllers.estimation.ground_settings import GroundSettings
from controllers.estimation.settings import FilterSettings
from controllers.ground_motion.settings import GroundMotionSettings
from controllers.motion.rover_geometry import (
    OmniRoverSettings,
    RoverSettings,
    SkidSteerRoverSettings,
    WheelsRoverSettings,
    has_four_wheels,
)
from controllers.motion.settings import LimitSettings, MissionSettings
from controllers.safety.position_region import Region
from controllers.safety.settings import SafetySettings
from controllers.slip.effort.settings import YAW_PROBE, SlipSettings
from controllers.slip.scomp.settings import ScompSettings
from drivers.settings import Settings

OLD_SCOMP_KEY = "trace_slip"
"""Name of the section `scomp` in older configurations and logs."""
ROUNDING_M = 1e-6
"""A path that touches the border of the area is inside."""


class ControlSettings(Settings):
    """The whole controller. Without a mission it only observes, with zero setpoints.

    Without `slip` (three omnidirectional wheels) or `scomp` (four wheels) the wheels are assumed to
    roll.

    Attributes:
        rover: Geometry of the wheels.
        limits: Limits of the wheel setpoints.
        filter: Noise of the pose filter.
        ground: What is assumed about slip that nothing measures.
        safety: When the rover stops.
        mission: What the rover is to do; `run` needs one.
        slip: Slip compensation of three omnidirectional wheels.
        scomp: Slip compensation of four wheels by trace and tilt.
        ground_motion: Motion over the ground by the camera: slip that is measured, of any wheels.
    """

    rover: RoverSettings
    limits: LimitSettings
    filter: FilterSettings = FilterSettings()
    ground: GroundSettings = GroundSettings()
    safety: SafetySettings = SafetySettings()
    mission: MissionSettings | None = None
    slip: SlipSettings | None = None
    scomp: Annotated[ScompSettings | None, Field(validation_alias=AliasChoices("scomp", OLD_SCOMP_KEY))] = (
        None
    )
    ground_motion: GroundMotionSettings | None = None

    @model_validator(mode="after")
    def _check_stall(self) -> Self:
        for conflict in find_stall_conflicts(self.rover, self.mission, self.safety):
            raise ValueError(conflict)
        return self

    @model_validator(mode="after")
    def _check_slip(self) -> Self:
        for conflict in find_slip_conflicts(self.rover, self.slip, self.scomp):
            raise ValueError(conflict)
        for conflict in find_crab_conflicts(self.mission, self.scomp):
            raise ValueError(conflict)
        return self


def find_area_conflicts(
    rover: RoverSettings, mission: MissionSettings | None, safety: SafetySettings
) -> Iterator[str]:
    """Yield where the mission leaves the area of the rover, with the fix."""
    area = safety.area
    if area is None:
        return
    if safety.area_body_m is None and isinstance(rover, SkidSteerRoverSettings):
        yield (
            "safety.area_body_m is missing: skid_steer_4 does not know where its wheels are; add the "
            "distance of the outermost point of the rover from its origin, in m"
        )
    if mission is None:
        return
    body_m = safety.body_m(rover)
    corners = [complex(*corner) for corner in mission.corners()]
    start_m = area.excess(Region.of_line(corners[0], corners[0], body_m)).over_m
    if start_m > ROUNDING_M:
        yield (
            f"safety.area: the rover starts at 0, 0 m, and its body of {body_m:.3g} m radius is over the "
            f"border by {start_m:.3g} m: correct the area"
        )
        return
    for start, end in dict.fromkeys(pairwise(corners)):
        over_m = area.excess(Region.of_line(start, end, body_m)).over_m
        if over_m > ROUNDING_M:
            yield (
                f"mission: on the line from {start.real:g}, {start.imag:g} to {end.real:g}, {end.imag:g} m "
                f"the body of {body_m:.3g} m radius is outside safety.area by {over_m:.3g} m: move the "
                "points of the mission, or correct the area"
            )
            return


def find_stall_conflicts(
    rover: RoverSettings, mission: MissionSettings | None, safety: SafetySettings
) -> Iterator[str]:
    """Yield why no stall could be noticed on a mission, with the fix."""
    if mission is None:
        return
    slowest_m_s = min(leg.speed_m_s or mission.speed_m_s for leg in mission.legs())
    wheel_rad_s, least_rad_s = slowest_m_s / rover.wheel_radius_m, safety.stall_set_point_rad_s
    if wheel_rad_s < least_rad_s:
        yield (
            f"safety.stall_set_point_rad_s is {least_rad_s:g} rad/s, but the mission drives the wheels at "
            f"{wheel_rad_s:.3g} rad/s, so no stall could be noticed: set it to the least setpoint that your "
            "drive follows, or drive faster"
        )


def find_slip_conflicts(
    rover: RoverSettings, slip: SlipSettings | None, scomp: ScompSettings | None
) -> Iterator[str]:
    """Yield which slip compensation is not for this kind of rover, with the fix."""
    if slip is not None and slip.use == YAW_PROBE and not isinstance(rover, OmniRoverSettings):
        yield f"slip.use is '{YAW_PROBE}', but {_why_not_excited(rover)}: leave [slip] out"
    elif slip is not None and not isinstance(rover, OmniRoverSettings):
        yield (
            "slip: its maps are of three omnidirectional wheels, but rover.kinematics is "
            f"'{rover.kinematics}': leave [slip] out"
        )
    if scomp is not None and not has_four_wheels(rover):
        yield (
            "scomp: it is for a rover with four wheels, front left, front right, rear left, rear right, but "
            f"rover.kinematics is '{rover.kinematics}' with others: leave [scomp] out"
        )


def _why_not_excited(rover: RoverSettings) -> str:
    """Return why slip is not read from a yaw excitation of a rover without three omnidirectional wheels."""
    if isinstance(rover, WheelsRoverSettings) and any(wheel.steering for wheel in rover.wheels):
        return "steered wheels cannot turn the rover about its centre while it travels"
    if isinstance(rover, WheelsRoverSettings) and sum(wheel.driven for wheel in rover.wheels) == 2:
        return (
            "a castor resists the swing by its side force, which the reading takes for slip: with two driven "
            "wheels it is no better than the encoders"
        )
    return "its maps and its sharing of slip are of three omnidirectional wheels"


def find_crab_conflicts(mission: MissionSettings | None, scomp: ScompSettings | None) -> Iterator[str]:
    """Yield what a mission that crabs lacks, with the fix."""
    if mission is None or mission.heading != "crab":
        return
    if scomp is None:
        yield (
            'mission.heading is "crab", which needs the slip angle: add [scomp], or set heading to '
            '"along_path"'
        )
    elif not scomp.steer_against_drift:
        yield (
            'scomp.steer_against_drift is false, but mission.heading "crab" steers against the drift: remove '
            'the key, or set heading to "along_path"'
        )
