"""Which motions lead back inside from over the border of the area."""

import cmath
import math

import pytest

from controllers.estimation.pose_estimate import PoseEstimate, YawSource
from controllers.motion.missions.mission import Guidance
from controllers.safety.area import PolygonArea
from controllers.safety.border import Border

SQUARE = PolygonArea(type="polygon", points_m=((-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)))


def estimate_at(x_m: float, y_m: float, yaw_rad: float) -> PoseEstimate:
    return PoseEstimate(
        t_ns=0,
        x_m=x_m,
        y_m=y_m,
        yaw_rad=yaw_rad,
        velocity_x_m_s=0.0,
        velocity_y_m_s=0.0,
        yaw_rate_rad_s=0.0,
        gyro_bias_rad_s=0.0,
        covariance=(0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
        yaw_source=YawSource.GYRO,
    )


def at(x_m: float, y_m: float, yaw_rad: float = 0.0) -> Border:
    border = Border(SQUARE, 0.2)
    border.measure(estimate_at(x_m, y_m, yaw_rad))
    return border


def velocity(direction_deg: float, speed_m_s: float = 0.3) -> Guidance:
    vector = cmath.rect(speed_m_s, math.radians(direction_deg))
    return Guidance(velocity_x_m_s=vector.real, velocity_y_m_s=vector.imag)


def test_inside_every_motion_is_possible() -> None:
    assert not any(at(0.79, 0.0).is_crossed_by(velocity(direction)) for direction in range(0, 360, 15))


@pytest.mark.parametrize(
    ("direction_deg", "leads_back"),
    [(0, False), (60, False), (90, False), (92, False), (94, True), (180, True), (266, True), (270, False)],
)
def test_over_an_edge_only_motion_back_inside_is_possible(direction_deg: float, leads_back: bool) -> None:
    for yaw_deg in (0.0, 120.0):
        border = at(0.9, 0.0, math.radians(yaw_deg))
        assert border.is_crossed_by(velocity(direction_deg - yaw_deg)) is not leads_back


def test_at_a_corner_no_motion_leads_out_over_the_other_edge() -> None:
    border = at(0.95, 0.9)
    assert border.is_crossed_by(velocity(135.0))
    assert not border.is_crossed_by(velocity(225.0))
    assert not border.is_crossed_by(velocity(185.0))


def test_rotation_on_the_spot_and_standstill_are_possible_everywhere() -> None:
    assert not at(5.0, 0.0).is_crossed_by(Guidance(yaw_rate_rad_s=0.5))
    assert not at(5.0, 0.0).is_crossed_by(Guidance(waits=True))


def test_without_an_area_nothing_is_crossed() -> None:
    border = Border(None, 0.2)
    border.measure(estimate_at(1e6, 0.0, 0.0))
    assert not border.is_crossed_by(velocity(0.0))
