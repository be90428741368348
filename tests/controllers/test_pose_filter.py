"""The pose filter: honest covariances on simulated data, headings, bias."""

import cmath
import json
import math
from collections.abc import Sequence
from dataclasses import asdict, replace

import numpy as np
import pytest
from scipy.stats import chi2

from controllers.estimation.filter.guarded_filter import Innovation
from controllers.estimation.filter.motion_history import MotionHistory, WayBack
from controllers.estimation.filter.pose_filter import PoseFilter
from controllers.estimation.filter.reader import Situation
from controllers.estimation.filter.state_layout import YAW
from controllers.estimation.filter.transition import Turn
from controllers.estimation.ground_settings import GroundSettings
from controllers.estimation.gyro.standstill_reading import GyroAtStandstill
from controllers.estimation.headings.heading import HeadingReader
from controllers.estimation.pose_estimate import PoseEstimate, YawSource
from controllers.estimation.settings import FilterSettings
from controllers.estimation.wheels.odometry import BodyIncrement
from controllers.motion.planar import wrap_angle
from drivers.samples import HeadingReference, HeadingSample
from tests.cases import first_often
from tests.controllers.floor_fixes import NO_SLIP

SETTINGS = FilterSettings(
    position_noise_m_sqrt_m=0.05,
    gyro_noise_rad_sqrt_s=0.01,
    gyro_bias_rad_s=0.02,
    heading_noise_rad=0.05,
)
MAGNETIC, TRUE = HeadingReference.MAGNETIC, HeadingReference.TRUE
DT_S = 0.02
STANDING = BodyIncrement(x_m=0.0, y_m=0.0, turn_rad=0.0, duration_s=DT_S)
AHEAD = replace(STANDING, x_m=0.01)
NO_TURN = Turn(angle_rad=0.0, source=YawSource.WHEELS)


def correct_heading(
    pose_filter: PoseFilter, reference: HeadingReference, heading_rad: float, turned_since_rad: float
) -> Innovation:
    """Correct by a heading of the compass; `turned_since_rad` is the turn since it was measured."""
    here = WayBack(x_m=0.0, y_m=0.0, turned_rad=turned_since_rad, position_m2=0.0, yaw_rad2=0.0)
    now = Situation(
        pose_filter=pose_filter,
        settings=SETTINGS,
        history=MotionHistory(),
        measured_ns=0,
        way_back=here,
        yaw_rate_rad_s=0.0,
    )
    sample = HeadingSample(device="compass", t_ns=0, heading_rad=heading_rad, reference=reference)
    (innovation,) = HeadingReader().correct(sample, now)
    return innovation


def correct_bias(pose_filter: PoseFilter, rate_rad_s: float) -> Innovation:
    """Correct by a reading of the gyro at standstill."""
    model = GyroAtStandstill(device="gyro", sd_rad_s=SETTINGS.gyro_rate_noise_rad_s)
    (innovation,) = pose_filter.correct(model, (rate_rad_s,))
    return innovation


class NoisyDrive:
    """Truth and what the sensors make of it, with exactly the noise that the settings tell the filter."""

    def __init__(self, seed: int, source: YawSource) -> None:
        self.draw = np.random.default_rng(seed).normal
        self.source = source
        self.offset_rad = float(np.random.default_rng(seed + 1000).uniform(-math.pi, math.pi))
        self.bias_rad_s = SETTINGS.gyro_bias_rad_s * self.draw()
        self.filter = PoseFilter(SETTINGS, ("compass",), prior=NO_SLIP)
        self.place, self.yaw_rad = 0j, 0.0
        self.heading_nis: list[float] = []

    def settle(self) -> None:
        for _ in range(20):
            self._hear_compass()

    def drive(self, steps: int) -> None:
        for step in range(steps):
            self._move(x_m=0.004, y_m=0.002 * math.sin(0.05 * step), turn_rad=0.01)
            if step % 5 == 0:
                self._hear_compass()

    def nees(self) -> float:
        """Squared error of (x, y, yaw) over its covariance."""
        pose, (xx, xy, xw, yy, yw, ww) = self.filter.pose, self.filter.covariance
        error = np.array(
            [
                pose.x_m - self.place.real,
                pose.y_m - self.place.imag,
                wrap_angle(pose.yaw_rad - self.yaw_rad),
            ]
        )
        covariance = np.array([[xx, xy, xw], [xy, yy, yw], [xw, yw, ww]])
        return float(error @ np.linalg.solve(covariance, error))

    def _move(self, x_m: float, y_m: float, turn_rad: float) -> None:
        self.place += cmath.rect(1.0, self.yaw_rad + 0.5 * turn_rad) * complex(x_m, y_m)
        self.yaw_rad += turn_rad
        distance_m = math.hypot(x_m, y_m)
        slip_m = SETTINGS.position_noise_m_sqrt_m * math.sqrt(distance_m)
        measured = replace(STANDING, x_m=x_m + slip_m * self.draw(), y_m=y_m + slip_m * self.draw())
        if self.source is YawSource.GYRO:
            noise_rad = SETTINGS.gyro_noise_rad_sqrt_s * math.sqrt(DT_S) * self.draw()
            angle_rad = turn_rad + self.bias_rad_s * DT_S + noise_rad
            turn = Turn(angle_rad=angle_rad, source=YawSource.GYRO, covered_s=DT_S)
        else:
            variance = (
                SETTINGS.wheel_yaw_noise_rad_sqrt_rad**2 * turn_rad
                + SETTINGS.wheel_yaw_noise_rad_sqrt_m**2 * distance_m
            )
            noise_rad = math.sqrt(variance) * self.draw()
            turn = Turn(angle_rad=turn_rad + noise_rad, source=YawSource.WHEELS)
        self.filter.predict(measured, turn)

    def _hear_compass(self) -> None:
        heading_rad = self.yaw_rad + self.offset_rad + SETTINGS.heading_noise_rad * self.draw()
        innovation = correct_heading(self.filter, MAGNETIC, wrap_angle(heading_rad), 0.0)
        if innovation.nis is not None:
            self.heading_nis.append(innovation.nis)


@pytest.mark.parametrize("source", first_often(YawSource))
def test_errors_are_as_large_as_the_covariance_says(source: YawSource) -> None:
    drives = [NoisyDrive(seed, source) for seed in range(60)]
    for drive in drives:
        drive.settle()
        drive.drive(400)
    low, high = chi2.ppf((0.001, 0.999), 3 * len(drives))
    assert low < sum(drive.nees() for drive in drives) < high


@pytest.mark.parametrize("source", list(YawSource))
def test_innovations_are_as_large_as_the_filter_expects(source: YawSource) -> None:
    drives = [NoisyDrive(seed, source) for seed in range(20)]
    for drive in drives:
        drive.settle()
        drive.drive(400)
    # The first heading only teaches the offset.
    nis = [value for drive in drives for value in drive.heading_nis[1:]]
    low, high = chi2.ppf((0.001, 0.999), len(nis))
    assert low < sum(nis) < high


def test_without_a_settling_phase_the_yaw_is_honest_too() -> None:
    drives = [NoisyDrive(seed, YawSource.GYRO) for seed in range(60)]
    for drive in drives:
        drive.drive(400)
    low, high = chi2.ppf((0.001, 0.999), 3 * len(drives))
    assert low < sum(drive.nees() for drive in drives) < high


def test_headings_at_rest_teach_the_offset_and_do_not_turn_the_rover() -> None:
    pose_filter = PoseFilter(SETTINGS, ("compass",), prior=NO_SLIP)
    for heading_rad in (3.1, -3.1, 3.12, -3.12):
        correct_heading(pose_filter, MAGNETIC, heading_rad, 0.0)
    assert pose_filter.pose.yaw_rad == pytest.approx(0.0, abs=1e-6)
    pose_filter.predict(AHEAD, replace(NO_TURN, angle_rad=0.4))
    innovation = correct_heading(pose_filter, MAGNETIC, wrap_angle(math.pi + 0.4), 0.0)
    assert innovation.residual == pytest.approx(0.0, abs=1e-3)


def test_magnetic_and_true_headings_are_not_mixed() -> None:
    pose_filter = PoseFilter(SETTINGS, ("compass",), prior=NO_SLIP)
    for _ in range(10):
        correct_heading(pose_filter, MAGNETIC, 1.0, 0.0)
        correct_heading(pose_filter, TRUE, 1.2, 0.0)
    for reference, heading_rad in ((MAGNETIC, 1.0), (TRUE, 1.2)):
        innovation = correct_heading(pose_filter, reference, heading_rad, 0.0)
        assert innovation.residual == pytest.approx(0.0, abs=1e-4)
        assert innovation.name == f"compass {reference.value}"


def test_a_wild_heading_is_refused() -> None:
    pose_filter = PoseFilter(SETTINGS, ("compass",), prior=NO_SLIP)
    for _ in range(10):
        correct_heading(pose_filter, MAGNETIC, 1.0, 0.0)
    before = pose_filter.pose
    assert not correct_heading(pose_filter, MAGNETIC, 2.0, 0.0).accepted
    assert not correct_heading(pose_filter, MAGNETIC, math.nan, 0.0).accepted
    assert pose_filter.pose == before


def test_a_late_heading_is_compared_with_the_yaw_of_its_time() -> None:
    pose_filter = PoseFilter(SETTINGS, ("compass",), prior=NO_SLIP)
    correct_heading(pose_filter, MAGNETIC, 1.0, 0.0)
    pose_filter.predict(STANDING, replace(NO_TURN, angle_rad=0.5))
    innovation = correct_heading(pose_filter, MAGNETIC, 1.3, 0.2)
    assert innovation.residual == pytest.approx(0.0, abs=1e-3)


def test_the_bias_learnt_at_rest_is_taken_off_the_gyro() -> None:
    pose_filter = PoseFilter(SETTINGS, (), prior=NO_SLIP)
    for _ in range(200):
        correct_bias(pose_filter, 0.03)
    assert pose_filter.gyro_bias_rad_s == pytest.approx(0.03, abs=1e-4)
    turn = Turn(angle_rad=1.03, source=YawSource.GYRO, covered_s=1.0)
    pose_filter.predict(replace(STANDING, duration_s=1.0), turn)
    assert pose_filter.pose.yaw_rad == pytest.approx(1.0, abs=1e-3)


def test_uncertainty_does_not_depend_on_the_cycle() -> None:
    variances = []
    for parts in (1, 100):
        pose_filter = PoseFilter(SETTINGS, (), prior=NO_SLIP)
        for _ in range(parts):
            part = BodyIncrement(x_m=1.0 / parts, y_m=0.0, turn_rad=0.0, duration_s=5.0 / parts)
            pose_filter.predict(part, Turn(angle_rad=0.0, source=YawSource.GYRO, covered_s=5.0 / parts))
        variances.append(pose_filter.covariance)
    (xx, _, _, _, _, ww), (fine_xx, _, _, _, _, fine_ww) = variances
    assert fine_xx == pytest.approx(xx, rel=1e-6)
    assert xx == pytest.approx(0.05**2, rel=1e-3)
    assert fine_ww == pytest.approx(ww, rel=0.01)
    assert ww == pytest.approx(0.01**2 * 5.0 + (0.02 * 5.0) ** 2)


@pytest.mark.parametrize(("yaw_rad", "across"), [(0.0, 1j), (0.5 * math.pi, -1.0 + 0j)])
def test_what_is_unsure_about_the_yaw_is_unsure_across_the_course(yaw_rad: float, across: complex) -> None:
    pose_filter = PoseFilter(SETTINGS, (), prior=NO_SLIP)
    pose_filter.predict(STANDING, Turn(angle_rad=1.0, source=YawSource.WHEELS))
    turn = Turn(angle_rad=yaw_rad - 1.0, source=YawSource.GYRO)
    pose_filter.predict(STANDING, turn)
    _, _, _, _, _, before = pose_filter.covariance
    pose_filter.predict(replace(STANDING, x_m=2.0), Turn(angle_rad=0.0, source=YawSource.GYRO))
    xx, _, xw, yy, yw, _ = pose_filter.covariance
    assert before == pytest.approx(0.1**2)
    assert complex(xw, yw) == pytest.approx(2.0 * before * across, abs=1e-9)
    assert complex(xx, yy) == pytest.approx(
        0.05**2 * 2.0 * (1 + 1j) + 4.0 * before * complex(abs(across.real), across.imag), abs=1e-9
    )


@pytest.mark.parametrize(("yaw_rad", "across"), [(0.0, 1j), (0.5 * math.pi, -1.0 + 0j)])
def test_an_unknown_bias_bends_the_course(yaw_rad: float, across: complex) -> None:
    pose_filter = PoseFilter(SETTINGS, (), prior=NO_SLIP)
    pose_filter.predict(STANDING, Turn(angle_rad=yaw_rad, source=YawSource.GYRO))
    increment = replace(STANDING, x_m=2.0, duration_s=3.0)
    pose_filter.predict(increment, Turn(angle_rad=0.0, source=YawSource.GYRO, covered_s=3.0))
    _, _, xw, _, yw, _ = pose_filter.covariance
    # Yaw error -3 s b at the end, half of it on the way.
    assert complex(xw, yw) == pytest.approx(2.0 * 1.5 * 3.0 * 0.02**2 * across, rel=1e-3, abs=1e-7)


def test_the_bias_is_forgotten_slowly() -> None:
    pose_filter = PoseFilter(SETTINGS, (), prior=NO_SLIP)
    pose_filter.predict(replace(STANDING, duration_s=10_000.0), NO_TURN)
    innovation = correct_bias(pose_filter, 0.0)
    assert innovation.variance == pytest.approx(0.02**2 + 1e-4**2 * 10_000.0 + 0.01**2)


def test_the_yaw_spreads_the_position_across_the_course() -> None:
    pose_filter = PoseFilter(SETTINGS, (), prior=NO_SLIP)
    pose_filter.predict(STANDING, Turn(angle_rad=0.25, source=YawSource.WHEELS))
    pose_filter.predict(replace(STANDING, x_m=10.0), Turn(angle_rad=-0.25, source=YawSource.WHEELS))
    xx, xy, _, yy, yw, ww = pose_filter.covariance
    assert yy > 0.05**2 * 10.0 + 0.1**2 * 0.25 * 9.0**2
    assert yw > 0.0
    assert abs(xy) < 0.2 * yy
    assert xx < yy
    assert ww == pytest.approx(0.1**2 * 0.5 + 0.05**2 * 10.0)


def test_an_estimate_can_be_logged_and_knows_when_it_is_not_finite() -> None:
    estimate = PoseEstimate(
        t_ns=1,
        x_m=1.0,
        y_m=2.0,
        yaw_rad=0.5,
        velocity_x_m_s=0.1,
        velocity_y_m_s=0.0,
        yaw_rate_rad_s=0.0,
        gyro_bias_rad_s=0.0,
        covariance=(1.0, 0.0, 0.0, 1.0, 0.0, 1.0),
        yaw_source=YawSource.GYRO,
    )
    assert json.loads(json.dumps(asdict(estimate)))["yaw_source"] == "gyro"
    assert estimate.is_finite
    assert not replace(estimate, yaw_rate_rad_s=math.nan).is_finite
    assert not replace(estimate, covariance=(math.inf, 0.0, 0.0, 1.0, 0.0, 1.0)).is_finite


def test_the_deviation_of_a_compass_is_learned_and_does_not_bend_the_yaw() -> None:
    def yaw_error_deg(deviation_rad: float) -> float:
        rng = np.random.default_rng(4)
        settings = FilterSettings(
            gyro_noise_rad_sqrt_s=0.002,
            gyro_bias_rad_s=0.001,
            heading_noise_rad=math.radians(0.3),
            heading_deviation_rad=deviation_rad,
        )
        pose_filter = PoseFilter(settings, ("compass",), prior=NO_SLIP)
        yaw, errors = 0.0, []
        for _ in range(1500):
            turn = 0.02
            yaw += turn
            pose_filter.predict(
                BodyIncrement(x_m=0.0, y_m=0.0, turn_rad=turn, duration_s=0.1, turned_rad=()),
                Turn(angle_rad=turn, source=YawSource.GYRO, covered_s=0.1),
            )
            read = yaw + math.radians(1.5) * math.sin(2.0 * yaw + 1.0)
            noise = math.radians(0.3) * float(rng.standard_normal())
            correct_heading(pose_filter, HeadingReference.MAGNETIC, read + noise, 0.0)
            errors.append(wrap_angle(pose_filter.pose.yaw_rad - yaw))
        return math.degrees(float(np.sqrt(np.mean(np.square(errors[300:])))))

    assert yaw_error_deg(math.radians(1.0)) < 0.4
    assert yaw_error_deg(0.0) > 2.0 * yaw_error_deg(math.radians(1.0))


def read_headings(headings_rad: Sequence[float]) -> tuple[PoseFilter, list[tuple[Innovation, float]]]:
    """Read headings of a rover that stands; return each innovation with the yaw after it."""
    pose_filter, reader = PoseFilter(SETTINGS, ("compass",), prior=NO_SLIP), HeadingReader()
    here = WayBack(x_m=0.0, y_m=0.0, turned_rad=0.0, position_m2=0.0, yaw_rad2=0.0)
    now = Situation(
        pose_filter=pose_filter,
        settings=SETTINGS,
        history=MotionHistory(),
        measured_ns=0,
        way_back=here,
        yaw_rate_rad_s=0.0,
    )
    read = []
    for number, heading_rad in enumerate(headings_rad):
        if number == 1:
            pose_filter.kalman.add_variance(YAW, math.radians(5.0) ** 2)
        sample = HeadingSample(device="compass", t_ns=number, heading_rad=heading_rad, reference=MAGNETIC)
        (innovation,) = reader.correct(sample, now)
        read.append((innovation, pose_filter.kalman.value(YAW)))
    return pose_filter, read


def test_arbitrary_headings_that_the_gate_accepts_by_chance_do_not_correct() -> None:
    headings = np.random.default_rng(2).uniform(-math.pi, math.pi, 2000)
    pose_filter, read = read_headings([0.0, 2.0, *headings])
    accepted = sum(innovation.accepted for innovation, _ in read[1:])
    assert accepted > 50
    assert abs(read[-1][1]) < 3.0 * math.sqrt(pose_filter.covariance[-1])
    assert len({yaw_rad for _, yaw_rad in read[1:]}) <= 3


def test_a_heading_that_is_right_again_corrects_after_a_few() -> None:
    _, read = read_headings([0.0, 2.0, *([0.1] * 10)])
    assert not read[1][0].accepted
    assert [innovation.accepted for innovation, _ in read[2:]] == [True] * 10
    corrected = [yaw_rad != 0.0 for _, yaw_rad in read[2:]]
    assert corrected == [False, False, False, *[True] * 7]


def test_headings_that_were_never_rejected_correct_at_once() -> None:
    _, read = read_headings([0.0, 0.1])
    assert read[1][1] > 0.0


def test_rotation_on_the_spot_moves_the_place_where_the_ground_says_so() -> None:
    ground = GroundSettings(
        slip="learned", slip_sd=0.001, source="drives", noise_m_sqrt_m=0.003, noise_m_sqrt_rad=0.002
    )
    pose_filter = PoseFilter(SETTINGS, (), prior=ground.prior())
    for _ in range(100):
        pose_filter.predict(STANDING, Turn(angle_rad=0.09, source=YawSource.WHEELS))
    xx, _, _, yy, *_ = pose_filter.covariance
    assert [math.sqrt(xx), math.sqrt(yy)] == pytest.approx([0.002 * 3.0] * 2, rel=0.01)
