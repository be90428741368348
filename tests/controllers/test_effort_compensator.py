"""Slip of the wheels from known efforts, and where no slip may be given."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from controllers.estimation.settings import FilterSettings
from controllers.estimator import Estimator
from controllers.slip.effort.compensator import SlipReport
from controllers.slip.effort.excited_slip import (
    GAVE_UP,
    RESTS,
    TOO_LITTLE_TRAVEL,
    UNKNOWN_GYRO,
    RoverSlip,
)
from controllers.slip.effort.gyro_response import GyroResponse
from controllers.slip.effort.parameters import EFFORT
from controllers.slip.effort.slip_bracket import FALLING_TRACTION, IDLE_WHEELS, IN_NOISE
from controllers.slip.effort.yaw_excitation import SPRINGS, TOO_FEW_READINGS, WHEELS_DO_NOT_FOLLOW
from drivers.samples import WheelSample
from tests.controllers.simulated import MS, ROLES
from tests.controllers.slip_bench import (
    BOTH,
    KINEMATICS,
    PERIOD_S,
    PRIOR,
    Bench,
    line_bench,
    own_reasons,
    wheel_speeds,
)


@pytest.mark.parametrize(("force_n", "surface", "slip"), [(5.0, "firm", 0.1), (25.0, "soft", 0.5)])
@pytest.mark.parametrize("direction_rad", [-2.5, 0.0, 0.4, 1.6])
def test_surfaces_tell_the_slip_of_all_wheels(
    force_n: float, surface: str, slip: float, direction_rad: float
) -> None:
    bench = Bench(known=BOTH)
    report = bench.drive(force_n, 3.0, direction_rad=direction_rad)
    assert (report.map, report.surface) == ("surfaces", surface)
    assert [wheel.slip for wheel in report.wheels] == pytest.approx([slip] * 3, abs=0.01)
    assert all(wheel.valid and not wheel.reason for wheel in report.wheels)
    assert bench.told.is_sure
    velocity = complex(*bench.slip.body_motion(wheel_speeds(direction_rad, 0.2))[:2])
    assert abs(velocity) == pytest.approx(0.2 * (1.0 - slip), abs=0.002)
    assert math.atan2(velocity.imag, velocity.real) == pytest.approx(direction_rad, abs=1e-9)


@pytest.mark.parametrize(("force_n", "slip"), [(5.0, 0.1), (25.0, 0.5)])
def test_until_a_surface_is_recognised_the_wheels_count_as_rolling(force_n: float, slip: float) -> None:
    bench = Bench(known=BOTH)
    bench.drive(force_n, 1.46)
    assert abs(bench.way) == pytest.approx(1.46 * 0.2, rel=1e-6)
    was_sure = bench.told.is_sure
    # The window in which the surface is recognised is made up.
    bench.drive(force_n, 0.64)
    assert abs(bench.way) == pytest.approx(1.5 * 0.2 + 0.6 * 0.2 * (1.0 - slip), rel=0.03)
    assert (was_sure, bench.told.is_sure) == (False, True)


def test_on_a_new_surface_the_old_one_ends_at_once() -> None:
    bench = Bench(known=BOTH)
    bench.drive(5.0, 3.0)
    was_sure = bench.told.is_sure
    bench.drive(25.0, 1.1)
    assert (was_sure, bench.told.is_sure) == (True, False)
    bench.drive(25.0, 2.0)
    before = abs(bench.way)
    bench.drive(25.0, 1.0)
    assert abs(bench.way) - before == pytest.approx(0.2 * 0.5, rel=0.01)


def test_a_force_that_scatters_more_than_on_the_surface_is_not_recognised() -> None:
    bench = Bench(known=BOTH)
    for _ in range(4):
        bench.drive(23.0, 0.5)
        report = bench.drive(27.0, 0.5)
    assert not any(wheel.valid for wheel in report.wheels)
    assert "scatter" in report.wheels[0].reason


@pytest.mark.parametrize("use", ["surfaces", "line"])
def test_force_alone_does_not_tell_a_soft_surface_from_firm_ground_with_resistance(use: str) -> None:
    bench = Bench(use=use)
    report = bench.drive(25.0, 4.0)
    assert rover_slip(report).source == "encoders"
    assert "soft (slip 0.50), firm ground with resistance" in rover_slip(report).reason
    assert {wheel.slip for wheel in report.wheels} == {0.0}
    assert not bench.told.is_sure
    assert Bench(known=("soft",)).drive(25.0, 4.0).wheels[0].valid


def test_on_unknown_ground_the_map_is_used_where_the_user_wants_it_but_not_valid() -> None:
    bench = Bench(unknown_ground="map")
    report = bench.drive(25.0, 3.0)
    assert [wheel.slip for wheel in report.wheels] == pytest.approx([0.5] * 3, abs=0.01)
    assert not any(wheel.valid for wheel in report.wheels)


def test_a_wheel_map_that_contradicts_the_recognised_surface_is_not_valid() -> None:
    assert rover_slip(Bench(use="line", known=("soft",)).drive(25.0, 4.0)).reason == ""
    bench = Bench(use="line", known=("soft",), slip_per_a=0.3)
    report = bench.drive(25.0, 8.0)
    x_m_s, y_m_s, _ = bench.slip.body_motion(wheel_speeds(0.4, 0.2))
    assert "line gives a slip of" in rover_slip(report).reason
    assert math.hypot(x_m_s, y_m_s) == pytest.approx(0.1, abs=0.005)


def test_drift_turns_the_course_to_the_left() -> None:
    bench = Bench(drift_rad=0.2, known=BOTH)
    report = bench.drive(25.0, 4.0, direction_rad=0.4)
    assert report.drift_rad == pytest.approx(0.2)
    x_m_s, y_m_s, _ = bench.slip.body_motion(wheel_speeds(0.4, 0.2))
    assert math.atan2(y_m_s, x_m_s) == pytest.approx(0.6)
    assert math.hypot(x_m_s, y_m_s) == pytest.approx(0.1, abs=0.002)


def test_a_rover_that_is_told_the_surface_keeps_to_it() -> None:
    report = Bench(known=("soft",)).drive(25.0, 2.0)
    assert report.surface == "soft"
    assert report.wheels[0].slip == pytest.approx(0.5)
    report = Bench(known=("soft",)).drive(5.0, 2.0)
    assert report.surface is None
    assert "unknown surface" in report.wheels[0].reason


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_wheel_map_reads_each_wheel_whatever_its_direction(sign: float) -> None:
    bench = line_bench()
    for _ in range(60):
        report = bench.step((sign * 3.0, sign * 3.0, sign * 3.0), (sign * 0.4, sign * 0.8, sign * 1.2))
    assert [wheel.slip for wheel in report.wheels] == pytest.approx([0.2, 0.4, 0.6], abs=1e-3)
    assert [wheel.current_a for wheel in report.wheels] == pytest.approx([sign * a for a in (0.4, 0.8, 1.2)])
    assert own_reasons(report) == ["", "", ""]
    expected = KINEMATICS.body_motion([sign * 3.0 * (1.0 - slip) for slip in (0.2, 0.4, 0.6)])
    assert bench.slip.body_motion((sign * 3.0,) * 3) == pytest.approx(expected, abs=1e-3)


def test_an_unsigned_current_takes_the_sign_of_its_wheel() -> None:
    signed, unsigned = line_bench(), line_bench(is_signed=False)
    speeds, currents = (3.0, -3.0, 2.0), (0.5, -0.9, 0.7)
    for _ in range(60):
        expected = signed.step(speeds, currents)
        report = unsigned.step(speeds, [abs(current_a) for current_a in currents])
    assert report == expected
    assert report.wheels[1].wheel_torque_nm < 0.0 < report.wheels[0].wheel_torque_nm


def test_an_unsigned_current_is_not_used_while_the_wheel_brakes() -> None:
    bench = line_bench(is_signed=False)
    for _ in range(60):
        bench.step((3.0, 3.0, 3.0), (0.8, 0.8, 0.8))
    report = bench.step((3.0, 3.0, 3.0), (0.8, 0.8, 0.8), set_points=(1.0, 3.0, 3.0))
    assert report.wheels[0].reason == "braking: the sign of the current is unknown"
    assert own_reasons(report)[1:] == ["", ""]
    assert not bench.slip.knows_force


def test_effort_beyond_the_training_range_is_flagged_and_held() -> None:
    bench = line_bench()
    for _ in range(60):
        report = bench.step((3.0, 3.0, 3.0), (0.8, 0.8, 2.0))
    assert own_reasons(report)[:2] == ["", ""]
    assert report.wheels[2].reason == "current_a of 2 is outside the training range"
    assert report.wheels[2].slip == pytest.approx(0.75)
    assert not bench.told.is_sure


def test_a_slip_that_cannot_be_found_decays_to_that_of_the_surface() -> None:
    bench = line_bench()
    for _ in range(100):
        bench.step((3.0, 3.0, 3.0), (1.4, 1.4, 1.4))
    held = []
    for _ in range(round(EFFORT.hold.hold_s / PERIOD_S)):
        report = bench.step((3.0, 3.0, 3.0), (None, 1.4, 1.4))
        held.append(report.wheels[0].slip)
    assert (report.wheels[0].valid, report.wheels[0].reason) == (False, "no current")
    assert held[0] == pytest.approx(0.7, abs=0.01)
    assert held[-1] - PRIOR == pytest.approx((0.7 - PRIOR) / math.e, rel=0.02)
    assert report.wheels[1].slip == pytest.approx(0.7, abs=1e-3)
    for _ in range(500):
        report = bench.step((3.0, 3.0, 3.0), (None, 1.4, 1.4))
    assert report.wheels[0].slip == pytest.approx(PRIOR, abs=1e-3)


def test_a_slow_wheel_is_held_too() -> None:
    bench = line_bench()
    for _ in range(100):
        bench.step((3.0, 3.0, 3.0), (1.0, 1.0, 1.0))
    for _ in range(60):
        report = bench.step((3.0, 3.0, 0.3), (1.0, 1.0, 1.0))
    assert report.wheels[2].reason == "wheel too slow"
    assert PRIOR < report.wheels[2].slip < 0.5


def test_a_wheel_that_rests_as_told_leaves_the_rover_sure() -> None:
    # Straight ahead the rear wheel stands, and what stands adds no way.
    speeds = (-3.0, 0.0, 3.0)
    bench = Bench(use="line", known=("soft",))
    for _ in range(120):
        report = bench.step(speeds, (-0.9, 0.1, 0.9))
    assert [wheel.reason for wheel in report.wheels] == ["", "wheel too slow", ""]
    assert bench.told.is_sure
    # One that was commanded to turn may be held, or dragged.
    bench.step(speeds, (-0.9, 0.1, 0.9), set_points=(-3.0, 1.0, 3.0))
    is_sure = [bench.told.is_sure]
    bench.step(speeds, (-0.9, None, 0.9))
    is_sure.append(bench.told.is_sure)
    assert is_sure == [False, False]


@pytest.mark.parametrize("use", ["surfaces", "yaw_probe"])
def test_a_rover_at_rest_is_sure_of_nothing_where_slip_is_told_for_all(use: str) -> None:
    bench = Bench(use=use)
    for _ in range(60):
        bench.step((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    assert not bench.told.is_sure


def test_the_slip_of_a_recognised_surface_is_kept_while_the_force_is_unknown() -> None:
    bench = Bench(known=BOTH)
    bench.drive(25.0, 3.0)
    report = bench.drive(25.0, 1.0, fault={1: None})
    assert {wheel.reason for wheel in report.wheels} == {"no current"}
    assert not any(wheel.valid for wheel in report.wheels)
    assert not bench.told.is_sure
    assert [wheel.slip for wheel in report.wheels] == pytest.approx([0.5] * 3, abs=0.01)
    report = bench.drive(25.0, 8.0, fault={1: None})
    assert rover_slip(report).source == "encoders"


def test_a_window_with_a_gap_is_begun_again() -> None:
    bench = Bench()
    bench.drive(25.0, 0.4)
    bench.drive(25.0, PERIOD_S, fault={1: None})
    assert bench.drive(25.0, 0.4).surface is None
    assert bench.drive(25.0, 0.2).surface == "soft"


def test_a_stuck_wheel_slips_by_one() -> None:
    bench = line_bench()
    for _ in range(50):
        bench.step((3.0, 3.0, 3.0), (0.8, 0.8, 0.8))
    reasons = []
    for _ in range(50):
        report = bench.step((0.0, 3.0, 3.0), (2.5, 0.8, 0.8), set_points=(3.0, 3.0, 3.0))
        reasons.append(report.wheels[0].reason)
    assert (report.wheels[0].slip, report.wheels[0].valid, reasons[-1]) == (1.0, False, "stuck")
    assert report.wheels[0].paper_torque_nm > 0.1  # a stalled wheel does not report "no effort"
    assert own_reasons(report)[1:] == ["", ""]
    # Its filtered speed takes a while to fall to nothing, and then it may still be starting.
    assert EFFORT.stuck.after_s < reasons.index("stuck") * PERIOD_S < EFFORT.stuck.after_s + 0.7
    report = bench.step((3.0, 3.0, 3.0), (0.8, 0.8, 0.8))
    assert report.wheels[0].reason != "stuck"


def test_a_stuck_wheel_is_noticed_with_every_map() -> None:
    for use in ("surfaces", "yaw_probe"):
        bench = Bench(use=use)
        for _ in range(80):
            report = bench.step((0.0, 0.0, 0.0), (2.5, 0.1, 0.1), set_points=(3.0, 0.0, 0.0))
        assert [wheel.reason == "stuck" for wheel in report.wheels] == [True, False, False]


@pytest.mark.parametrize(
    ("speed", "current_a", "set_point"),
    [(0.35, 2.5, 3.0), (0.1, 1.0, 0.6), (0.0, 0.3, 3.0), (0.0, 2.5, 0.3), (0.0, None, 3.0)],
    ids=[
        "slow but turning",
        "creeping by the droop of its loop",
        "no effort",
        "told to stand",
        "current unknown",
    ],
)
def test_other_wheels_are_not_stuck(speed: float, current_a: float | None, set_point: float) -> None:
    bench = line_bench()
    for _ in range(100):
        report = bench.step((speed, 3.0, 3.0), (current_a, 0.8, 0.8), set_points=(set_point, 3.0, 3.0))
        assert report.wheels[0].reason != "stuck"
    assert not report.wheels[0].valid
    assert report.wheels[0].slip < 1.0


def test_without_any_current_nothing_is_valid() -> None:
    bench = Bench()
    report = bench.drive(5.0, 2.0, fault={0: None, 1: None, 2: None})
    assert {(wheel.valid, wheel.reason, wheel.slip) for wheel in report.wheels} == {
        (False, "no current", 0.0)
    }
    assert report.surface is None
    assert not bench.slip.knows_force


@pytest.mark.parametrize("current_a", [None, math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("use", ["surfaces", "line"])
def test_one_current_missing_from_the_start(use: str, current_a: float | None) -> None:
    bench = Bench(use=use)
    report = bench.drive(5.0, 2.0, fault={2: current_a})
    assert (report.wheels[2].valid, report.wheels[2].reason) == (False, "no current")
    assert all(math.isfinite(wheel.slip) and math.isfinite(wheel.current_a) for wheel in report.wheels)
    assert not bench.slip.knows_force


def test_a_current_that_is_not_finite_leaves_no_trace() -> None:
    bench = line_bench()
    for _ in range(60):
        bench.step((3.0, 3.0, 3.0), (0.8, 0.8, 0.8))
    report = bench.step((3.0, 3.0, 3.0), (math.nan, 0.8, 0.8))
    assert report.wheels[0].reason == "no current"
    report = bench.step((3.0, 3.0, 3.0), (0.8, 0.8, 0.8))
    assert own_reasons(report) == ["", "", ""]
    assert report.wheels[0].slip == pytest.approx(0.4, abs=0.01)


@pytest.mark.parametrize("use", ["surfaces", "line"])
def test_a_saturated_current_is_flagged(use: str) -> None:
    bench = Bench(use=use)
    bench.drive(25.0, 2.0)
    report = bench.drive(25.0, 0.5, fault={0: 4.0})
    assert (report.wheels[0].valid, report.wheels[0].reason) == (False, "current saturated")
    assert not bench.slip.knows_force
    assert not bench.told.is_sure


@pytest.mark.parametrize("use", ["surfaces", "line"])
def test_a_direction_outside_the_training_range_is_flagged(use: str) -> None:
    bench = Bench(use=use, directions_rad=(0.0, 0.5))
    assert bench.drive(5.0, 2.0, direction_rad=0.2).wheels[0].valid
    report = bench.drive(5.0, 2.0, direction_rad=2.0)
    assert not any(wheel.valid for wheel in report.wheels)
    assert report.wheels[0].reason == "direction 115 deg is outside the training range"


FREQUENCY_HZ = 2.0
HALF = math.pi * FREQUENCY_HZ * PERIOD_S
MEAN = math.sin(HALF) / HALF
"""Of a sinusoid over a period, over its value in the middle."""
SWING_RAD_S = 0.24
FAST = GyroResponse(source="by hand", identified_on="2026-01-01")


PUSHING = (-0.9, 0.0, 0.9)
"""Currents that push the rover ahead with 25 N."""


def excite(
    bench: Bench,
    lost: float,
    duration_s: float,
    *,
    has_gyro: bool = True,
    speed_m_s: float = 0.15,
    late_s: float = 0.0,
    swing_rad_s: float = SWING_RAD_S,
    currents: tuple[float, float, float] = PUSHING,
) -> SlipReport:
    """Go ahead with a yaw excitation of which `lost` does not reach the body; the gyro is late."""
    for _ in range(round(duration_s / PERIOD_S)):
        angle = math.tau * FREQUENCY_HZ * (bench.t_ns * 1e-9 + PERIOD_S)
        speeds = KINEMATICS.wheel_speeds(speed_m_s, 0.0, swing_rad_s * MEAN * math.sin(angle - HALF))
        gyro = (1.0 - lost) * swing_rad_s * math.sin(angle - math.tau * FREQUENCY_HZ * late_s)
        report = bench.step(speeds, currents, gyro_rate_rad_s=gyro if has_gyro else None)
    return report


def excited_bench(
    *, learn: bool = False, rest_s: float = 0.0, fixes: tuple[str, ...] = (), gyro: GyroResponse | None = FAST
) -> Bench:
    """Return a bench that reads slip from the excitation, with a gyro of known constants."""
    return Bench(use="yaw_probe", learn=learn, rest_s=rest_s, fixes=fixes, gyro_response=gyro)


def rover_slip(report: SlipReport) -> RoverSlip:
    assert report.rover is not None
    return report.rover


def test_the_excitation_gives_the_slip_of_all_wheels() -> None:
    """A loss of 0.4 without lag is the slip of a contact whose traction depends on the slip ratio."""
    bench = excited_bench()
    excite(bench, 0.4, 1.1)
    before = bench.way.real
    report = excite(bench, 0.4, 2.0)
    assert [wheel.slip for wheel in report.wheels] == pytest.approx([0.4] * 3, abs=1e-3)
    assert all(wheel.valid for wheel in report.wheels)
    assert bench.way.real - before == pytest.approx(2.0 * 0.15 * 0.6, rel=0.01)
    assert report.drift_rad == 0.0
    assert (rover_slip(report).source, rover_slip(report).unsure) == ("excitation", "")


def test_a_window_corrects_the_travel_in_it() -> None:
    bench = excited_bench()
    excite(bench, 0.4, 1.02)
    assert bench.way.real == pytest.approx(1.02 * 0.15 * 0.6, rel=0.05)


def test_before_it_travels_no_slip_is_valid() -> None:
    bench = excited_bench()
    report = excite(bench, 0.2, 2.0, speed_m_s=0.0)
    assert {wheel.reason for wheel in report.wheels} == {TOO_LITTLE_TRAVEL}
    assert rover_slip(report).slip == 0.0
    valid = excite(bench, 0.3, 2.0)
    assert rover_slip(excite(bench, 0.3, 1.0, speed_m_s=0.0)) == rover_slip(valid)


def test_with_the_force_of_the_currents_a_lag_is_slip() -> None:
    """The bracket for the force of the currents; more force, more slip."""
    slips = [
        rover_slip(excite(excited_bench(), 0.0, 2.0, late_s=0.02, currents=currents)).slip
        for currents in ((-0.5, 0.0, 0.5), PUSHING)
    ]
    assert 0.02 < slips[0] < 0.7 * slips[1] < 0.3


def test_a_gyro_that_was_not_calibrated_widens_the_deviation_and_says_so() -> None:
    unknown, known = Bench(use="yaw_probe"), excited_bench()
    unsure = rover_slip(excite(unknown, 0.3, 2.0, late_s=0.03))
    sure = rover_slip(excite(known, 0.3, 2.0, late_s=0.03))
    assert (unsure.unsure, sure.unsure) == (UNKNOWN_GYRO, "")
    assert "calibrate imu" in UNKNOWN_GYRO
    assert unsure.slip < sure.slip
    assert unsure.sd > sure.sd
    assert unsure.reason == ""


def test_the_constants_of_the_gyro_are_taken_out_of_the_response() -> None:
    gyro = GyroResponse(source="by hand", identified_on="2026-01-01", gain=0.9, delay_s=0.04)
    report = excite(excited_bench(gyro=gyro), 1.0 - 0.9 * 0.6, 2.0, late_s=0.04)
    assert rover_slip(report).reason == ""
    assert rover_slip(report).slip == pytest.approx(0.4, abs=0.01)


def test_responses_that_say_nothing_about_slip_are_not_valid() -> None:
    idle = (-0.25, 0.0, 0.25)
    reasons = [
        rover_slip(excite(excited_bench(), 0.3, 2.0, late_s=0.08, currents=idle)).reason,
        rover_slip(excite(excited_bench(), 0.0, 2.0, late_s=-0.02)).reason,
        rover_slip(excite(excited_bench(), 1.0, 2.0)).reason,
    ]
    assert reasons == [IDLE_WHEELS, FALLING_TRACTION, IN_NOISE]


def test_where_the_drives_do_not_follow_the_excitation_is_off_for_good() -> None:
    bench = excited_bench()
    excited = bench.slip.excited
    assert excited is not None
    weak = 0.3 * SWING_RAD_S
    excited.yaw_rate_rad_s(100.0)
    report = excite(bench, 0.2, 2.0, swing_rad_s=weak)
    assert {wheel.reason for wheel in report.wheels} == {WHEELS_DO_NOT_FOLLOW}
    assert excited.yaw_rate_rad_s(100.1) != 0.0
    excite(bench, 0.2, 3.0, swing_rad_s=weak, speed_m_s=0.0)
    assert excited.yaw_rate_rad_s(100.1) != 0.0
    report = excite(bench, 0.2, 4.0, swing_rad_s=weak)
    assert excited.yaw_rate_rad_s(100.1) == 0.0
    report = excite(bench, 0.2, 2.0)
    assert {wheel.reason for wheel in report.wheels} == {GAVE_UP}


def test_while_a_camera_measures_the_slip_the_drives_are_not_blamed_for_the_missing_swing() -> None:
    bench = excited_bench()
    excited = bench.slip.excited
    assert excited is not None
    excited.yaw_rate_rad_s(100.0)
    for second in range(6):
        excited.leave_out(101.0 + second)
        report = excite(bench, 0.2, 1.0, swing_rad_s=0.0)
    assert {wheel.reason for wheel in report.wheels} == {RESTS}
    excited.yaw_rate_rad_s(107.0)
    assert excited.yaw_rate_rad_s(107.1) != 0.0
    assert rover_slip(excite(bench, 0.2, 2.0)).slip == pytest.approx(0.2, abs=1e-3)


def test_with_pose_fixes_the_wheels_count_as_rolling_until_no_fix_comes() -> None:
    bench = excited_bench(fixes=("overhead",))
    for second in range(3):
        bench.fix(0.15 * second)
        report = excite(bench, 0.4, 1.0)
    assert rover_slip(report).slip == pytest.approx(0.4, abs=1e-3)
    assert {wheel.slip for wheel in report.wheels} == {0.0}
    assert not bench.told.is_sure
    assert bench.way.real == pytest.approx(3.0 * 0.15, rel=1e-6)
    report = excite(bench, 0.4, EFFORT.fixes.absent_s + 1.0)
    assert [wheel.slip for wheel in report.wheels] == pytest.approx([0.4] * 3, abs=1e-3)


def test_pose_fixes_that_never_come_measure_nothing() -> None:
    report = excite(excited_bench(fixes=("overhead",)), 0.4, 3.0)
    assert [wheel.slip for wheel in report.wheels] == pytest.approx([0.4] * 3, abs=1e-3)


def test_the_excitation_needs_a_gyro_and_no_currents() -> None:
    bench = excited_bench()
    report = excite(bench, 0.4, 3.0)
    report = excite(bench, 0.4, 2.0, has_gyro=False)
    assert {wheel.reason for wheel in report.wheels} == {TOO_FEW_READINGS}
    assert rover_slip(report).source == "held"
    assert 0.2 < report.wheels[0].slip < 0.35
    report = excite(bench, 0.4, 20.0, has_gyro=False)
    assert (rover_slip(report).source, rover_slip(report).slip) == ("encoders", 0.0)


def test_a_surface_that_the_user_named_comes_before_the_held_slip() -> None:
    bench = Bench(use="yaw_probe", known=("soft",))
    report = bench.drive(25.0, 6.0)
    assert rover_slip(report).source == "map"
    assert rover_slip(report).slip == pytest.approx(0.5)
    assert rover_slip(report).sd == pytest.approx(EFFORT.recognition.slip_sd)
    assert all(wheel.valid for wheel in report.wheels)


def test_the_learned_curve_carries_the_slip_while_the_excitation_rests() -> None:
    bench = excited_bench(learn=True, rest_s=6.0)
    excited = bench.slip.excited
    assert excited is not None
    excite(bench, 0.4, 4.02)
    t_s = bench.t_ns * 1e-9
    excited.yaw_rate_rad_s(t_s)
    excite(bench, 0.4, 1.0)
    assert excited.yaw_rate_rad_s(t_s + 0.05) == 0.0
    report = excite(bench, 0.4, 1.5, has_gyro=False)
    assert (rover_slip(report).source, rover_slip(report).reason) == ("learned", "")
    assert rover_slip(report).slip == pytest.approx(0.4, abs=0.01)
    assert EFFORT.learning.sd < rover_slip(report).sd < EFFORT.learning.greatest_sd
    without = excited_bench()
    excite(without, 0.4, 2.5)
    assert rover_slip(excite(without, 0.4, 1.5, has_gyro=False)).source == "held"


def test_a_gyro_that_was_wrong_takes_its_slip_and_the_learned_curve_with_it() -> None:
    bench = excited_bench(learn=True)
    excite(bench, 0.4, 3.5)
    bench.slip.forget_gyro()
    first = excite(bench, 0.4, 0.02)
    assert rover_slip(first).slip == 0.0
    assert (rover_slip(first).source, rover_slip(first).reason) == ("encoders", "the gyro was wrong")
    assert {(wheel.slip, wheel.valid) for wheel in first.wheels} == {(0.0, False)}
    later = excite(bench, 0.4, 1.5, has_gyro=False)
    assert (rover_slip(later).source, rover_slip(later).slip) == ("encoders", 0.0)


def test_a_gyro_that_was_wrong_takes_what_was_learned_between_fixes_with_it() -> None:
    bench = Bench(learn=True, fixes=("overhead",))
    for second in range(6):
        bench.drive(18.0, 1.0, direction_rad=0.0)
        bench.fix(0.2 * (second + 1) * (1.0 - 0.3))
    bench.slip.forget_gyro()
    report = bench.drive(18.0, 0.6, direction_rad=0.0)
    assert rover_slip(report).source != "learned"
    assert rover_slip(report).reason != ""


def test_a_rest_needs_a_learned_curve() -> None:
    with pytest.raises(ValidationError, match="excitation_rest_s needs learn = true"):
        Bench(use="surfaces", rest_s=1.0)


def test_slip_over_force_is_learned_from_pose_fixes() -> None:
    bench = Bench(learn=True, fixes=("overhead",))
    for second in range(6):
        report = bench.drive(18.0, 1.0, direction_rad=0.0)
        bench.fix(0.2 * (second + 1) * (1.0 - 0.3))
    report = bench.drive(18.0, 0.6, direction_rad=0.0)
    assert (rover_slip(report).source, rover_slip(report).reason) == ("learned", "")
    assert rover_slip(report).slip == pytest.approx(0.3, abs=0.02)
    report = bench.drive(30.0, 0.6, direction_rad=0.0)
    assert rover_slip(report).reason != ""


def test_the_excitation_pauses_where_the_contact_springs() -> None:
    bench = excited_bench()
    excited = bench.slip.excited
    assert excited is not None
    excited.yaw_rate_rad_s(100.0)
    assert excited.yaw_rate_rad_s(100.05) != 0.0
    report = excite(bench, -0.6, 1.1)
    assert {wheel.reason for wheel in report.wheels} == {SPRINGS}
    assert [excited.yaw_rate_rad_s(t_s) for t_s in (100.15, 105.04)] == [0.0, 0.0]
    excited.yaw_rate_rad_s(105.15)
    assert excited.yaw_rate_rad_s(105.2) != 0.0


def test_only_the_yaw_probe_excites_the_yaw() -> None:
    assert Bench(use="yaw_probe").slip.excited is not None
    assert Bench(use="surfaces").slip.excited is None
    assert Bench(use="line").slip.excited is None


def test_stale_currents_are_none() -> None:
    bench = line_bench()
    for _ in range(60):
        bench.step((3.0, 3.0, 3.0), (0.8, 0.8, 0.8))
    bench.t_ns -= 10_000 * MS
    report = bench.step((3.0, 3.0, 3.0), (0.1, 0.1, 0.1))
    assert {(wheel.valid, wheel.reason) for wheel in report.wheels} == {(False, "no current")}
    assert report.wheels[0].slip == pytest.approx(0.4, abs=0.01)


def test_a_clock_that_goes_backwards_moves_nothing() -> None:
    compensator = Bench(use="line").slip
    estimator = Estimator(KINEMATICS, FilterSettings(), 12.0, ROLES, compensator)

    def advance(t_ns: int, angle_rad: float) -> tuple[float, float]:
        for wheel in range(3):
            estimator.take(
                WheelSample(device="wheels", t_ns=t_ns, wheel=wheel, position_rad=angle_rad, current_a=0.8),
                t_ns,
            )
        estimator.advance(t_ns, (3.0, 3.0, 3.0))
        estimate = estimator.estimate(t_ns)
        return estimate.yaw_rad, estimate.x_m

    for step in range(1, 60):
        before = advance(step * 20 * MS, 0.06 * step)
    report = compensator.report()
    assert before[0] > 0.1
    for step in range(1, 50):
        assert advance(step * 20 * MS, 9.0 + step) == before
    assert compensator.report() is report


values = st.floats(-20.0, 20.0)
readings = st.tuples(st.tuples(values, values, values), st.tuples(*[st.none() | st.floats()] * 3), values)


@settings(max_examples=60, deadline=None)
@given(st.lists(readings, max_size=60), st.sampled_from(("surfaces", "line", "yaw_probe")), st.booleans())
def test_whatever_arrives_slips_are_slips(
    arrived: list[tuple[tuple[float, ...], tuple[float | None, ...], float]], use: str, is_signed: bool
) -> None:
    bench = Bench(use=use, is_signed=is_signed)
    for speeds, currents, gyro_rate_rad_s in arrived:
        report = bench.step(speeds, currents, gyro_rate_rad_s=gyro_rate_rad_s)
        assert all(-1.0 <= wheel.slip <= 1.0 for wheel in report.wheels)
        assert all(wheel.valid is not bool(wheel.reason) for wheel in report.wheels)
        assert bench.told.is_sure or not all(wheel.valid for wheel in report.wheels)
        assert math.isfinite(abs(bench.way))
