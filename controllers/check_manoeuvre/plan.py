"""The check manoeuvre of a configuration, and the room that it needs."""

from typing import NamedTuple

from controllers.check_manoeuvre.path import Compared, Leg, Pace, legs_of, points_of
from controllers.motion.kinematics import Kinematics, make_kinematics
from controllers.motion.missions.mission import Point
from controllers.roles import DeviceRoles
from controllers.settings import ControlSettings

MARGIN_M = 0.1
"""Around the body: brakes, slip, and errors of the odometry."""


def compared_with(settings: ControlSettings, roles: DeviceRoles) -> Compared:
    """Return what the travel of the wheels can be compared with."""
    if roles.fixes:
        return Compared.POSITIONS
    has_ground = settings.ground_motion is not None and roles.camera is not None
    return Compared.TRAVEL if has_ground else Compared.NOTHING


def plan(settings: ControlSettings, kinematics: Kinematics, roles: DeviceRoles) -> tuple[Leg, ...]:
    """Return the legs of the manoeuvre; empty where none is wanted, or there is no mission.

    Args:
        settings: Rover, mission and safety.
        kinematics: Of the rover.
        roles: Of the devices.
    """
    mission = settings.mission
    if mission is None or not settings.safety.check_manoeuvre:
        return ()
    radius_m = settings.rover.wheel_radius_m
    rim_arm_m = radius_m * max(map(abs, kinematics.wheel_speeds(0.0, 0.0, 1.0)))
    pace = Pace.of(mission.speed_m_s, settings.safety.stall_set_point_rad_s * radius_m, rim_arm_m)
    return legs_of(kinematics, pace, compared_with(settings, roles))


class Room(NamedTuple):
    """Free space that the manoeuvre needs around the origin of the rover, in m, in its axes at the start.

    Attributes:
        ahead_m: Ahead.
        behind_m: Behind.
        aside_m: To each side.
        points_m: Path of the origin.
    """

    ahead_m: float
    behind_m: float
    aside_m: float
    points_m: tuple[Point, ...]


def room_of(settings: ControlSettings, roles: DeviceRoles) -> Room:
    """Return the room for the manoeuvre of a rover: the path, its body and a margin."""
    legs = plan(settings, make_kinematics(settings.rover), roles)
    points_m = points_of(legs)
    around_m = settings.safety.body_m(settings.rover) + MARGIN_M
    x_m, y_m = zip(*points_m, strict=True)
    return Room(
        ahead_m=max(x_m) + around_m,
        behind_m=around_m - min(x_m),
        aside_m=max(map(abs, y_m)) + around_m,
        points_m=points_m,
    )
