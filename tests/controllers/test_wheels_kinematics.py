"""Kinematics of lists of wheels, against textbook formulas, the two shipped rovers, and themselves."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from controllers.matrices import product, pseudo_inverse
from controllers.motion.kinematics import make_kinematics
from controllers.motion.rover_geometry import OmniRoverSettings, SkidSteerRoverSettings, WheelsRoverSettings
from controllers.motion.wheel_constraints import rolling_row, side_row
from controllers.motion.wheel_settings import WheelSettings
from controllers.motion.wheels_kinematics import WheelsKinematics

# Wheels slower than 0.1 mm/s do not turn.
speeds = st.floats(-2.0, 2.0).filter(lambda speed: speed == 0.0 or abs(speed) > 1e-3)
RADIUS_M = 0.05


def wheel(x_m: float, y_m: float, **more: Any) -> dict[str, Any]:
    return {"x_m": x_m, "y_m": y_m, "radius_m": RADIUS_M, **more}


def rover(*wheels: dict[str, Any]) -> WheelsKinematics:
    return WheelsKinematics(WheelsRoverSettings.model_validate({"kinematics": "wheels", "wheels": wheels}))


def steered(low_deg: float = -100.0, high_deg: float = 100.0) -> dict[str, float]:
    return {"low_deg": low_deg, "high_deg": high_deg}


DIFFERENTIAL = (wheel(0.0, 0.15), wheel(0.0, -0.15))
FOUR_STEERED = tuple(wheel(x, y, steering=steered()) for x in (0.3, -0.3) for y in (0.2, -0.2))
SIX = tuple(
    wheel(x, y, **({"steering": steered(-70.0, 70.0)} if x else {}))
    for x in (0.35, 0.0, -0.35)
    for y in (0.2, -0.2)
)
MECANUM = tuple(
    wheel(x, y, roller_deg=math.copysign(45.0, x * y)) for x in (0.2, -0.2) for y in (0.15, -0.15)
)
CAR = (
    wheel(0.4, 0.15, driven=False, steering=steered(-35.0, 35.0)),
    wheel(0.4, -0.15, driven=False, steering=steered(-35.0, 35.0)),
    wheel(0.0, 0.15),
    wheel(0.0, -0.15),
)


@given(x=speeds, y=speeds, turn=speeds)
def test_a_differential_rover_is_that_of_the_textbook(x: float, y: float, turn: float) -> None:
    left, right = rover(*DIFFERENTIAL).wheel_speeds(x, y, turn)
    assert (left, right) == pytest.approx(
        ((x - 0.15 * turn) / RADIUS_M, (x + 0.15 * turn) / RADIUS_M), abs=1e-12
    )


def test_the_origin_of_a_rover_with_its_axle_behind_moves_sideways_in_a_turn() -> None:
    kinematics = rover(wheel(-0.1, 0.15), wheel(-0.1, -0.15))
    assert kinematics.body_motion((-3.0, 3.0)) == pytest.approx((0.0, 0.1, 1.0))


@given(x=speeds, y=speeds, turn=speeds)
def test_a_mecanum_rover_is_that_of_the_textbook(x: float, y: float, turn: float) -> None:
    arm = 0.2 + 0.15
    expected = [x - y - arm * turn, x + y + arm * turn, x + y - arm * turn, x - y + arm * turn]
    assert rover(*MECANUM).wheel_speeds(x, y, turn) == pytest.approx(
        [speed / RADIUS_M for speed in expected], abs=1e-9
    )


@given(forward=st.floats(0.05, 1.0), radius=st.floats(0.6, 20.0), side=st.sampled_from((-1.0, 1.0)))
def test_six_wheels_with_steered_corners_follow_ackermann(forward: float, radius: float, side: float) -> None:
    kinematics = rover(*SIX)
    centre = side * radius
    turn = forward / centre
    wanted = [0.0 if not x else math.atan(x / (centre - y)) for x in (0.35, 0.0, -0.35) for y in (0.2, -0.2)]
    assert kinematics.set_points(forward, 0.0, turn).steering_rad == pytest.approx(wanted, abs=1e-9)
    distances = [math.hypot(x, centre - y) for x in (0.35, 0.0, -0.35) for y in (0.2, -0.2)]
    expected = [abs(turn) * distance / RADIUS_M for distance in distances]
    assert kinematics.set_points(forward, 0.0, turn, wanted).speed_rad_s == pytest.approx(expected, abs=1e-9)


@given(x=speeds, y=speeds, turn=speeds)
def test_a_list_of_wheels_gives_the_numbers_of_the_omnidirectional_rover(
    x: float, y: float, turn: float
) -> None:
    shipped = make_kinematics(OmniRoverSettings(kinematics="omni3", wheel_radius_m=0.05, base_radius_m=0.125))
    listed = rover(
        *(
            wheel(
                0.125 * math.cos(math.radians(angle)),
                0.125 * math.sin(math.radians(angle)),
                angle_deg=angle + 90.0 if angle < 270.0 else angle - 270.0,
                roller_deg=90.0,
            )
            for angle in (60.0, 180.0, 300.0)
        )
    )
    assert listed.moves_sideways
    assert listed.wheel_speeds(x, y, turn) == pytest.approx(shipped.wheel_speeds(x, y, turn), abs=1e-9)
    assert listed.body_motion((x, y, turn)) == pytest.approx(shipped.body_motion((x, y, turn)), abs=1e-12)


@given(values=st.lists(speeds, min_size=4, max_size=4), base_m=st.floats(0.05, 1.0))
def test_a_list_of_wheels_gives_the_numbers_of_the_skid_steer_rover(
    values: list[float], base_m: float
) -> None:
    shipped = make_kinematics(
        SkidSteerRoverSettings(kinematics="skid_steer_4", wheel_radius_m=0.05, track_m=0.4)
    )
    listed = rover(*(wheel(x, y) for x in (base_m, -base_m) for y in (0.2, -0.2)))
    assert not listed.moves_sideways
    assert listed.skids_in_rotations is shipped.skids_in_rotations is True
    assert listed.wheel_speeds(*values[:3]) == pytest.approx(shipped.wheel_speeds(*values[:3]), abs=1e-9)
    assert listed.body_motion(values) == pytest.approx(shipped.body_motion(values), abs=1e-12)


places = st.tuples(st.floats(0.1, 0.5), st.floats(0.1, 0.5))


@st.composite
def random_rovers(draw: st.DrawFn) -> Sequence[dict[str, Any]]:
    """Return wheels of a random kind at random places, one in each quadrant and perhaps two in the middle."""
    kind = draw(st.sampled_from(("steered", "mecanum", "corners", "car")))
    wheels = []
    for x, y in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
        x_m, y_m = draw(places)
        more: dict[str, Any] = {"radius_m": draw(st.floats(0.03, 0.3))}
        if kind == "mecanum":
            more["roller_deg"] = x * y * draw(st.floats(30.0, 60.0))
        elif kind != "car" or x > 0:
            more["steering"] = steered(-180.0, 180.0)
        wheels.append(wheel(x * x_m, y * y_m, **more) | ({"x_m": -0.2} if kind == "car" and x < 0 else {}))
    if kind == "corners":
        wheels += [wheel(0.05, 0.3), wheel(0.05, -0.3)]
    return wheels


@settings(deadline=None, max_examples=25)
@given(wheels=random_rovers(), x=speeds, y=speeds, turn=speeds, present=st.floats(-1.5, 1.5))
def test_the_motion_of_the_set_points_is_the_wanted_one(
    wheels: Sequence[dict[str, Any]], x: float, y: float, turn: float, present: float
) -> None:
    kinematics = rover(*wheels)
    if not kinematics.moves_sideways:
        y = -turn * (0.05 if len(wheels) == 6 else -0.2)
    now = tuple(present if "steering" in entry else 0.0 for entry in wheels)
    angles = kinematics.set_points(x, y, turn, now).steering_rad
    there = kinematics.set_points(x, y, turn, angles)
    # At its angle a wheel stays there.
    assert there.steering_rad == pytest.approx(angles, abs=1e-9)
    assert kinematics.body_motion(there.speed_rad_s, angles) == pytest.approx((x, y, turn), abs=1e-6)
    residuals = kinematics.residuals(there.speed_rad_s, angles)
    assert residuals.rolling_m + residuals.side_m == pytest.approx([0.0] * 2 * len(wheels), abs=1e-6)
    assert all(abs(to - at) <= 0.5 * math.pi + 1e-9 for to, at in zip(angles or now, now, strict=True))


def test_a_wheel_reverses_its_drive_where_that_is_the_shorter_way() -> None:
    kinematics = rover(*FOUR_STEERED)
    back = kinematics.set_points(-0.2, 0.02, 0.0, (0.0,) * 4)
    assert back.steering_rad == pytest.approx((-math.atan(0.1),) * 4)
    assert all(speed < 0.0 for speed in back.speed_rad_s)


def test_the_drives_wait_until_the_wheels_have_steered() -> None:
    kinematics = rover(*FOUR_STEERED)
    turned = kinematics.set_points(0.0, 0.2, 0.0, (0.0,) * 4)
    assert [abs(angle) for angle in turned.steering_rad] == pytest.approx([math.pi / 2] * 4)
    assert turned.speed_rad_s == pytest.approx((0.0,) * 4)


def test_a_wheel_without_motion_keeps_its_steering_angle() -> None:
    kinematics = rover(*FOUR_STEERED)
    assert kinematics.set_points(0.0, 0.0, 0.0, (0.3,) * 4) == ((0.0,) * 4, (0.3,) * 4)


@pytest.mark.parametrize(
    ("wheels", "sideways", "spot", "radius_m"),
    [
        (DIFFERENTIAL, False, True, 0.0),
        (FOUR_STEERED, True, True, 0.0),
        (MECANUM, True, True, 0.0),
        # atan(0.35 / (R - 0.2)) = 70 deg
        (SIX, False, True, 0.2 + 0.35 / math.tan(math.radians(70.0))),
        (CAR, False, False, 0.15 + 0.4 / math.tan(math.radians(35.0))),
    ],
    ids=["differential", "four steered", "mecanum", "six", "car"],
)
def test_what_a_rover_can_do(
    wheels: Sequence[dict[str, Any]], sideways: bool, spot: bool, radius_m: float
) -> None:
    kinematics = rover(*wheels)
    assert (kinematics.moves_sideways, kinematics.turns_on_spot) == (sideways, spot)
    assert kinematics.turn_radius_m == pytest.approx(radius_m, rel=0.025)


def test_a_blocked_wheel_contradicts_the_others() -> None:
    kinematics = rover(*SIX)
    rolling = kinematics.residuals((1.0, 1.0, 1.0, 0.0, 1.0, 1.0)).rolling_m
    assert max(map(abs, rolling)) == -rolling[3]
    assert kinematics.residuals((1.0,) * 6).redundant > 0
    assert rover(*DIFFERENTIAL).residuals((1.0, 2.0)).redundant == 0


@pytest.mark.parametrize(
    ("wheels", "text"),
    [
        ((wheel(0.0, 0.1), wheel(0.0, 0.1)), "wheels 0 and 1 are at one place"),
        ((wheel(0.0, 0.1, driven=False), wheel(0.0, -0.1, driven=False)), "no wheel is driven"),
        ((wheel(0.0, 0.1), wheel(0.0, -0.1, driven=False)), "but motors and steering control 1"),
        ((wheel(0.0, 0.1), wheel(0.0, -0.1, angle_deg=20.0)), "wheels 0 and 1 roll in different directions"),
        ((wheel(0.0, 0.1, angle_deg=90.0), wheel(0.0, -0.1, angle_deg=90.0)), "straight motion along x"),
        (
            (wheel(0.0, 0.1, roller_deg=90.0), wheel(0.0, -0.1, roller_deg=90.0)),
            "they allow 3 independent motions, but motors and steering control 2",
        ),
        ((wheel(0.0, 0.1, roller_deg=0.0), wheel(0.0, -0.1)), "nothing turns the wheel"),
        (
            (*DIFFERENTIAL, wheel(0.0, 0.3, angle_deg=90.0, roller_deg=90.0, driven=False)),
            "wheel 2 is turned by nothing",
        ),
        ((wheel(0.0, 0.1, steering=steered(), roller_deg=45.0), wheel(0.0, -0.1)), "does not steer"),
        ((wheel(0.0, 0.1, steering=steered(0.0, 0.5)), wheel(0.0, -0.1)), "steers by less than 1 deg"),
    ],
)
def test_wheels_that_cannot_drive_are_refused(wheels: Sequence[dict[str, Any]], text: str) -> None:
    with pytest.raises(ValidationError, match=text):
        rover(*wheels)


def test_noise_of_nearly_straight_wheels_does_not_move_the_rover_sideways() -> None:
    rng = np.random.default_rng(1)
    values = 1.0 + 0.01 * rng.standard_normal(6)
    x, y, turn = rover(*SIX).body_motion(values.tolist(), (0.002,) * 6)
    assert x == pytest.approx(RADIUS_M, rel=0.01)
    assert abs(y) < 1e-3 * RADIUS_M * 5
    assert abs(turn) < 0.01


EIGHT = tuple(wheel(x, y, steering=steered()) for x in (0.6, 0.2, -0.2, -0.6) for y in (0.3, -0.3))
BICYCLE = (wheel(0.0, 0.0), wheel(0.9, 0.0, steering=steered(), driven=False, measured=False))


@pytest.mark.parametrize(
    "wheels", [CAR, FOUR_STEERED, EIGHT, BICYCLE], ids=["car", "four", "eight", "bicycle"]
)
@given(data=st.data())
def test_the_least_squares_are_those_of_arrays_to_the_last_bit(
    wheels: tuple[dict[str, Any], ...], data: st.DataObject
) -> None:
    """Logs of earlier versions, which computed with arrays, replay exactly."""
    angles = [data.draw(st.floats(-1.5, 1.5)) if "steering" in settings else 0.0 for settings in wheels]
    values = data.draw(st.lists(speeds, min_size=len(wheels), max_size=len(wheels)))
    kinematics = rover(*wheels)
    pairs = [
        (WheelSettings.model_validate(settings), angle)
        for settings, angle in zip(wheels, angles, strict=True)
    ]
    measured = [index for index, settings in enumerate(wheels) if settings.get("measured", True)]
    rolling = np.array([rolling_row(*pair) for pair in pairs])
    side = np.array([side_row(*pair) for pair in pairs])
    inverse = pseudo_inverse(np.vstack((rolling[measured], side)), 1e-9)[:, : len(measured)]
    to_body = np.zeros((3, len(wheels)))
    to_body[:, measured] = inverse * RADIUS_M
    motion = product(to_body, np.array(values))
    assert kinematics.body_motion(values, angles) == tuple(motion.tolist())
    assert kinematics.wheel_effects(angles) == tuple(map(tuple, to_body.T.tolist()))
    residuals = kinematics.residuals(values, angles)
    assert residuals.side_m == tuple((-product(side, motion)).tolist())
    left = RADIUS_M * np.array(values) - product(rolling, motion)
    assert [residuals.rolling_m[wheel] for wheel in measured] == left[measured].tolist()
