"""Crabbing: all wheels are turned together against their slip angle."""

import cmath
import math

import pytest
from pydantic import ValidationError

from controllers.estimation.filter.pose_filter import PoseFilter
from controllers.estimation.filter.transition import Turn
from controllers.estimation.gyro.standstill_reading import GyroAtStandstill
from controllers.estimation.pose_estimate import YawSource
from controllers.estimation.settings import FilterSettings
from controllers.estimation.wheels.odometry import BodyIncrement
from controllers.motion.crab import CrabDrift, DriftSource
from controllers.motion.kinematics import make_kinematics
from controllers.motion.missions.path_following import PathFollower
from controllers.motion.planar import Pose
from controllers.motion.rover_geometry import WheelsRoverSettings
from controllers.motion.settings import LineMission
from controllers.motion.steering import mean_steering_rad
from controllers.roles import DeviceRoles
from controllers.settings import ControlSettings
from controllers.slip.scomp.compensator import ScompCompensator
from controllers.slip.scomp.settings import ScompSettings
from drivers.clock import nanoseconds
from drivers.errors import ConfigError
from drivers.samples import AttitudeSample, RateSample
from tests.controllers.mobility import Wheels
from tests.controllers.simulated import LIMITS, SKID
from tests.controllers.slip_readings import SlipReadings
from tests.controllers.test_scomp_compensator import SeenTrace, frame

PLACES = ((0.3, 0.22), (0.3, -0.22), (-0.3, 0.22), (-0.3, -0.22))
RADIUS_M = 0.092
RIM_M_S = 0.08
LINE = LineMission(type="line", length_m=7.0, speed_m_s=0.1, heading="crab", lookahead_m=0.4)
CRAB_LIMIT_RAD = math.radians(45.0)


def rover(low_deg: float = -60.0, high_deg: float = 60.0, **others: object) -> WheelsRoverSettings:
    steering = {"low_deg": low_deg, "high_deg": high_deg, "rate_deg_s": 17.0}
    wheels = [{"x_m": x, "y_m": y, "radius_m": RADIUS_M, "steering": steering, **others} for x, y in PLACES]
    return WheelsRoverSettings.model_validate({"kinematics": "wheels", "wheels": wheels})


def follower(crab_limit_rad: float = CRAB_LIMIT_RAD) -> PathFollower:
    return LINE.follower(Wheels(moves_sideways=False, crab_limit_rad=crab_limit_rad))


def test_the_wheels_are_turned_against_the_drift_and_the_body_is_not() -> None:
    drift_rad = math.radians(-8.0)
    guidance = follower().guide(Pose(), 0, drift_rad)
    assert math.atan2(guidance.velocity_y_m_s, guidance.velocity_x_m_s) == pytest.approx(-drift_rad)
    assert math.hypot(guidance.velocity_x_m_s, guidance.velocity_y_m_s) == pytest.approx(0.1)
    assert guidance.yaw_rate_rad_s == 0.0


def test_beside_the_line_the_course_leads_back_and_the_body_is_turned_along_the_line() -> None:
    yaw_rad = math.radians(3.0)
    guidance = follower().guide(Pose(y_m=0.1, yaw_rad=yaw_rad), 0)
    wheels_rad = math.atan2(guidance.velocity_y_m_s, guidance.velocity_x_m_s)
    assert wheels_rad + yaw_rad == pytest.approx(-math.atan2(0.1, 0.4))
    assert guidance.yaw_rate_rad_s == pytest.approx(-LINE.heading_gain_per_s * yaw_rad)


def test_the_wheels_are_not_turned_beyond_their_limit() -> None:
    guidance = follower(0.2).guide(Pose(), 0, -0.4)
    assert math.atan2(guidance.velocity_y_m_s, guidance.velocity_x_m_s) == pytest.approx(0.2)


def test_far_from_the_direction_of_the_line_it_turns_on_the_spot() -> None:
    guidance = follower().guide(Pose(yaw_rad=1.0), 0, -0.1)
    assert (guidance.velocity_x_m_s, guidance.velocity_y_m_s) == (0.0, 0.0)
    assert guidance.yaw_rate_rad_s < 0.0
    arc = LINE.follower(
        Wheels(moves_sideways=False, turns_on_spot=False, turn_radius_m=0.5, crab_limit_rad=0.3)
    )
    guidance = arc.guide(Pose(yaw_rad=1.0), 0, -0.1)
    assert guidance.velocity_x_m_s == pytest.approx(0.02)
    assert guidance.velocity_y_m_s == 0.0
    assert guidance.yaw_rate_rad_s == pytest.approx(-0.02 / 0.5)


def test_how_far_the_wheels_can_be_turned_together() -> None:
    assert make_kinematics(rover()).crab_limit_rad == pytest.approx(CRAB_LIMIT_RAD)
    assert make_kinematics(rover(-20.0, 60.0)).crab_limit_rad == pytest.approx(math.radians(20.0))
    assert make_kinematics(SKID).crab_limit_rad == 0.0
    wheels = [wheel.model_dump() for wheel in rover().wheels]
    wheels[2]["steering"] = wheels[3]["steering"] = None
    car = WheelsRoverSettings.model_validate({"kinematics": "wheels", "wheels": wheels})
    assert make_kinematics(car).crab_limit_rad == 0.0


def test_the_drift_begins_at_once_and_then_follows_smoothly() -> None:
    drift = CrabDrift()
    assert drift.take(0, -0.1, DriftSource.TILT) == -0.1
    assert drift.take(nanoseconds(1.0), -0.2, DriftSource.TRACE) == pytest.approx(-0.2 + 0.1 * math.exp(-1.0))
    report = drift.report
    assert report is not None
    assert report.source is DriftSource.TRACE


def test_the_mean_direction_of_wheels() -> None:
    assert mean_steering_rad(()) == 0.0
    assert mean_steering_rad((0.1, 0.2, 0.1, 0.2)) == pytest.approx(0.15)
    assert mean_steering_rad((0.1, 0.1 - math.pi)) == pytest.approx(0.1)  # this one rolls backwards
    assert mean_steering_rad((0.9, -0.9, -0.9, 0.9)) == pytest.approx(0.0)  # on the spot


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"scomp": None}, "which needs the slip angle: add"),
        ({"scomp": ScompSettings(steer_against_drift=False)}, "steer_against_drift is false, but"),
    ],
)
def test_settings_that_contradict_crabbing_are_refused(changes: dict[str, object], words: str) -> None:
    whole = {"rover": rover(), "limits": LIMITS, "mission": LINE, "scomp": ScompSettings()}
    ControlSettings.model_validate(whole)
    with pytest.raises(ValidationError, match=words):
        ControlSettings.model_validate({**whole, **changes})


def test_a_rover_that_does_not_steer_cannot_crab() -> None:
    with pytest.raises(ConfigError, match="this rover cannot crab, because not all of its wheels steer"):
        LINE.follower(Wheels(moves_sideways=False))


def test_slip_by_trace_and_tilt_needs_four_wheels_in_order() -> None:
    wheels = [wheel.model_dump() for wheel in rover().wheels]
    crossed = {"kinematics": "wheels", "wheels": [wheels[1], wheels[0], *wheels[2:]]}
    for bad in (crossed, {"kinematics": "wheels", "wheels": wheels[:3]}):
        with pytest.raises(ValidationError, match="front left, front right, rear left, rear right"):
            ControlSettings.model_validate({"rover": bad, "limits": LIMITS, "scomp": ScompSettings()})


class Bench:
    """A rover on a slope that rises to its left, whose wheels roll at a steering angle."""

    def __init__(self, finder: SeenTrace | None, steering_rad: float, roll_rad: float | None) -> None:
        roles = DeviceRoles(wheels="wheels", required={}, gyro="imu", camera="camera")
        self.kinematics = make_kinematics(rover())
        self.scomp = ScompCompensator(ScompSettings(trace_age_s=1.0), roles, self.kinematics, finder)
        self.filter = PoseFilter(FilterSettings(), (), slip=self.scomp.states)
        self.slip_readings = SlipReadings(self.scomp, self.filter)
        self.motions_m: list[complex] = []
        self.steering_rad = (steering_rad,) * 4
        self.roll_rad = roll_rad
        self.t_ns = 0

    def run(self, duration_s: float, rim_m_s: float = RIM_M_S) -> None:
        turned = (rim_m_s * 0.01 / RADIUS_M,) * 4
        x_m, y_m, turn_rad = self.kinematics.body_motion(turned, self.steering_rad)
        for _ in range(round(100 * duration_s)):
            self.t_ns += nanoseconds(0.01)
            if self.t_ns % nanoseconds(0.02) == 0:
                self.slip_readings.take(RateSample(device="imu", t_ns=self.t_ns, rate_z_rad_s=0.0))
                if self.roll_rad is not None:
                    tilt = AttitudeSample(device="imu", t_ns=self.t_ns, pitch_rad=0.0, roll_rad=self.roll_rad)
                    self.slip_readings.take(tilt)
            if self.t_ns % nanoseconds(0.2) == 0:
                self.slip_readings.take(frame("camera", self.t_ns))
            rolled = BodyIncrement(
                x_m=x_m,
                y_m=y_m,
                turn_rad=turn_rad,
                duration_s=0.01,
                turned_rad=turned,
                steering_rad=self.steering_rad,
            )
            before = self.filter.pose
            turn = Turn(angle_rad=0.0, source=YawSource.GYRO, covered_s=0.01, measured_s=0.01)
            step = self.filter.predict(self.scomp.compensate(rolled, (), None), turn)
            after = self.filter.pose
            way_m = complex(after.x_m - before.x_m, after.y_m - before.y_m)
            self.motions_m.append(way_m * cmath.rect(1.0, -after.yaw_rad))
            self.slip_readings.move(self.t_ns, step)
            if rim_m_s == 0.0:
                self.filter.correct(GyroAtStandstill(device="imu", sd_rad_s=0.01), (0.0,))

    def source(self) -> str:
        return self.scomp.drift_source.value

    @property
    def course_rad(self) -> float:
        return cmath.phase(self.motions_m[-1])


def test_steered_wheels_roll_in_their_direction() -> None:
    bench = Bench(None, 0.15, None)
    bench.run(2.0)
    assert bench.course_rad == pytest.approx(0.15)
    velocity_x, velocity_y, _ = bench.scomp.body_motion((1.0,) * 4)
    assert math.atan2(velocity_y, velocity_x) == pytest.approx(0.15)
    report = bench.scomp.report()
    assert report is not None
    assert report.slip_angle_rad == pytest.approx(0.15)


def test_wheels_that_crab_against_the_roll_keep_the_course() -> None:
    straight = Bench(None, 0.0, 0.14)
    straight.run(5.0)
    drift_rad = straight.scomp.drift_rad
    assert straight.course_rad == pytest.approx(drift_rad)
    assert drift_rad < -0.05
    crabbing = Bench(None, -drift_rad, 0.14)
    crabbing.run(5.0)
    # The wheels roll a little uphill, so that they slip and drift more.
    assert crabbing.course_rad == pytest.approx(0.0, abs=0.01)
    slips = [bench.scomp.report() for bench in (straight, crabbing)]
    assert slips[0] is not None
    assert slips[1] is not None
    assert slips[1].slip > slips[0].slip + 0.01


def test_the_trace_is_measured_against_the_body() -> None:
    bench = Bench(SeenTrace(0.0), 0.15, 0.14)
    bench.run(1.0, rim_m_s=0.0)  # the gyro's bias is learnt
    bench.run(10.0)
    assert bench.course_rad == pytest.approx(0.0, abs=0.01)
    assert bench.scomp.drift_rad == pytest.approx(-0.15, abs=0.01)


def test_without_a_trace_the_slip_angle_is_that_of_the_tilt_and_without_both_it_fades() -> None:
    finder = SeenTrace(-0.25)
    bench = Bench(finder, 0.0, 0.14)
    bench.run(1.0, rim_m_s=0.0)
    bench.run(6.0)
    assert bench.source() == "trace"
    assert bench.scomp.drift_rad == pytest.approx(-0.25, abs=0.02)
    finder.theta_rad = None
    bench.run(0.8)
    assert bench.source() == "trace"
    bench.run(15.0)
    assert bench.source() == "tilt"
    # The trace has taught that the roll explains more than the parameters say.
    untaught = Bench(None, 0.0, 0.14)
    untaught.run(5.0)
    assert untaught.source() == "tilt"
    assert -0.25 < bench.scomp.drift_rad < untaught.scomp.drift_rad - 0.01
    level = SeenTrace(-0.25)
    blind = Bench(level, 0.0, None)
    blind.run(1.0, rim_m_s=0.0)
    blind.run(6.0)
    assert blind.scomp.drift_rad < -0.15
    level.theta_rad = None
    blind.run(30.0)
    assert blind.source() == "none"
    assert blind.scomp.drift_rad == pytest.approx(0.0, abs=0.01)
