"""The path of the check manoeuvre ends where it began, and stays in the room that is stated."""

import math
from dataclasses import dataclass
from itertools import pairwise

import pytest

from controllers.check_manoeuvre.path import Compared, Pace, legs_of, points_of
from controllers.check_manoeuvre.plan import plan, room_of
from controllers.ground_motion.parameters import DEFAULTS
from controllers.motion.kinematics import make_kinematics
from controllers.roles import DeviceRoles
from controllers.safety.settings import SafetySettings
from tests.controllers.simulated import LONG_WAY, ROLES, make_settings

PACE = Pace(0.1, 0.2)
ON = SafetySettings(check_manoeuvre=True)


@dataclass
class Wheels:
    """What wheels let a rover do."""

    turns_on_spot: bool = True
    turn_radius_m: float = 0.0
    moves_sideways: bool = False
    crab_limit_rad: float = 0.0


@pytest.mark.parametrize("compared", Compared)
def test_a_rover_that_rotates_on_the_spot_rotates_to_both_sides_and_returns(compared: Compared) -> None:
    legs = legs_of(Wheels(), PACE, compared)
    yaws_deg = [math.degrees(leg.yaw_rad) for leg in legs if leg.yaw_rad is not None]
    assert yaws_deg == pytest.approx([20.0, -20.0, 0.0])
    points = points_of(legs)
    assert points[-1] == (0.0, 0.0)
    lengths_m = [math.hypot(*point) for point in points]
    assert max(lengths_m) == pytest.approx(0.0 if compared is Compared.NOTHING else 0.3)


def test_with_positions_it_drives_forth_and_back_at_both_ends_of_the_rotation() -> None:
    points = points_of(legs_of(Wheels(), PACE, Compared.POSITIONS))
    ends = [point for point in points if point != (0.0, 0.0)]
    assert ends == [
        pytest.approx((0.3 * math.cos(angle), 0.3 * math.sin(angle)), abs=1e-6)
        for angle in (math.radians(20.0), -math.radians(20.0))
    ]


@pytest.mark.parametrize(("turn_radius_m", "radius_m"), [(0.2, 0.5), (1.0, 1.1)])
def test_a_rover_that_cannot_drives_an_s_and_back_on_it(turn_radius_m: float, radius_m: float) -> None:
    legs = legs_of(Wheels(turns_on_spot=False, turn_radius_m=turn_radius_m), PACE, Compared.NOTHING)
    for leg in legs:
        assert abs(leg.velocity_m_s / leg.yaw_rate_rad_s) == pytest.approx(radius_m)
    points = points_of(legs)
    half = len(points) // 2
    assert points[half:] == tuple(pytest.approx(point, abs=1e-5) for point in points[half::-1])
    assert points[half][0] == pytest.approx(3.0 * radius_m * math.sin(math.radians(20.0)), abs=1e-4)
    assert max(abs(y_m) for _, y_m in points) < 0.13 * radius_m


def test_the_room_holds_path_body_and_margin() -> None:
    settings = make_settings(mission=LONG_WAY, safety=ON.model_copy(update={"area_body_m": 0.4}))
    room = room_of(settings, DeviceRoles(wheels="wheels", required={}, fixes=("camera",)))
    assert room.ahead_m == pytest.approx(0.3 * math.cos(math.radians(20.0)) + 0.5)
    assert room.behind_m == pytest.approx(0.5)
    assert room.aside_m == pytest.approx(0.3 * math.sin(math.radians(20.0)) + 0.5)


def test_without_the_setting_or_a_mission_nothing_is_driven() -> None:
    on, off = make_settings(mission=LONG_WAY, safety=ON), make_settings(mission=LONG_WAY)
    kinematics = make_kinematics(on.rover)
    assert plan(on, kinematics, ROLES)
    assert plan(off, kinematics, ROLES) == ()
    assert plan(make_settings(safety=ON), kinematics, ROLES) == ()


@pytest.mark.parametrize(
    ("mission_m_s", "stall_m_s", "speed_m_s", "rate_rad_s"),
    [(0.5, 0.02, 0.1, 0.25), (0.05, 0.02, 0.05, 0.25), (0.5, 0.1, 0.11, 0.88), (0.105, 0.1, 0.105, 0.88)],
)
def test_the_pace_is_slow_but_shows_a_stall(
    mission_m_s: float, stall_m_s: float, speed_m_s: float, rate_rad_s: float
) -> None:
    assert Pace.of(mission_m_s, stall_m_s, 0.125) == pytest.approx((speed_m_s, rate_rad_s))


@pytest.mark.parametrize("compared", Compared)
def test_the_manoeuvre_rotates_far_enough_to_confirm_the_scale_of_a_ground_camera(compared: Compared) -> None:
    on_spot = (leg.yaw_rad for leg in legs_of(Wheels(), PACE, compared) if not leg.velocity_m_s)
    yaws_rad = [0.0, *(yaw_rad for yaw_rad in on_spot if yaw_rad is not None)]
    rotated_deg = math.degrees(sum(abs(after - before) for before, after in pairwise(yaws_rad)))

    assert rotated_deg > 1.5 * DEFAULTS.mounting.confirming_deg
