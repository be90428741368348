"""Frames that are lost, pairs that are not valid, cameras that are mounted otherwise than their rig says."""

import math
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.safety.missions import drive as run_mission
from benchmarks.safety.missions import el_dorado
from controllers.ground_motion.estimator import GroundMotionEstimator
from controllers.ground_motion.ground_view import GroundView
from controllers.ground_motion.motion import GroundMotion, WheelPrior
from controllers.ground_motion.parameters import DEFAULTS
from controllers.ground_motion.prior import MotionPrior, turned
from controllers.ground_motion.rig_tolerance import RigTolerance
from controllers.ground_motion.structure import FineStructure
from controllers.motion.settings import WaypointsMission
from controllers.operator import OperatorInput
from controllers.safety import Mode
from drivers.clock import seconds
from drivers.samples import FrameSample, Image
from tests.controllers.ground_drive import EXACT, Drive, start
from tests.controllers.ground_motion.test_estimator import GROUND, patch_at, wide_ground
from tests.controllers.simulated import Noise
from tests.nature.ground_camera import GroundCamera

SECOND_NS = 1_000_000_000


class Losing(GroundCamera):
    """A camera at 10 Hz of which seven frames in a row are lost, again and again."""

    def frames(self, now_ns: int) -> list[FrameSample]:
        return [frame for frame in super().frames(now_ns) if frame.index % 10 < 3]


@pytest.mark.parametrize("period_s", [0.6, 0.9, 2.5])
def test_a_camera_slower_than_its_pairs_may_last_never_makes_a_step_raise(period_s: float) -> None:
    drive = start(replace(EXACT, period_ns=round(period_s * SECOND_NS)), slip=0.3)
    assert drive.run(10.0)[-1].mode is Mode.RUNNING


def test_frames_lost_in_a_row_are_bridged() -> None:
    drive = start(camera=Losing, slip=0.3)
    assert drive.error_m(drive.run(10.0)[-1]) < 0.02


class EverySecond(GroundCamera):
    """A camera of which every second pair measures nothing."""

    def measure(self, frame: FrameSample, t_ns: int, prior: object) -> GroundMotion | None:
        found = super().measure(frame, t_ns, prior)
        if found is None or frame.index % 2:
            return found
        return replace(found, forward_m=0.0, left_m=0.0, invalid_because="too few points move alike")


def test_a_pair_that_follows_one_without_a_measurement_is_used() -> None:
    drive = start(camera=EverySecond, slip=0.8)
    assert drive.error_m(drive.run(10.0)[-1]) < 0.05


def test_entrapment_is_told_where_every_second_pair_is_not_valid() -> None:
    drive = start(camera=EverySecond)
    drive.rover.noise = Noise(gyro_rad_s=0.001)  # a gyro that repeats one reading is dead
    drive.run(3.0)
    drive.rover.slip = 1.0
    before_m = drive.loop_odometry_m()
    last = drive.run(3.0)[-1]
    assert last.reason.startswith("rover: stuck")
    assert last.odometry.x_m - before_m < 0.4


class Pictures(GroundCamera):
    """Measures the motion in pictures of the ground; `view` is how the camera is mounted.

    `longer` is the focal length of the camera over that of its rig.
    """

    longer = 1.0

    def __init__(self, *arguments: object) -> None:
        super().__init__(*arguments)  # type: ignore[arg-type]
        self.point_m = GROUND.rig.point_m
        self._meter = GroundMotionEstimator(GroundView(GROUND), RigTolerance())
        self._structure = FineStructure(GROUND, DEFAULTS.structure)
        self._wide = wide_ground(length=2600)
        self._told_ns: int | None = None

    def view(self, picture: Image) -> Image:
        return picture

    @property
    def from_ns(self) -> int | None:
        return self._meter.from_ns

    def measure(self, frame: FrameSample, t_ns: int, prior: object) -> GroundMotion | None:
        assert isinstance(prior, WheelPrior)
        dt_s = 0.0 if self._told_ns is None else seconds(t_ns - self._told_ns)
        self._told_ns = t_ns
        travel_m = self.longer * (self._seen[t_ns].place_m - self._start_m).real
        patch = self.view(patch_at(self._wide, travel_m - 5.0))
        still = (0.0, 0.0, 0.0)
        turn_rad, turn_sd_rad = turned(still, still, dt_s, DEFAULTS.turn)
        return self._meter.step_patch(
            t_ns,
            patch,
            self._structure.of(self._structure.log_grey(patch)),
            MotionPrior(
                forward_m=prior.forward_m, left_m=prior.left_m, turn_rad=turn_rad, turn_sd_rad=turn_sd_rad
            ),
        )


class UpsideDown(Pictures):
    """Mounted upside down."""

    def view(self, picture: Image) -> Image:
        return np.asarray(picture[::-1, ::-1].copy(), np.uint8)


class Longer(Pictures):
    """With a focal length one and a half times that of its rig."""

    longer = 1.5


ERRORS_30_HZ = replace(EXACT, period_ns=33_000_000)


def error_over_sd(drive: Drive, duration_s: float) -> tuple[float, float]:
    """Return the greatest error of the estimate, m, and its greatest one in told standard deviations."""
    outputs = []
    for _ in range(round(duration_s / 0.02)):
        last = drive.run(0.02)[-1]
        sd_m = math.sqrt(last.estimate.covariance[0] + last.estimate.covariance[3])
        outputs.append((drive.error_m(last), drive.error_m(last) / max(sd_m, 0.002)))
    errors_m, deviations = zip(*outputs, strict=True)
    return max(errors_m), max(deviations)


@pytest.mark.parametrize(
    ("camera", "words"), [(UpsideDown, "not upside down"), (Longer, "check focal length")]
)
def test_a_wrong_rig_is_named_and_does_not_move_the_pose(camera: type[GroundCamera], words: str) -> None:
    drive = start(ERRORS_30_HZ, camera=camera)
    error_m, deviations = error_over_sd(drive, 3.0)
    report = drive.run(0.02)[-1].ground
    assert report is not None
    assert words in report.reason
    assert error_m < 0.04
    assert deviations < 3.0


def test_pictures_of_a_camera_that_is_mounted_as_told_are_used() -> None:
    drive = start(ERRORS_30_HZ, camera=Pictures, slip=0.3)
    error_m, _ = error_over_sd(drive, 3.0)
    report = drive.run(0.02)[-1].ground
    assert report is not None
    assert report.reason == ""
    assert report.slip == pytest.approx(0.3, abs=0.03)
    assert error_m < 0.02


def test_a_focal_length_that_slip_has_hidden_is_named_later_and_the_pose_becomes_uncertain() -> None:
    drive = start(replace(EXACT, period_ns=80_000_000), camera=Longer, slip=0.35)
    drive.run(6.0)
    drive.rover.slip = 0.0
    reasons = [report.reason for output in drive.run(10.0) if (report := output.ground)]
    assert any("times as far as the wheels: check focal length" in reason for reason in reasons)
    last = drive.run(0.02)[-1]
    assert drive.error_m(last) < 3.0 * math.sqrt(last.estimate.covariance[0])


class Quarter(GroundCamera):
    """A camera that is turned to the left by a quarter, and knows nothing of it."""

    def measure(self, frame: FrameSample, t_ns: int, prior: object) -> GroundMotion | None:
        found = super().measure(frame, t_ns, prior)
        return found and replace(found, forward_m=found.left_m, left_m=-found.forward_m)


def test_a_camera_that_is_turned_is_no_rover_that_is_stuck() -> None:
    drive = start(camera=Quarter)
    reasons = {output.reason for output in drive.run(6.0)}
    assert not any("stuck" in reason for reason in reasons)


def test_a_rover_that_is_parked_has_a_velocity_and_no_slip() -> None:
    short = WaypointsMission(type="waypoints", points=((0.3, 0.0),), speed_m_s=0.2)
    drive = start(ERRORS_30_HZ, slip=0.3, mission=short)
    reports = [output.ground for output in drive.run(12.0)]
    moving, parked = reports[75], reports[-1]
    assert moving is not None
    assert parked is not None
    assert moving.slip == pytest.approx(0.3, abs=0.02)
    assert (parked.reason, parked.slip, parked.slip_sd, parked.drift_rad) == ("", None, None, None)
    assert parked.velocity_x_m_s == pytest.approx(0.0, abs=0.005)


def test_after_a_rest_the_slip_is_that_of_the_new_travel() -> None:
    drive = start(ERRORS_30_HZ, slip=0.3)
    drive.run(4.0)
    drive.loop.operate(drive.rover.t_ns, OperatorInput(is_paused=True))
    drive.run(3.0)
    drive.rover.slip = 0.8
    drive.loop.operate(drive.rover.t_ns, OperatorInput(is_paused=False))
    slips = [
        report.slip for output in drive.run(1.0) if (report := output.ground) and report.slip is not None
    ]
    assert slips[0] == pytest.approx(0.8, abs=0.03)


def test_beside_a_slip_law_the_velocity_is_that_over_the_ground() -> None:
    config = el_dorado(1004)
    driven = run_mission(
        config, limit_s=8.0, make_camera=lambda rover: GroundCamera(rover, np.random.default_rng(0), EXACT)
    )
    late = driven.moments[len(driven.moments) // 2 :]
    truth_m = abs(complex(*late[-1].truth[:2]) - complex(*late[0].truth[:2]))
    told_m = sum(
        math.hypot(each.output.estimate.velocity_x_m_s, each.output.estimate.velocity_y_m_s)
        for each in late[1:]
    ) * (late[1].t_s - late[0].t_s)
    assert told_m == pytest.approx(truth_m, rel=0.04)
