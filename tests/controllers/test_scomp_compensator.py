"""Slip and slip angle in the loop, by tilt and trace."""

import cmath
import math
from dataclasses import dataclass, field

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from controllers.control_loop import ControlLoop
from controllers.estimation.filter.motion_history import WayBack
from controllers.estimation.filter.transition import Turn
from controllers.estimation.gyro.standstill_reading import GyroAtStandstill
from controllers.estimation.pose_estimate import YawSource
from controllers.estimation.settings import FilterSettings
from controllers.estimation.wheels.odometry import BodyIncrement
from controllers.ftrace.reading import Rates, TraceReading
from controllers.motion.crab import DriftSource
from controllers.motion.kinematics import SkidSteerKinematics
from controllers.motion.planar import Pose
from controllers.motion.rover_geometry import SkidSteerRoverSettings
from controllers.motion.settings import LineMission
from controllers.roles import DeviceRoles
from controllers.settings import ControlSettings
from controllers.slip.scomp.compensator import NO_MOTION, ScompCompensator
from controllers.slip.scomp.settings import ScompSettings
from drivers.clock import nanoseconds
from drivers.samples import AttitudeSample, FrameSample, PoseFixSample, RateSample, Sample, WheelSample
from tests.controllers.floor_fixes import NO_SLIP, PositionFilter
from tests.controllers.mobility import Wheels
from tests.controllers.simulated import LIMITS, OMNI, ROLES, SKID
from tests.controllers.slip_readings import SlipReadings

MS = 1_000_000
ROVER = SkidSteerRoverSettings(kinematics="skid_steer_4", wheel_radius_m=0.092, track_m=0.66)
WITH_CAMERA = DeviceRoles(wheels="wheels", required={}, gyro="imu", camera="camera")
RIM_M_S = 0.08
UPHILL = math.radians(8.0)
PLAIN = FilterSettings()
QUIET = FilterSettings(position_noise_m_sqrt_m=1e-3, gyro_noise_rad_sqrt_s=1e-4, gyro_bias_rad_s=1e-4)


@dataclass
class SeenTrace:
    """A finder that always sees the same; None for a frame that cannot be looked at."""

    theta_rad: float | None
    looked_ns: list[int] = field(default_factory=list)
    rates: list[Rates | None] = field(default_factory=list)
    source: str = "trace"
    sd_rad: float | None = 0.015
    contradiction: str = ""

    def find(
        self, frame: FrameSample, wheel_speed_m_s: float, rates_rad_s: Rates | None
    ) -> TraceReading | None:
        assert wheel_speed_m_s == pytest.approx(RIM_M_S, rel=1e-4) or wheel_speed_m_s == 0.0
        self.looked_ns.append(frame.t_ns)
        self.rates.append(rates_rad_s)
        seen = self.theta_rad is not None and self.source == "trace"
        return TraceReading(
            t_ns=frame.t_ns,
            detected=seen,
            theta_rad=self.theta_rad,
            confidence=float(seen),
            source="none" if self.theta_rad is None else self.source,
            theta_sd_rad=self.sd_rad,
            contradiction=self.contradiction,
        )


class Bench:
    """A rover that drives straight at a constant rim speed, 100 cycles a second, and its pose filter."""

    def __init__(
        self,
        finder: SeenTrace | None,
        pitch_rad: float = UPHILL,
        settings: ScompSettings | None = None,
        filter_settings: FilterSettings = PLAIN,
    ) -> None:
        self.told = ScompCompensator(
            settings or ScompSettings(), WITH_CAMERA, SkidSteerKinematics(ROVER), finder
        )
        self.finder = finder or SeenTrace(None)
        self.filter = PositionFilter(filter_settings, (), ("floor",), slip=self.told.states, prior=NO_SLIP)
        self.slip_readings = SlipReadings(self.told, self.filter)
        self.pitch_rad = pitch_rad
        self.t_ns = 0
        self.readings: list[TraceReading] = []
        self.motions: list[complex] = []
        self.increments: list[BodyIncrement] = []

    @property
    def way(self) -> complex:
        """Where the rover is, to the left as imaginary part."""
        return complex(self.filter.pose.x_m, self.filter.pose.y_m)

    @property
    def reason(self) -> str:
        """Why slip and slip angle are uncertain."""
        report = self.told.report()
        assert report is not None
        return report.reason

    def feed(self, *samples: Sample) -> None:
        for sample in samples:
            self.slip_readings.take(sample)

    def run(
        self,
        duration_s: float,
        frame_period_s: float = 0.2,
        *,
        has_tilt: bool = True,
        rim_m_s: float = RIM_M_S,
        has_gyro: bool = True,
        yaw_rate_rad_s: float = 0.0,
        wheel_turn_rad_s: float = 0.0,
    ) -> None:
        """Drive without a turn; gyro and wheels may tell another one."""
        for _ in range(round(duration_s * 100)):
            self.t_ns += 10 * MS
            if self.t_ns % (20 * MS) == 0:
                if has_gyro:
                    self.feed(
                        RateSample(
                            device="imu",
                            t_ns=self.t_ns,
                            rate_z_rad_s=yaw_rate_rad_s,
                            rate_x_rad_s=0.1,
                            rate_y_rad_s=0.2,
                        )
                    )
                if has_tilt:
                    self.feed(attitude(self.t_ns, self.pitch_rad))
            if self.t_ns % nanoseconds(frame_period_s) == 0:
                self.feed(frame("camera", self.t_ns))
            turned = (rim_m_s * 0.01 / ROVER.wheel_radius_m,) * 4
            raw = BodyIncrement(
                x_m=rim_m_s * 0.01,
                y_m=0.0,
                turn_rad=wheel_turn_rad_s * 0.01,
                duration_s=0.01,
                turned_rad=turned,
            )
            before = self.way
            self.increments.append(self.told.compensate(raw, (), None))
            turn_rad = 0.01 * yaw_rate_rad_s
            step = self.filter.predict(
                self.increments[-1],
                Turn(angle_rad=turn_rad, source=YawSource.GYRO, covered_s=0.01, measured_s=0.01),
            )
            self.motions.append((self.way - before) * cmath.rect(1.0, -self.filter.pose.yaw_rad))
            self.slip_readings.move(self.t_ns, step)
            if rim_m_s == 0.0:
                self.filter.correct(GyroAtStandstill(device="imu", sd_rad_s=0.01), (0.0,))
            report = self.told.report()
            assert report is not None
            if report.trace is not None:
                self.readings.append(report.trace)
                again = self.told.report()
                assert again is not None
                assert again.trace is None


def attitude(t_ns: int, pitch_rad: float) -> AttitudeSample:
    """The house counts a lowered nose as positive."""
    return AttitudeSample(device="imu", t_ns=t_ns, pitch_rad=-pitch_rad, roll_rad=0.0)


def frame(device: str, t_ns: int) -> FrameSample:
    return FrameSample(device=device, t_ns=t_ns, t_capture_ns=None, index=0, image=np.zeros((4, 4), np.uint8))


def test_uphill_the_wheels_slip_and_the_way_is_shorter() -> None:
    level, uphill = Bench(None, 0.0), Bench(None)
    for bench in (level, uphill):
        bench.run(5.0)
    slip = ScompSettings().parameters.pitch.model.slip_at(math.sin(UPHILL) + 0.05, 0.0)
    # The tilt's low-pass starts where the rover stands.
    assert uphill.way.real == pytest.approx(5.0 * RIM_M_S * (1.0 - slip), rel=0.02)
    assert level.way.real > uphill.way.real + 0.05
    assert uphill.way.imag == 0.0


def test_the_trace_turns_the_way() -> None:
    bench = Bench(SeenTrace(math.radians(-9.0)))
    bench.run(1.0, rim_m_s=0.0)  # the gyro's bias is learnt
    bench.run(10.0)
    report = bench.told.report()
    assert report is not None
    assert math.degrees(report.slip_angle_rad) == pytest.approx(-9.0, abs=1.0)
    assert report.reason == ""
    assert math.degrees(cmath.phase(bench.motions[-1])) == pytest.approx(-9.0, abs=1.0)
    velocity = bench.told.body_motion((1.0,) * 4)
    assert velocity[0] == pytest.approx(ROVER.wheel_radius_m * (1.0 - report.slip))
    assert velocity[1] == pytest.approx(velocity[0] * math.tan(report.slip_angle_rad))


def test_without_a_trace_the_motion_of_the_ground_gives_the_direction() -> None:
    finder = SeenTrace(math.radians(-9.0), source="flow")
    bench = Bench(finder)
    bench.run(1.0, rim_m_s=0.0)  # the gyro's bias is learnt
    bench.run(20.0)
    report = bench.told.report()
    assert report is not None
    assert math.degrees(report.slip_angle_rad) == pytest.approx(-9.0, abs=1.5)
    assert report.reason == ""
    assert not any(reading.detected for reading in bench.readings)


def test_a_direction_held_from_earlier_frames_is_not_used() -> None:
    bench = Bench(SeenTrace(math.radians(-9.0), source="held"))
    bench.run(10.0)
    report = bench.told.report()
    assert report is not None
    assert abs(math.degrees(report.slip_angle_rad)) < 3.0
    assert report.reason == NO_MOTION


def test_a_rig_that_the_pictures_contradict_is_named() -> None:
    finder = SeenTrace(None, contradiction="check the yaw of the camera's mounting")
    bench = Bench(finder)
    bench.run(1.0)
    assert bench.reason == "check the yaw of the camera's mounting"
    assert not bench.increments[-1].is_sure
    finder.contradiction, finder.theta_rad = "", 0.0
    bench.run(1.0)
    assert bench.reason == ""


def test_a_camera_that_sees_no_motion_of_the_ground_is_named_after_a_third_of_a_metre() -> None:
    finder = SeenTrace(None)
    bench = Bench(finder)
    bench.run(20.0, rim_m_s=0.0)
    assert bench.reason == "no trace"  # at rest there is none to be seen
    bench.run(3.5)
    assert bench.reason == "no trace"
    bench.run(0.5)
    assert bench.reason == NO_MOTION
    assert bench.increments[-1].is_sure
    finder.theta_rad, finder.source = 0.0, "flow"
    bench.run(0.5)
    assert bench.reason == ""


def test_each_frame_is_told_once_with_the_rates() -> None:
    finder = SeenTrace(0.0)
    bench = Bench(finder)
    bench.run(4.0)
    assert [reading.t_ns for reading in bench.readings] == finder.looked_ns
    assert len(finder.looked_ns) == 20
    assert finder.rates == [(0.1, 0.2, 0.0)] * 20


def test_frames_that_come_too_fast_are_passed_over() -> None:
    finder = SeenTrace(0.0)
    Bench(finder, settings=ScompSettings(frame_period_s=0.5)).run(4.0, 0.02)
    steps_ns = np.diff(finder.looked_ns)
    assert steps_ns.min() >= 500 * MS
    assert len(finder.looked_ns) >= 7


def test_what_is_missing_is_said_and_makes_the_way_unsure() -> None:
    bench = Bench(SeenTrace(0.0))
    bench.run(1.0, has_tilt=False)
    report = bench.told.report()
    assert report is not None
    assert report.reason == "no tilt"
    assert not bench.increments[-1].is_sure
    blind = Bench(SeenTrace(None))
    blind.run(3.5)
    report = blind.told.report()
    assert report is not None
    assert report.reason == "no trace"
    assert blind.increments[-1].is_sure  # the slip angle's own variance grows
    no_camera = Bench(None)
    no_camera.run(4.0)
    assert no_camera.increments[-1].is_sure


def test_a_tilt_that_falls_silent_is_unknown_after_a_second() -> None:
    bench = Bench(None)
    bench.run(2.0)
    bench.run(0.9, has_tilt=False)
    assert bench.reason == ""
    sources = [bench.told.drift_source]
    bench.run(0.3, has_tilt=False)
    assert bench.reason == "no tilt"
    assert [*sources, bench.told.drift_source] == [DriftSource.TILT, DriftSource.NONE]
    assert not bench.increments[-1].is_sure
    bench.run(0.1)
    assert bench.reason == ""
    assert bench.increments[-1].is_sure


def test_a_slip_angle_taken_anew_is_not_sure_until_more_traces_agree() -> None:
    """Here the gyro is wrong, not the ground: the slip angle was right before."""
    bench = Bench(SeenTrace(0.0))
    bench.run(1.0, rim_m_s=0.0)  # the gyro's bias is learnt
    bench.run(10.0)
    assert bench.reason == ""
    for _ in range(4):
        # By less than what would count as skidding of a side.
        bench.run(0.5, yaw_rate_rad_s=0.05)
    report = bench.told.report()
    assert report is not None
    assert abs(math.degrees(report.slip_angle_rad)) > 5.0
    assert report.reason == "slip angle taken from the trace anew"
    assert not bench.increments[-1].is_sure
    bench.run(10.0)
    assert bench.reason == ""
    assert bench.increments[-1].is_sure


def test_without_a_gyro_the_slip_in_a_turn_of_the_wheels_is_not_sure() -> None:
    bench = Bench(None)
    bench.run(2.0, has_gyro=False)
    assert bench.reason == ""  # the wheels go straight
    bench.run(2.0, has_gyro=False, wheel_turn_rad_s=0.2)
    assert bench.reason == "no gyro"
    assert not bench.increments[-1].is_sure
    bench.run(2.0, wheel_turn_rad_s=0.2, yaw_rate_rad_s=0.2)
    assert bench.reason == ""
    assert bench.increments[-1].is_sure


def test_skidding_ends_with_the_turn_of_the_wheels_though_the_gyro_is_silent() -> None:
    bench = Bench(None)
    bench.run(2.0, wheel_turn_rad_s=0.2)
    assert bench.reason == "skidding in a turn"
    bench.run(5.0, has_gyro=False)
    assert bench.reason == ""


def test_backwards_the_slip_is_not_sure() -> None:
    """The slip law holds for wheels that roll forward: backwards the weight pulls the other way."""
    bench = Bench(None)
    bench.run(1.0)
    bench.run(1.0, rim_m_s=-0.001)  # noise of the encoders at rest
    assert bench.reason == ""
    bench.run(1.0, rim_m_s=-RIM_M_S)
    assert bench.reason == "backwards: outside the slip law"
    assert not bench.increments[-1].is_sure
    bench.run(1.0)
    assert bench.reason == ""
    assert bench.increments[-1].is_sure


def test_a_trace_that_is_lost_is_missed_after_a_while() -> None:
    finder = SeenTrace(math.radians(5.0))
    bench = Bench(finder, settings=ScompSettings(trace_age_s=2.0))
    bench.run(5.0)
    assert bench.reason == ""
    finder.theta_rad = None
    bench.run(1.5)
    assert bench.reason == ""
    bench.run(1.0)
    assert bench.reason == "no trace"


def sideways_sd_m(finder: SeenTrace | None) -> float:
    """Return the standard deviation of the position across the way that 0.6 m add after a trace."""
    bench = Bench(SeenTrace(0.0), filter_settings=QUIET)
    bench.run(5.0)
    before_m2 = bench.filter.covariance[3]
    bench.finder.theta_rad = None if finder is None else finder.theta_rad
    bench.run(8.0)
    return math.sqrt(bench.filter.covariance[3] - before_m2)


def test_without_a_trace_the_way_becomes_less_certain_across() -> None:
    assert sideways_sd_m(None) > 1.5 * sideways_sd_m(SeenTrace(0.0))


def test_fixes_correct_the_slip_law() -> None:
    """The ground grips less than the parameters say: after 3 m with fixes the next metre is right."""
    bench, here = Bench(None), WayBack(x_m=0.0, y_m=0.0, turned_rad=0.0, position_m2=0.0, yaw_rad2=0.0)
    share = 0.5
    for number in range(31):
        fix = PoseFixSample(
            device="floor",
            t_ns=bench.t_ns,
            t_capture_ns=bench.t_ns,
            x_m=share * 0.1 * number,
            y_m=0.0,
            yaw_rad=0.0,
            position_std_m=0.005,
            yaw_std_rad=0.01,
        )
        assert all(innovation.accepted for innovation in bench.filter.positions.take(fix, here))
        bench.run(0.1 / RIM_M_S)
    begin_m = bench.way.real
    bench.run(1.0 / RIM_M_S)
    assert bench.way.real - begin_m == pytest.approx(share, abs=0.04)
    report = bench.told.report()
    assert report is not None
    assert report.slip == pytest.approx(1.0 - share, abs=0.04)


def test_numbers_that_are_none_and_other_devices_have_no_effect() -> None:
    calm, disturbed = Bench(SeenTrace(0.0)), Bench(SeenTrace(0.0))
    for bench in (calm, disturbed):
        bench.run(1.0)
        if bench is disturbed:
            bench.feed(
                attitude(bench.t_ns, math.nan),
                RateSample(device="imu", t_ns=bench.t_ns, rate_z_rad_s=math.inf),
                RateSample(device="other", t_ns=bench.t_ns, rate_z_rad_s=3.0),
                AttitudeSample(device="other", t_ns=bench.t_ns, pitch_rad=1.0, roll_rad=1.0),
                AttitudeSample(device="imu", t_ns=bench.t_ns),
                frame("other", bench.t_ns),
            )
        bench.run(1.0)
    assert abs(disturbed.way - calm.way) < 1e-12


def test_a_rover_that_drifts_is_turned_against_the_drift() -> None:
    mission = LineMission(type="line", length_m=3.0, speed_m_s=0.1, heading="along_path")
    follower = mission.follower(Wheels(moves_sideways=False))
    drift_rad = math.radians(-8.0)
    assert follower.guide(Pose(), 0, drift_rad).yaw_rate_rad_s > 0.1
    held = follower.guide(Pose(yaw_rad=-drift_rad), 0, drift_rad)
    assert held.yaw_rate_rad_s == pytest.approx(0.0, abs=1e-12)
    assert follower.guide(Pose(yaw_rad=-drift_rad), 0).yaw_rate_rad_s < -0.1


def test_the_loop_tells_slip_and_slip_angle_and_steers_or_not() -> None:
    mission = LineMission(type="line", length_m=3.0, speed_m_s=0.1, heading="along_path")
    control = ControlSettings(rover=SKID, limits=LIMITS, mission=mission, scomp=ScompSettings())
    output = ControlLoop(control, ROLES).step(1, [])
    assert output.scomp is None  # nothing has moved yet
    assert output.slip is None


DEVICES = st.sampled_from(["wheels", "gyro", "camera"])
STAMPS = st.integers(0, 10**12)
NUMBERS = st.floats() | st.floats(-10.0, 10.0)
SAMPLES: st.SearchStrategy[Sample] = st.one_of(
    st.builds(
        WheelSample, device=st.just("wheels"), t_ns=STAMPS, wheel=st.integers(0, 3), position_rad=NUMBERS
    ),
    st.builds(
        RateSample,
        device=DEVICES,
        t_ns=STAMPS,
        rate_z_rad_s=NUMBERS,
        rate_x_rad_s=NUMBERS,
        rate_y_rad_s=NUMBERS,
    ),
    st.builds(AttitudeSample, device=DEVICES, t_ns=STAMPS, pitch_rad=st.none() | NUMBERS, roll_rad=NUMBERS),
    st.builds(frame, st.just("camera"), STAMPS),
)


class AnyTrace:
    """A finder that says whatever it is given."""

    def __init__(self, theta_rad: float | None) -> None:
        self.theta_rad = theta_rad

    def find(
        self, frame: FrameSample, wheel_speed_m_s: float, rates_rad_s: Rates | None
    ) -> TraceReading | None:
        return TraceReading(
            t_ns=frame.t_ns,
            detected=True,
            theta_rad=self.theta_rad,
            confidence=1.0,
            source="trace",
            theta_sd_rad=None,
        )


@settings(deadline=None, max_examples=60)
@given(
    cycles=st.lists(
        st.tuples(st.integers(0, 40 * MS) | st.integers(0, 2**58), st.lists(SAMPLES, max_size=8)), max_size=15
    ),
    theta_rad=st.none() | NUMBERS,
)
def test_no_stream_of_samples_makes_the_loop_raise(
    cycles: list[tuple[int, list[Sample]]], theta_rad: float | None
) -> None:
    control = ControlSettings(rover=SKID, limits=LIMITS, scomp=ScompSettings())
    roles = DeviceRoles(wheels="wheels", required={}, gyro="gyro", camera="camera")
    loop = ControlLoop(control, roles, AnyTrace(theta_rad))
    now_ns = 10**9
    for step_ns, samples in cycles:
        now_ns += step_ns
        # So that every cycle has an increment.
        wheels = [
            WheelSample(device="wheels", t_ns=now_ns, wheel=wheel, position_rad=now_ns / 1e9)
            for wheel in range(4)
        ]
        output = loop.step(now_ns, [*samples, *wheels])
        assert output.estimate.is_finite


def test_three_omnidirectional_wheels_leave_no_such_trace() -> None:
    with pytest.raises(ValidationError, match="four wheels"):
        ControlSettings(rover=OMNI, limits=LIMITS, scomp=ScompSettings())


def test_a_trace_weighs_less_where_it_tells_a_larger_deviation() -> None:
    """A vague trace hardly turns the slip angle; a sure one still has the usual errors of a trace."""

    def share(sd_rad: float | None) -> float:
        bench = Bench(SeenTrace(math.radians(-9.0), sd_rad=sd_rad))
        bench.run(1.0, rim_m_s=0.0)
        bench.run(1.0)
        report = bench.told.report()
        assert report is not None
        return math.degrees(report.slip_angle_rad) / -9.0

    usual_rad = ScompSettings().parameters.trace.noise_rad
    vague, usual, sure = (share(sd_rad) for sd_rad in (0.5, usual_rad, 0.005))
    assert vague < 0.5 * usual
    assert usual == share(None) == sure
