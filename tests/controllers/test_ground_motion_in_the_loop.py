"""Motion over the ground by a camera: slip that nothing else shows, its deviation, its absence."""

import math
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.safety.missions import any_rig
from benchmarks.safety.missions import drive as run_mission
from controllers.estimation.gyro.unwatched_turn import UnwatchedTurn
from controllers.ground_motion.motion import GroundMotion
from controllers.ground_motion.settings import GroundMotionSettings
from controllers.motion.settings import WaypointsMission
from controllers.safety import Mode
from controllers.slip.effort.ground_knowledge import SlipSource
from drivers.samples import FrameSample, RateSample, Sample
from rover_hil.config import load_config
from tests.controllers.ground_drive import EXACT, WITHOUT_GYRO, start
from tests.controllers.simulated import SECOND_NS
from tests.nature.ground_camera import DEVICE, CameraErrors, GroundCamera

BLIND = "too few points move alike"


def half_of_the_turn(sample: Sample) -> Sample:
    """Return what a gyro with half the gain measures."""
    return (
        replace(sample, rate_z_rad_s=0.5 * sample.rate_z_rad_s) if isinstance(sample, RateSample) else sample
    )


@pytest.mark.parametrize("slip", [0.0, 0.5, 0.9])
def test_the_estimate_follows_the_ground_and_not_the_wheels(slip: float) -> None:
    drive = start(slip=slip)
    last = drive.run(12.0)[-1]
    assert abs(drive.rover.place) > 1.5 * (1.0 - slip)
    assert drive.error_m(last) < 0.01
    assert last.ground is not None
    assert last.ground.slip == pytest.approx(slip, abs=0.02)
    assert last.estimate.velocity_x_m_s == pytest.approx(0.2 * (1.0 - slip), abs=0.02)


def test_slip_that_changes_between_frames_leaves_nothing_behind() -> None:
    """Each frame is compared with where the rover was at the one before, however late it comes."""
    drive = start()
    drive.run(2.0)
    for slip in [0.8, 0.1] * 8:
        drive.rover.slip = slip
        drive.run(0.5)
    drive.rover.slip = 0.0
    assert drive.error_m(drive.run(1.0)[-1]) < 0.01


def test_the_deviation_grows_in_proportion_to_the_travel() -> None:
    drive = start(replace(EXACT, scale_sd=0.02), slip=0.3)
    deviations_m, places_m = [], []
    for _ in range(2):
        last = drive.run(10.0)[-1]
        deviations_m.append(math.sqrt(last.estimate.covariance[0]))
        places_m.append(drive.rover.place.real)
    assert deviations_m == pytest.approx([0.02 * place_m for place_m in places_m], rel=0.1)


def test_what_is_not_measured_is_absent_and_the_deviation_widens() -> None:
    drive = start(replace(EXACT, blind_m=0.5), slip=0.5)
    outputs = drive.run(12.0)
    seeing, last = outputs[200], outputs[-1]
    assert seeing.ground is not None
    assert seeing.ground.reason == ""
    assert last.ground is not None
    assert last.ground.reason == "too few points move alike"
    assert last.ground.slip is None
    assert last.ground.velocity_x_m_s is None
    assert drive.error_m(last) < 3.0 * math.sqrt(last.estimate.covariance[0])
    assert math.sqrt(last.estimate.covariance[0]) > 10.0 * math.sqrt(seeing.estimate.covariance[0])


def test_a_few_pairs_that_are_not_valid_leave_the_slip_in_force() -> None:
    drive = start(replace(EXACT, burst_probability=0.2, longest_burst=3), slip=0.5)
    assert drive.error_m(drive.run(12.0)[-1]) < 0.06


def test_a_turn_on_the_spot_is_no_travel_though_the_camera_swings() -> None:
    drive = start(mission=WaypointsMission(type="waypoints", points=((-3.0, 0.0),), heading="along_path"))
    outputs = drive.run(4.0)
    assert abs(drive.rover.yaw_rad) > 1.0
    assert drive.error_m(outputs[-1]) < 0.01


@pytest.mark.parametrize("is_wrong", [False, True])
def test_the_camera_watches_the_turn_of_the_gyro(is_wrong: bool) -> None:
    drive = start(mission=WaypointsMission(type="waypoints", points=((-3.0, 0.0),), heading="along_path"))
    drive.rover.mute = half_of_the_turn if is_wrong else drive.rover.mute
    turns = [
        innovation
        for output in drive.run(5.0)
        for innovation in output.innovations
        if innovation.name == f"{DEVICE} turn"
    ]
    assert len(turns) >= 3
    assert all(turn.accepted for turn in turns) != is_wrong


@pytest.mark.parametrize(("push_m", "error_m"), [(0.001, 0.01), (0.004, 0.5)])
def test_a_rover_that_is_pushed_while_its_wheels_rest_is_followed_or_uncertain(
    push_m: float, error_m: float
) -> None:
    """A fast push contradicts the wheels, or the camera is wrong: nobody knows."""
    drive = start(mission=None)
    resting = drive.run(2.0)[-1]
    assert resting.suspicion == ""
    for _ in range(100):
        drive.rover.place += push_m
        pushed = drive.run(0.02)[-1]
    assert pushed.suspicion.startswith("the wheels are at rest, but motion is reported by camera")
    last = drive.run(0.3)[-1]
    assert drive.error_m(last) < error_m
    assert drive.error_m(last) < 6.0 * math.sqrt(last.estimate.covariance[0])


def test_the_yaw_is_not_excited_while_the_slip_is_measured() -> None:
    config = load_config("robotino")
    turns_rad_s: dict[bool, float] = {}
    for has_camera in (False, True):
        camera = (lambda rover: GroundCamera(rover, np.random.default_rng(0))) if has_camera else None
        driven = run_mission(config, limit_s=5.0, make_camera=camera)
        speeds = np.array([moment.output.command.speed_rad_s for moment in driven.moments[150:]])
        turns_rad_s[has_camera] = float(np.abs(speeds.mean(axis=1)).max())
    assert turns_rad_s[False] > 1.0
    assert turns_rad_s[True] < 0.5


def test_the_yaw_is_excited_again_after_the_stated_time_without_a_valid_pair() -> None:
    """The camera is blind on a part of the way: the excitation begins on it, and ends after it."""
    config = load_config("robotino")
    errors = CameraErrors(burst_probability=0.0, blind_m=0.2, sees_again_m=0.5)
    driven = run_mission(
        config,
        limit_s=13.0,
        make_camera=lambda rover: GroundCamera(rover, np.random.default_rng(0), errors),
    )
    reports = [moment.output.ground for moment in driven.moments]
    is_blind = [report is not None and report.reason == BLIND for report in reports]
    begin, end = is_blind.index(True), len(is_blind) - is_blind[::-1].index(True)
    speeds_rad_s = np.array([moment.output.command.speed_rad_s for moment in driven.moments])
    turns_rad_s = speeds_rad_s.mean(axis=1)
    rate_hz = config.loop.rate_hz
    age_s = GroundMotionSettings(rig=any_rig()).greatest_age_s
    period_s, delay_s = errors.period_ns / SECOND_NS, errors.delay_ns / SECOND_NS
    # The age is that of the last valid exposure, a period and a delay before the first report of blindness.
    resumes, half = begin + round(rate_hz * (age_s - period_s - delay_s)), round(0.5 * rate_hz)
    assert np.ptp(turns_rad_s[begin - half : resumes]) < 0.2
    assert np.ptp(turns_rad_s[resumes : resumes + round(0.2 * rate_hz)]) > 0.3
    assert np.ptp(turns_rad_s[end - half : end]) > 0.8
    assert np.ptp(turns_rad_s[end + 2 : end + half]) < 0.6
    slips = [moment.output.slip for moment in driven.moments[resumes:end]]
    sources = {report.rover.source for report in slips if report is not None and report.rover is not None}
    assert SlipSource.EXCITATION in sources


def test_without_a_gyro_the_camera_also_measures_the_turn() -> None:
    """Wheels of one side that slip turn a rover that believes to drive straight on."""
    drive = start(roles=WITHOUT_GYRO)
    drive.rover.slip = np.array([0.3, 0.0, 0.0])
    last = drive.run(10.0)[-1]
    turned_rad = math.remainder(last.estimate.yaw_rad - drive.rover.yaw_rad, math.tau)
    assert abs(turned_rad) < 0.05
    assert drive.error_m(last) < 0.05


class Shared(GroundCamera):
    """A camera that reports errors which all pairs share; after 40 frames its scale is confirmed."""

    scale_sd, confirmed_sd, direction_sd_rad = 0.1, 0.1, 0.0

    def measure(self, frame: FrameSample, t_ns: int, prior: object) -> GroundMotion | None:
        found = super().measure(frame, t_ns, prior)
        scale_sd = self.scale_sd if frame.index < 40 else self.confirmed_sd
        return found and replace(found, scale_sd=scale_sd, direction_sd_rad=self.direction_sd_rad)


class Confirmed(Shared):
    confirmed_sd = 0.02


class Askew(Shared):
    scale_sd, confirmed_sd, direction_sd_rad = 0.0, 0.0, 0.05


@pytest.mark.parametrize(("slip", "most_m"), [(0.6, 0.01), (-0.2, 0.02)])
def test_the_slip_of_the_wheels_does_not_correct_the_scale_of_the_camera(slip: float, most_m: float) -> None:
    drive = start(slip=slip, camera=Shared)
    last = drive.run(20.0)[-1]
    assert drive.error_m(last) < most_m
    assert math.sqrt(last.estimate.covariance[0]) == pytest.approx(0.1 * drive.rover.place.real, rel=0.02)


def test_a_scale_that_is_confirmed_also_makes_the_path_before_more_certain() -> None:
    drive = start(slip=0.3, camera=Confirmed)
    before = drive.run(3.5)[-1]
    assert math.sqrt(before.estimate.covariance[0]) == pytest.approx(0.1 * drive.rover.place.real, rel=0.1)
    after = drive.run(6.0)[-1]
    assert math.sqrt(after.estimate.covariance[0]) == pytest.approx(0.02 * drive.rover.place.real, rel=0.15)


def test_the_direction_of_the_camera_makes_the_place_aside_uncertain() -> None:
    yaw_only, askew = start(camera=GroundCamera), start(camera=Askew)
    variances = [each.run(10.0)[-1].estimate.covariance[3] for each in (yaw_only, askew)]
    added_m = math.sqrt(variances[1] - variances[0])
    assert added_m == pytest.approx(0.05 * askew.rover.place.real, rel=0.1)


def test_a_turn_in_the_pictures_that_agrees_with_the_gyro_makes_the_yaw_more_certain(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    agreed = start().run(10.0)[-1]
    monkeypatch.setattr(UnwatchedTurn, "agree", lambda _, is_rotation: None)
    alone = start().run(10.0)[-1]
    assert agreed.estimate.covariance[5] < 0.4 * alone.estimate.covariance[5]


class Turning(GroundCamera):
    """A camera that is turned round after 40 frames."""

    def measure(self, frame: FrameSample, t_ns: int, prior: object) -> GroundMotion | None:
        found = super().measure(frame, t_ns, prior)
        if found is None or frame.index < 40:
            return found
        return replace(found, forward_m=-found.forward_m, left_m=-found.left_m)


def test_a_camera_that_contradicts_the_wheels_stops_the_rover_and_does_not_move_the_pose() -> None:
    drive = start(camera=Turning)
    drive.run(4.0)
    while (stopped := drive.run(0.02)[-1]).mode is Mode.RUNNING:
        assert drive.rover.t_ns < 10 * SECOND_NS
    assert stopped.reason.startswith(f"{DEVICE} forward: contradicts the estimate")
    assert drive.error_m(stopped) < 0.02


@pytest.mark.parametrize(("slip", "is_stopped"), [(1.0, True), (0.98, False)])
def test_a_rover_whose_ground_stands_still_is_stopped_for_good(slip: float, is_stopped: bool) -> None:
    drive = start(CameraErrors(), slip=0.2)
    drive.run(4.0)
    drive.rover.slip = slip
    before_m = drive.loop_odometry_m()
    outputs = drive.run(3.0)
    assert (outputs[-1].mode is Mode.EMERGENCY_STOP) == is_stopped
    if is_stopped:
        assert outputs[-1].reason.startswith("rover: stuck, its wheels travelled 0.1")
        assert outputs[-1].odometry.x_m - before_m < 0.3
