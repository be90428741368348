"""Rotations on the spot of a rover whose wheels skid: on a slope they displace it, and no wheel shows it."""

import math

import numpy as np
import pytest

from benchmarks.safety.faults.measures import RESOLUTION
from benchmarks.safety.missions import Driven, MakeCamera, drive, el_dorado, ground_camera
from controllers.estimation.filter.error_budget import ErrorBudget
from controllers.estimation.filter.pose_filter import PoseFilter
from controllers.estimation.filter.skid import SkidBound
from controllers.estimation.parameters import ESTIMATION
from controllers.estimation.settings import FilterSettings
from controllers.estimation.wheels.bounds import WheelBounds
from controllers.estimation.wheels.odometry import BodyIncrement
from controllers.estimator import Estimator
from controllers.motion.kinematics import make_kinematics
from controllers.motion.rover_geometry import SkidSteerRoverSettings, WheelsRoverSettings
from controllers.motion.wheel_settings import WheelSettings
from controllers.roles import DeviceRoles
from drivers.samples import WheelSample
from rover_hil.config import Config

ROVER = SkidSteerRoverSettings(kinematics="skid_steer_4", wheel_radius_m=0.1, track_m=0.6)
ROWS = WheelsRoverSettings(
    kinematics="wheels",
    wheels=tuple(WheelSettings(radius_m=0.1, x_m=x_m, y_m=y_m) for x_m in (0.3, -0.2) for y_m in (0.3, -0.3)),
)
"""The same rover, wheel by wheel."""
SLIP_SD = 0.2


class Bench:
    """A rover without a camera, and what is added to the covariance of a pose that was certain."""

    def __init__(self) -> None:
        self._kinematics = make_kinematics(ROVER)
        self._filter = PoseFilter(FilterSettings(), ())
        bounds = WheelBounds(self._kinematics, (), 5.0, has_gyro=True)
        self._skid = SkidBound(ErrorBudget(self._filter, bounds), bounds)

    def drive(
        self,
        left_m: float,
        right_m: float,
        *,
        is_measured: bool = False,
        steps: int = 100,
        kept: float = 1.0,
    ) -> float:
        """Let the rows of wheels roll so far; return the standard deviation of the position, in m."""
        angles_rad = [each / steps / ROVER.wheel_radius_m for each in (left_m, right_m)] * 2
        x_m, y_m, turn_rad = self._kinematics.body_motion(angles_rad)
        increment = BodyIncrement(
            x_m=kept * x_m,
            y_m=y_m,
            turn_rad=turn_rad,
            duration_s=0.02,
            turned_rad=tuple(angles_rad),
            is_measured=is_measured,
        )
        for _ in range(steps):
            self._skid.drive(increment, SLIP_SD)
        return math.sqrt(self._filter.covariance[0])


@pytest.mark.parametrize("rows_m", [(1.0, 1.0), (-1.0, -1.0), (0.2, 1.0), (0.0, 0.0)])
def test_rows_that_roll_one_way_add_nothing(rows_m: tuple[float, float]) -> None:
    assert Bench().drive(*rows_m) < 1e-5


def test_a_straight_way_that_compensation_shortens_adds_nothing() -> None:
    bench = Bench()
    assert bench.drive(1.0, 1.0, kept=0.5) < 1e-5


def test_a_rotation_on_the_spot_adds_slip_of_what_a_row_moves_the_rover() -> None:
    """A row alone moves the middle of the rover by half of its travel; errors of one rotation add up."""
    bench = Bench()
    assert bench.drive(-1.0, 1.0) == pytest.approx(0.5 * SLIP_SD, rel=1e-3)
    assert bench.drive(-1.0, 1.0) == pytest.approx(1.0 * SLIP_SD, rel=1e-3)


def test_a_drive_ahead_begins_anew() -> None:
    bench = Bench()
    bench.drive(-1.0, 1.0)
    bench.drive(1.0, 1.0)
    assert bench.drive(1.0, -1.0) == pytest.approx(math.sqrt(0.5) * SLIP_SD, rel=1e-3)


def test_while_a_camera_measures_it_any_slip_is_expected() -> None:
    bench = Bench()
    by_camera_m = bench.drive(-1.0, 1.0, is_measured=True)
    assert by_camera_m == pytest.approx(0.5 * ESTIMATION.ground.slip_sd, rel=1e-3)
    after_m = bench.drive(-1.0, 1.0)
    assert after_m == pytest.approx(math.hypot(by_camera_m, 0.5 * SLIP_SD), rel=1e-3)


def on_a_slope(seed: int, make_camera: MakeCamera | None) -> Driven:
    """Return the check manoeuvre, three rotations on the spot, on a slope of 12 deg."""
    table = el_dorado(seed).model_dump(by_alias=True)
    table["slip"] = table["scomp"] = None
    table["safety"]["check_manoeuvre"] = True
    table["simulation"]["plant"]["ground"]["inclination_deg"] = 12.0
    return drive(Config.model_validate(table), limit_s=11.0, make_camera=make_camera)


@pytest.mark.parametrize(("seed", "has_camera"), [(1, True), (2, True), (1, False), (2, False)])
def test_a_rotation_that_slides_down_a_slope_is_followed_or_uncertain(seed: int, has_camera: bool) -> None:
    driven = on_a_slope(seed, ground_camera(seed) if has_camera else None)
    last = driven.moments[-1]
    assert math.hypot(*last.truth[:2]) > 0.14
    if has_camera:
        assert math.hypot(*last.error[:2]) < 0.03
    for moment in driven.moments:
        xx, xy, xt, yy, yt, tt = moment.output.estimate.covariance
        covariance = np.array([[xx, xy, xt], [xy, yy, yt], [xt, yt, tt]]) + RESOLUTION**2 * np.eye(3)
        assert moment.error @ np.linalg.solve(covariance, moment.error) < 30.0


@pytest.mark.parametrize("rover", [ROVER, ROWS], ids=["skid_steer_4", "wheels"])
def test_the_estimate_of_a_rover_that_skids_contains_it(
    rover: SkidSteerRoverSettings | WheelsRoverSettings,
) -> None:
    roles = DeviceRoles(wheels="wheels", required={})
    estimator = Estimator(make_kinematics(rover), FilterSettings(), 5.0, roles)
    for now_ns in range(0, 4_000_000_000, 20_000_000):
        for wheel in range(4):
            rolled_rad = (-1e-9 if wheel % 2 else 1e-9) * now_ns
            sample = WheelSample(device="wheels", t_ns=now_ns, wheel=wheel, position_rad=rolled_rad)
            estimator.take(sample, now_ns)
        estimator.advance(now_ns)
    covariance = estimator.estimate(now_ns).covariance
    assert min(covariance[0], covariance[3]) > 0.05**2
