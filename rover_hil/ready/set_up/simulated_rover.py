"""The simulated rover of a new configuration: [simulation] by what is known of the real one."""

import math
from typing import TypedDict

BOARDS = frozenset({"robotino_board", "robotino3_board"})
MASS_KG = 20.0
NO_LOAD_SHARE = 1.5
"""No-load speed of the motors over the greatest setpoint."""
CASTOR_SHARE = 0.6
"""A castor is this share of the track behind the axle."""
LOAD_SHARE = 0.2
"""The centre of mass is this share of the castor's distance behind the axle."""


class WheelTable(TypedDict, total=False):
    """A wheel of [[rover.wheels]]."""

    x_m: float
    y_m: float
    radius_m: float
    angle_deg: float
    roller_deg: float
    steering: dict[str, float]


class RoverTable(TypedDict, total=False):
    """The section [rover]."""

    kinematics: str
    wheel_radius_m: float
    base_radius_m: float
    track_m: float
    wheels: list[WheelTable]


def simulation_table(
    rover: RoverTable, drive: str, wheel_speed_rad_s: float, mass_kg: float = MASS_KG
) -> dict[str, object]:
    """Return the section [simulation] of a rover on a level floor.

    Mass, motors, castors and, of four wheels that do not steer, the distance of the axles are assumed.

    Args:
        rover: The section [rover].
        drive: Type of the device that turns the wheels.
        wheel_speed_rad_s: Greatest setpoint.
        mass_kg: Of the rover; that of a Robotino is known.
    """
    if drive in BOARDS:
        return {"seed": 1, "plant": {"type": "robotino", "site": "floor_table"}}
    plant: dict[str, object] = {"type": "wheels", "site": "floor_table", "mass_kg": mass_kg}
    motor = {"stall_torque_nm": 10.0, "no_load_rad_s": NO_LOAD_SHARE * wheel_speed_rad_s}
    wheels = wheels_of(rover)
    half_track_m = max(abs(wheel["y_m"]) for wheel in wheels)
    if len(wheels) == 2:
        castor_m = 2.0 * CASTOR_SHARE * half_track_m
        plant["castors"] = [{"x_m": -castor_m, "y_m": 0.0}]
        plant["centre_of_mass_x_m"] = -LOAD_SHARE * castor_m
    plant["wheels"] = [{**wheel, "motor": motor} for wheel in wheels]
    return {"seed": 1, "plant": plant}


def wheels_of(rover: RoverTable) -> list[WheelTable]:
    """Return the wheels of a section [rover] one by one."""
    if "wheels" in rover:
        return rover["wheels"]
    radius_m = rover["wheel_radius_m"]
    if rover["kinematics"] == "omni3":
        base_m = rover["base_radius_m"]
        return [
            {
                "x_m": base_m * math.cos(math.radians(angle_deg)),
                "y_m": base_m * math.sin(math.radians(angle_deg)),
                "radius_m": radius_m,
                "angle_deg": (angle_deg + 90.0) % 360.0,
                "roller_deg": 90.0,
            }
            for angle_deg in (60.0, 180.0, 300.0)
        ]
    half_m = 0.5 * rover["track_m"]
    return [
        {"x_m": ahead * half_m, "y_m": left * half_m, "radius_m": radius_m}
        for ahead in (1, -1)
        for left in (1, -1)
    ]
