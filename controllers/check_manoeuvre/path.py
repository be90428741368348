"""The path of the check manoeuvre: its legs, and the room that it needs."""

import cmath
import math
from enum import Enum, auto
from typing import NamedTuple

from controllers.motion.missions.mission import Mobility, Point

ROTATION_RAD = math.radians(20.0)
"""To either side."""
TRAVEL_M = 0.3
"""Forth, and back."""
YAW_RATE_RAD_S = 0.25
"""So slow that the wheels hardly slip, and that delays of some hundredths of a second do not matter."""
SPEED_M_S = 0.1
OVER_STALL = 1.1
"""Wheels turn at least this many times faster than `stall_set_point_rad_s`."""
WIDER = 1.1
"""Radius of the arcs over the least possible one."""
ARC_STEP_RAD = math.radians(5.0)
"""Between the points of an arc that are given to the check of the area."""


class Leg(NamedTuple):
    """A motion of constant velocity up to a yaw, or where that is None up to a travel.

    Attributes:
        velocity_m_s: Forward.
        yaw_rate_rad_s: Counter-clockwise.
        planned_s: Time that it takes at these velocities.
        yaw_rad: Yaw at its end, from the start of the manoeuvre.
        travel_m: Travel forward at its end, since the start.
    """

    velocity_m_s: float
    yaw_rate_rad_s: float
    planned_s: float
    yaw_rad: float | None = None
    travel_m: float | None = None


class Pace(NamedTuple):
    """How fast the manoeuvre is.

    Attributes:
        speed_m_s: Along its path.
        yaw_rate_rad_s: On the spot.
    """

    speed_m_s: float
    yaw_rate_rad_s: float

    @classmethod
    def of(cls, mission_m_s: float, least_rim_m_s: float, rim_arm_m: float) -> "Pace":
        """Return a slow pace at which a stall of a wheel is still detected.

        Args:
            mission_m_s: Speed of the mission, the greatest one.
            least_rim_m_s: Speed of a rim at `stall_set_point_rad_s`.
            rim_arm_m: Speed of the fastest rim over the yaw rate, in a rotation on the spot.
        """
        least_m_s = OVER_STALL * least_rim_m_s
        speed_m_s = max(min(SPEED_M_S, mission_m_s), min(least_m_s, mission_m_s))
        return cls(speed_m_s, max(YAW_RATE_RAD_S, least_m_s / rim_arm_m))


class Compared(Enum):
    """What the travel of the wheels can be compared with."""

    NOTHING = auto()
    TRAVEL = auto()
    POSITIONS = auto()


def legs_of(mobility: Mobility, pace: Pace, compared: Compared) -> tuple[Leg, ...]:
    """Return the legs; the rover ends where it began.

    A rover that can rotate on the spot rotates to both sides. It drives forth and back where something
    measures its travel; with positions at both ends of the rotation: on one line mirrored axes look like
    turned ones. A rover that cannot rotate on the spot drives an S of two arcs, and back on it.
    """
    speed_m_s, rate_rad_s = pace
    if not mobility.turns_on_spot:
        rate_rad_s = speed_m_s / arc_radius_m(mobility, pace)
        arc_s = ROTATION_RAD / rate_rad_s
        return (
            Leg(speed_m_s, rate_rad_s, arc_s, ROTATION_RAD),
            Leg(speed_m_s, -rate_rad_s, 2.0 * arc_s, -ROTATION_RAD),
            Leg(-speed_m_s, rate_rad_s, 2.0 * arc_s, ROTATION_RAD),
            Leg(-speed_m_s, -rate_rad_s, arc_s, 0.0),
        )
    travel_s, rotation_s = TRAVEL_M / speed_m_s, ROTATION_RAD / rate_rad_s
    there_and_back = (
        Leg(speed_m_s, 0.0, travel_s, travel_m=TRAVEL_M),
        Leg(-speed_m_s, 0.0, travel_s, travel_m=0.0),
    )
    left = Leg(0.0, rate_rad_s, rotation_s, ROTATION_RAD)
    right = Leg(0.0, -rate_rad_s, 2.0 * rotation_s, -ROTATION_RAD)
    back = Leg(0.0, rate_rad_s, rotation_s, 0.0)
    if compared is Compared.POSITIONS:
        return (left, *there_and_back, right, *there_and_back, back)
    return (left, right, back) if compared is Compared.NOTHING else (left, right, back, *there_and_back)


def arc_radius_m(mobility: Mobility, pace: Pace) -> float:
    """Return the radius of the arcs of a rover that cannot rotate on the spot."""
    return max(WIDER * mobility.turn_radius_m, pace.speed_m_s / pace.yaw_rate_rad_s)


def points_of(legs: tuple[Leg, ...]) -> tuple[Point, ...]:
    """Return points of the path of the origin in m, the start (0, 0) first."""
    place, yaw_rad, travel_m, points = 0j, 0.0, 0.0, [0j]
    for leg in legs:
        if leg.travel_m is not None:
            place += cmath.rect(leg.travel_m - travel_m, yaw_rad)
            travel_m = leg.travel_m
            points.append(place)
            continue
        if leg.yaw_rad is None:
            continue
        steps = max(1, round(abs(leg.yaw_rad - yaw_rad) / ARC_STEP_RAD))
        step_rad = (leg.yaw_rad - yaw_rad) / steps
        chord_m = 2.0 * math.sin(0.5 * step_rad) * leg.velocity_m_s / leg.yaw_rate_rad_s
        for _ in range(steps):
            place += cmath.rect(chord_m, yaw_rad + 0.5 * step_rad)
            yaw_rad += step_rad
            if leg.velocity_m_s:
                points.append(place)
    return tuple((round(point.real, 6), round(point.imag, 6)) for point in points)
