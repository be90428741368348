"""Absolute fixes: the tie between the frames, honest covariances, refusals."""

import cmath
import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from controllers.control_loop import ControlLoop
from controllers.estimation.filter.guarded_filter import Array, Innovation, Outcome
from controllers.estimation.filter.measurement_model import Measured
from controllers.estimation.filter.motion_history import WayBack
from controllers.estimation.filter.transition import Turn
from controllers.estimation.pose_estimate import YawSource
from controllers.estimation.settings import FilterSettings
from controllers.estimation.wheels.odometry import BodyIncrement
from controllers.estimator import Estimator
from controllers.motion.kinematics import make_kinematics
from controllers.motion.planar import Pose, wrap_angle
from controllers.roles import DeviceRoles
from controllers.safety import Mode
from drivers.samples import PoseFixSample, Sample
from tests.cases import first_often
from tests.controllers.floor_fixes import FIX, NO_SLIP, PositionFilter, PositionQueue, on_floor
from tests.controllers.simulated import (
    LONG_WAY,
    OMNI,
    PERIOD_NS,
    ROLES,
    SECOND_NS,
    START_NS,
    SimulatedRover,
    make_settings,
    omni_geometry,
    omni_rover,
)

HERE = WayBack(x_m=0.0, y_m=0.0, turned_rad=0.0, position_m2=0.0, yaw_rad2=0.0)
AHEAD = BodyIncrement(x_m=0.1, y_m=0.0, turn_rad=0.0, duration_s=0.1)
NO_TURN = Turn(angle_rad=0.0, source=YawSource.GYRO)
FIX_ROLES = DeviceRoles(
    wheels="wheels", gyro="gyro", required={"wheels": 0.15, "gyro": 0.15}, fixes=("overhead",)
)


@pytest.mark.parametrize("place", [0j, 0.8 - 0.3j])
def test_the_first_fix_ties_the_frames_wherever_the_rover_is(place: complex) -> None:
    pose_filter = PositionFilter(FilterSettings(), (), ("overhead",))
    pose_filter.predict(replace(AHEAD, x_m=place.real, y_m=place.imag), NO_TURN)
    before = pose_filter.pose
    first = pose_filter.positions.take(on_floor(place, 0.0), HERE)
    assert [innovation.name for innovation in first] == ["overhead x", "overhead y", "overhead yaw"]
    assert all(innovation.accepted for innovation in first)
    assert pose_filter.pose.x_m == pytest.approx(before.x_m, abs=1e-6)
    assert pose_filter.pose.yaw_rad == pytest.approx(before.yaw_rad, abs=1e-6)
    pose_filter.predict(AHEAD, replace(NO_TURN, angle_rad=0.3))
    after = pose_filter.pose
    second = pose_filter.positions.take(on_floor(complex(after.x_m, after.y_m), after.yaw_rad), HERE)
    assert [innovation.residual for innovation in second] == pytest.approx([0.0, 0.0, 0.0], abs=1e-4)


def test_a_late_fix_is_compared_with_the_pose_of_its_time() -> None:
    pose_filter = PositionFilter(FilterSettings(), (), ("overhead",))
    pose_filter.positions.take(on_floor(0j, 0.0), HERE)
    pose_filter.predict(AHEAD, replace(NO_TURN, angle_rad=0.4))
    # The chord of the step points 0.2 rad to the left, which is 0.2 rad to the right of the present heading.
    arm = -0.1 * cmath.rect(1.0, -0.2)
    way_back = replace(HERE, x_m=arm.real, y_m=arm.imag, turned_rad=0.4)
    innovations = pose_filter.positions.take(on_floor(0j, 0.0), way_back)
    assert [innovation.residual for innovation in innovations] == pytest.approx([0.0, 0.0, 0.0], abs=1e-4)


def test_the_motion_since_the_picture_makes_a_fix_less_certain() -> None:
    variances = []
    for position_m2, yaw_rad2 in ((0.0, 0.0), (1e-3, 2e-3)):
        pose_filter = PositionFilter(FilterSettings(), (), ("overhead",))
        pose_filter.positions.take(on_floor(0j, 0.0), HERE)
        way_back = replace(HERE, position_m2=position_m2, yaw_rad2=yaw_rad2)
        innovations = pose_filter.positions.take(on_floor(0j, 0.0), way_back)
        variances.append([innovation.variance or 0.0 for innovation in innovations])
    assert np.subtract(variances[1], variances[0]) == pytest.approx([1e-3, 1e-3, 2e-3])


def test_the_slopes_are_those_of_the_expected_fix(monkeypatch: pytest.MonkeyPatch) -> None:
    pose_filter = PositionFilter(FilterSettings(), (), ("overhead",))
    pose_filter.positions.take(on_floor(0j, 0.0), HERE)
    pose_filter.predict(replace(AHEAD, x_m=0.7, y_m=-0.2), replace(NO_TURN, angle_rad=0.9))
    way_back = replace(HERE, x_m=-0.3, y_m=0.1, turned_rad=0.2)
    asked: list[tuple[Array, Array]] = []

    def note(
        names: object, residuals: Array, rows: Array, variances: object, held: object
    ) -> tuple[Innovation, ...]:
        asked.append((residuals, rows))
        return (
            Innovation(
                measured=Measured(""), residual=None, variance=None, nis=None, outcome=Outcome.ACCEPTED
            ),
        )

    monkeypatch.setattr(pose_filter.kalman, "update_together", note)
    state, step = pose_filter.kalman.state, 1e-6
    fix = on_floor(0.5 + 0.1j, 0.6)
    pose_filter.positions.take(fix, way_back)
    for index, value in enumerate(state):
        pose_filter.kalman.assign(index, value + step)
        pose_filter.positions.take(fix, way_back)
        pose_filter.kalman.assign(index, value)
        slope = (asked[0][0] - asked[-1][0]) / step
        assert asked[0][1][:, index] == pytest.approx(slope, abs=1e-5)


def settled(place: complex = 0j) -> PositionFilter:
    pose_filter = PositionFilter(FilterSettings(), (), ("overhead",))
    for _ in range(5):
        pose_filter.positions.take(on_floor(place, 0.0), HERE)
    return pose_filter


@pytest.mark.parametrize(
    "wild", [on_floor(0.5 + 0j, 0.0), on_floor(0j, 0.5), replace(on_floor(0j, 0.0), x_m=math.nan)]
)
def test_a_wild_fix_is_refused_as_a_whole(wild: PoseFixSample) -> None:
    pose_filter = settled()
    before, covariance = pose_filter.pose, pose_filter.covariance
    innovations = pose_filter.positions.take(wild, HERE)
    assert not any(innovation.accepted for innovation in innovations)
    assert (pose_filter.pose, pose_filter.covariance) == (before, covariance)


def test_fixes_that_are_not_numbers_never_move_the_estimate() -> None:
    pose_filter = PositionFilter(FilterSettings(), (), ("overhead",))
    for _ in range(5):
        pose_filter.positions.take(replace(FIX, yaw_rad=math.inf), HERE)
    assert pose_filter.pose == Pose()
    assert all(i.accepted for i in pose_filter.positions.take(on_floor(0j, 0.0), HERE))


def test_a_rover_that_was_carried_away_is_found_again_by_the_third_fix() -> None:
    pose_filter = settled()
    moved = on_floor(0.4 + 0.3j, 0.2)
    accepted = [pose_filter.positions.take(moved, HERE)[0].accepted for _ in range(3)]
    assert accepted == [False, False, True]
    for _ in range(5):
        assert pose_filter.positions.take(moved, HERE)[0].accepted
    assert (pose_filter.pose.x_m, pose_filter.pose.y_m) == pytest.approx((0.4, 0.3), abs=0.01)
    assert pose_filter.pose.yaw_rad == pytest.approx(0.2, abs=0.01)


def test_directly_after_a_displaced_fix_was_taken_a_wild_one_is_refused() -> None:
    pose_filter = settled()
    for _ in range(3):
        pose_filter.positions.take(on_floor(0.4 + 0.3j, 0.2), HERE)
    assert not pose_filter.positions.take(on_floor(-2.0 + 0.3j, 0.2), HERE)[0].accepted


@pytest.mark.parametrize(("place", "stops"), [(0.4 + 0.3j, True), (0.1 + 0j, False)])
def test_a_rover_that_follows_displaced_fixes_stops_and_names_their_device(
    place: complex, stops: bool
) -> None:
    loop = ControlLoop(make_settings(mission=LONG_WAY), FIX_ROLES)
    rover = omni_rover()
    reasons: set[str] = set()
    for cycle in range(400):
        samples: list[Sample] = [*rover.advance(rover.t_ns + PERIOD_NS)]
        if cycle % 25 == 0:
            off = place if cycle >= 200 else 0j
            fix = on_floor(rover.place + off, rover.yaw_rad)
            samples.append(replace(fix, t_ns=rover.t_ns, t_capture_ns=rover.t_ns))
        output = loop.step(rover.t_ns, samples)
        rover.set_point_rad_s = np.array(output.command.speed_rad_s)
        if output.mode is Mode.SAFE_STOP:
            reasons.add(output.reason)
    if stops:
        (reason,) = reasons
        assert reason.startswith("overhead: fixes displaced by 0.")
        assert reason.endswith("rover carried, device moved, or wheels slipped more than [filter] expects")
    else:
        assert not reasons
    assert output.mode is Mode.RUNNING


def test_single_wild_fixes_among_good_ones_are_never_taken() -> None:
    pose_filter = settled()
    wild = on_floor(0.4 + 0.3j, 0.2)
    for _ in range(6):
        assert not pose_filter.positions.take(wild, HERE)[0].accepted
        assert not pose_filter.positions.take(wild, HERE)[0].accepted
        assert pose_filter.positions.take(on_floor(0j, 0.0), HERE)[0].accepted
    assert abs(pose_filter.pose.x_m) < 1e-3


class NoisyDrive:
    """Truth and what the sensors make of it, with exactly the noise that the filter assumes; late fixes."""

    def __init__(self, seed: int, settling_fixes: int) -> None:
        self.rng = np.random.default_rng(seed)
        self.settings = FilterSettings(position_noise_m_sqrt_m=0.05, gyro_noise_rad_sqrt_s=0.01)
        self.floor = Pose(x_m=self.rng.uniform(-3, 3), y_m=1.0, yaw_rad=self.rng.uniform(-math.pi, math.pi))
        self.bias_rad_s = self.settings.gyro_bias_rad_s * self.rng.normal()
        self.filter = PositionFilter(self.settings, (), ("overhead",), prior=NO_SLIP)
        self.queue = PositionQueue()
        self.place, self.yaw_rad, self.t_ns = 0j, 0.0, START_NS
        self.pending: list[PoseFixSample] = []
        self.innovations: list[tuple[Innovation, ...]] = []
        for _ in range(settling_fixes):
            self.filter.positions.take(self._see(), HERE)

    def drive(self, steps: int) -> None:
        for step in range(steps):
            self._move(0.004, 0.003 * math.sin(0.05 * step), 0.02)
            if step % 25 == 10:
                self.pending.append(self._see())
            if step % 25 == 14:
                for fix in self.pending:
                    self.queue.add(fix, self.t_ns)
                self.pending.clear()
            for fix, way_back in self.queue.take():
                assert way_back is not None
                self.innovations.append(self.filter.positions.take(fix, way_back))

    def nees(self) -> float:
        pose, (xx, xy, xw, yy, yw, ww) = self.filter.pose, self.filter.covariance
        error = np.array(
            [
                pose.x_m - self.place.real,
                pose.y_m - self.place.imag,
                wrap_angle(pose.yaw_rad - self.yaw_rad),
            ]
        )
        return float(error @ np.linalg.solve(np.array([[xx, xy, xw], [xy, yy, yw], [xw, yw, ww]]), error))

    def _see(self) -> PoseFixSample:
        exact = on_floor(self.place, self.yaw_rad, self.floor)
        noise = self.rng.normal(0.0, (FIX.position_std_m, FIX.position_std_m, FIX.yaw_std_rad))
        return replace(
            exact,
            x_m=exact.x_m + noise[0],
            y_m=exact.y_m + noise[1],
            yaw_rad=wrap_angle(exact.yaw_rad + noise[2]),
            t_capture_ns=self.t_ns,
        )

    def _move(self, x_m: float, y_m: float, turn_rad: float) -> None:
        self.place += cmath.rect(1.0, self.yaw_rad + 0.5 * turn_rad) * complex(x_m, y_m)
        self.yaw_rad += turn_rad
        self.t_ns += PERIOD_NS
        slip_m = self.settings.position_noise_m_sqrt_m * math.sqrt(math.hypot(x_m, y_m))
        noise_rad = self.settings.gyro_noise_rad_sqrt_s * math.sqrt(0.02) * self.rng.normal()
        measured = BodyIncrement(
            x_m=x_m + slip_m * self.rng.normal(),
            y_m=y_m + slip_m * self.rng.normal(),
            turn_rad=0.0,
            duration_s=0.02,
        )
        angle_rad = turn_rad + self.bias_rad_s * 0.02 + noise_rad
        turn = Turn(angle_rad=angle_rad, source=YawSource.GYRO, covered_s=0.02)
        self.queue.move(self.t_ns, self.filter.predict(measured, turn))


@pytest.mark.parametrize("settling_fixes", first_often([0, 3]))
def test_errors_are_as_large_as_the_covariance_says(settling_fixes: int) -> None:
    drives = [NoisyDrive(seed, settling_fixes) for seed in range(60)]
    for drive in drives:
        drive.drive(400)
        assert len(drive.innovations) == 16
    high = chi2.ppf(0.999, 3 * len(drives))
    # Smaller errors than told are meant: the motion since a picture counts once in the estimate and once in
    # the fix.
    assert 0.6 * 3 * len(drives) < sum(drive.nees() for drive in drives) < high


def test_fixes_bound_the_error_that_wheels_let_grow() -> None:
    drives = [NoisyDrive(seed, 3) for seed in range(20)]
    for drive in drives:
        drive.drive(400)
    final_m = [abs(complex(d.filter.pose.x_m, d.filter.pose.y_m) - d.place) for d in drives]
    # Without fixes: 0.05 sqrt(1.8 m) in x and in y, 95 mm.
    assert float(np.sqrt(np.mean(np.square(final_m)))) < 0.03


def seen_rover(rover: SimulatedRover, period: int, latency_ns: int) -> list[PoseFixSample]:
    """Return the fix that arrives in this cycle, if one does; the floor frame is `FLOOR`."""
    cycle = rover.t_ns // PERIOD_NS
    if cycle % period:
        return []
    fix = on_floor(rover.place, rover.yaw_rad)
    return [replace(fix, t_ns=rover.t_ns + latency_ns, t_capture_ns=rover.t_ns)]


def drive(loop: ControlLoop, rover: SimulatedRover, duration_s: float, period: int) -> list[Innovation]:
    """Close the loop with a fix every `period` cycles that arrives three cycles late."""
    innovations: list[Innovation] = []
    under_way: list[PoseFixSample] = []
    for _ in range(round(duration_s * SECOND_NS / PERIOD_NS)):
        samples = rover.advance(rover.t_ns + PERIOD_NS)
        arrived = [fix for fix in under_way if fix.t_ns <= rover.t_ns]
        under_way = [fix for fix in under_way if fix.t_ns > rover.t_ns]
        under_way += seen_rover(rover, period, 3 * PERIOD_NS)
        output = loop.step(rover.t_ns, [*samples, *arrived])
        rover.set_point_rad_s = np.array(output.command.speed_rad_s)
        innovations += output.innovations
    return innovations


def test_in_the_loop_fixes_hold_a_slipping_rover_on_its_estimate() -> None:
    errors_m = {}
    for roles in (ROLES, replace(FIX_ROLES, required={**FIX_ROLES.required})):
        rover = omni_rover()
        rover.slip = 0.15
        loop = ControlLoop(make_settings(mission=LONG_WAY), roles)
        innovations = drive(loop, rover, 12.0, period=50)
        estimate = loop.step(rover.t_ns, []).estimate
        errors_m[roles.fixes] = abs(complex(estimate.x_m, estimate.y_m) - rover.place)
        named = [i for i in innovations if i.name.startswith("overhead")]
        assert len(named) == (3 * 11 if roles.fixes else 0)
        assert all(innovation.accepted for innovation in named)
    assert errors_m[()] > 0.2
    assert errors_m["overhead",] < 0.04


@pytest.mark.parametrize("slip", [0.3, 0.7, 0.9])
def test_with_the_default_filter_slippery_ground_does_not_look_like_displaced_fixes(slip: float) -> None:
    rover = omni_rover()
    rover.slip = slip
    loop = ControlLoop(make_settings(mission=LONG_WAY), FIX_ROLES)
    innovations = drive(loop, rover, 20.0, period=100)
    assert loop.step(rover.t_ns, []).mode is Mode.RUNNING
    assert not [innovation for innovation in innovations if innovation.name.endswith("displaced")]


def test_fixes_need_not_be_required() -> None:
    rover = omni_rover()
    loop = ControlLoop(make_settings(mission=LONG_WAY), FIX_ROLES)
    drive(loop, rover, 3.0, period=10_000)
    assert loop.step(rover.t_ns, []).mode is Mode.RUNNING


def test_a_fix_too_old_to_be_used_is_reported_by_name() -> None:
    estimator = Estimator(make_kinematics(OMNI), FilterSettings(), 12.0, FIX_ROLES)
    rover = SimulatedRover(omni_geometry())
    old = replace(FIX, t_ns=START_NS + 4 * SECOND_NS, t_capture_ns=START_NS)
    reported: list[Innovation] = []
    for _ in range(200):
        for sample in rover.advance(rover.t_ns + PERIOD_NS):
            estimator.take(sample, sample.t_ns)
        reported += [i for i in estimator.advance(rover.t_ns) if i.name.startswith("overhead")]
    estimator.take(old, rover.t_ns)
    reported += [i for i in estimator.advance(rover.t_ns) if i.name.startswith("overhead")]
    (innovation,) = reported
    assert (innovation.name, innovation.accepted) == ("overhead too late", False)


def test_fixes_have_states_only_where_they_are_used() -> None:
    assert len(PositionFilter(FilterSettings(), ("compass",)).layout.variances) == 10
    assert len(PositionFilter(FilterSettings(), ("compass",), ("overhead",)).layout.variances) == 13
