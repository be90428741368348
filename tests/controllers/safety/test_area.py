"""The area of the rover: shapes, and by how far the 95 % region of its position is over the border."""

import cmath
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from pydantic import TypeAdapter, ValidationError

from controllers.estimation.pose_estimate import PoseEstimate, YawSource
from controllers.safety.area import Area, CircleArea, Excess, PolygonArea
from controllers.safety.position_region import Region

AREA: TypeAdapter[CircleArea | PolygonArea] = TypeAdapter(Area)
SQUARE = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]
L_SHAPE = [[0.0, 0.0], [4.0, 0.0], [4.0, 1.0], [1.0, 1.0], [1.0, 4.0], [0.0, 4.0]]
ANGLES = np.linspace(0.0, 2.0 * np.pi, 4_001)
NEAR_M = 2e-3
"""Distance of the points of `rim`."""


def polygon(points: list[list[float]]) -> PolygonArea:
    return PolygonArea.model_validate({"type": "polygon", "points_m": points})


def circle(x_m: float = 0.0, y_m: float = 0.0, radius_m: float = 1.0) -> CircleArea:
    return CircleArea(type="circle", centre_m=(x_m, y_m), radius_m=radius_m)


def region(
    at: complex, long_m: float = 0.0, short_m: float = 0.0, turned_rad: float = 0.0, body_m: float = 0.0
) -> Region:
    """Return the region with these semi-axes, the first of which points along `turned_rad`."""
    c, s = math.cos(turned_rad), math.sin(turned_rad)
    xx = (long_m * c) ** 2 + (short_m * s) ** 2
    yy = (long_m * s) ** 2 + (short_m * c) ** 2
    return Region(at, xx, (long_m**2 - short_m**2) * s * c, yy, body_m)


def rim(of: Region) -> NDArray[np.complex128]:
    """Return points all around the ellipse of a region, by another way: its square root by eigenvectors."""
    values, vectors = np.linalg.eigh([[of.xx, of.xy], [of.xy, of.yy]])
    x, y = vectors @ (np.sqrt(np.maximum(values, 0.0))[:, None] * np.array([np.cos(ANGLES), np.sin(ANGLES)]))
    return np.asarray(of.centre + x + 1j * y)


def depth_m(corners: list[list[float]], points: NDArray[np.complex128]) -> NDArray[np.float64]:
    """Return the distance of points to the border of a polygon, negative outside."""
    nearest = np.full(points.shape, np.inf)
    winding = np.zeros(points.shape)
    for first, last in zip(corners, [*corners[1:], corners[0]], strict=True):
        start, end = complex(*first), complex(*last)
        share = np.clip(np.real((points - start) * np.conj(end - start)) / abs(end - start) ** 2, 0.0, 1.0)
        nearest = np.minimum(nearest, np.abs(points - start - share * (end - start)))
        winding += np.angle((end - points) * np.conj(start - points))
    return np.where(np.abs(winding) > np.pi, nearest, -nearest)


def test_the_region_is_that_of_95_percent() -> None:
    rng = np.random.default_rng(1)
    covariance = np.array([[0.04, 0.015], [0.015, 0.01]])
    drawn = rng.multivariate_normal((1.0, 2.0), covariance, 200_000)
    estimate = PoseEstimate(
        t_ns=0,
        x_m=1.0,
        y_m=2.0,
        yaw_rad=0.0,
        velocity_x_m_s=0.0,
        velocity_y_m_s=0.0,
        yaw_rate_rad_s=0.0,
        gyro_bias_rad_s=0.0,
        covariance=(0.04, 0.015, 0.0, 0.01, 0.0, 0.0),
        yaw_source=YawSource.GYRO,
    )
    found = Region.of(estimate, 0.3)
    assert found.body_m == 0.3
    seen = drawn - (1.0, 2.0)
    shape = np.array([[found.xx, found.xy], [found.xy, found.yy]])
    inside = np.einsum("ni,ij,nj->n", seen, np.linalg.inv(shape), seen) <= 1.0
    assert inside.mean() == pytest.approx(0.95, abs=0.002)
    across = cmath.rect(1.0, 0.7)
    reached = np.max(np.real((rim(found) - found.centre) * np.conj(across)))
    assert found.extent_m(across) == pytest.approx(reached, rel=1e-6)


lengths = st.floats(0.0, 1.5)
places = st.tuples(st.floats(-2.0, 5.0), st.floats(-2.0, 5.0)).map(lambda xy: complex(*xy))
regions = st.builds(region, places, lengths, lengths, st.floats(0.0, math.pi), st.floats(0.0, 0.5))


@given(regions, places)
def test_nearest_and_farthest_points_are_those_of_many_points(of: Region, point: complex) -> None:
    away_m = np.abs(rim(of) - point)
    assert abs(of.to_farthest(point)) == pytest.approx(away_m.max(), abs=NEAR_M)
    nearest_m = abs(of.from_nearest(point))
    if nearest_m > 0.0:
        assert nearest_m == pytest.approx(away_m.min(), abs=NEAR_M)


@given(regions)
def test_the_excess_over_a_circle_is_that_of_the_farthest_point(of: Region) -> None:
    area = circle(0.5, -0.2, 1.3)
    farthest_m = np.abs(rim(of) - complex(0.5, -0.2)).max()
    assert area.excess(of).over_m == pytest.approx(farthest_m + of.body_m - 1.3, abs=NEAR_M)


@given(regions, st.sampled_from([SQUARE, L_SHAPE, L_SHAPE[::-1]]))
def test_a_region_is_inside_a_polygon_where_all_its_points_are(
    of: Region, corners: list[list[float]]
) -> None:
    over_m = polygon(corners).excess(of).over_m
    left_m = depth_m(corners, np.append(rim(of), of.centre)).min() - of.body_m
    if left_m > NEAR_M:
        assert over_m == pytest.approx(-left_m, abs=NEAR_M)
    elif left_m < -NEAR_M:
        assert over_m > 0.0


@given(regions, st.sampled_from([SQUARE, L_SHAPE]))
def test_more_corners_on_the_same_border_change_no_sign(of: Region, corners: list[list[float]]) -> None:
    finer = [
        point for a, b in zip(corners, [*corners[1:], corners[0]], strict=True) for point in _three(a, b)
    ]
    one, other = polygon(corners).excess(of).over_m, polygon(finer).excess(of).over_m
    assert abs(one) < 1e-6 or (one > 0.0) is (other > 0.0)


def _three(a: list[float], b: list[float]) -> list[list[float]]:
    return [[a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1])] for share in (0.0, 0.3, 0.8)]


@pytest.mark.parametrize(
    ("of", "expected"),
    [
        (region(0.5 + 0j, 0.2, 0.1), Excess(-0.3, 1.0)),
        (region(0.9 + 0j, 0.2, 0.1), Excess(0.1, 1.0)),
        (region(0.9 + 0j, 0.2, 0.1, body_m=0.05), Excess(0.15, 1.0)),
        (region(0.5 + 0j, 0.2, 0.1, math.pi / 2.0), Excess(-0.4, 1.0)),
        (region(1.0 + 0j), Excess(0.0, 1.0)),  # on the border
        (region(1.5 + 0j, 0.2, 0.1), Excess(0.7, 1.0)),
        (region(-1.5 + 0j, 0.2, 0.1), Excess(0.7, -1.0)),
        (region(0.2 - 3.0j, 0.2, 0.1), Excess(2.1, -1j)),
    ],
)
def test_the_excess_over_an_edge_and_where_it_grows(of: Region, expected: Excess) -> None:
    for corners in (SQUARE, SQUARE[::-1]):
        found = polygon(corners).excess(of)
        assert found.over_m == pytest.approx(expected.over_m)
        assert found.outward == pytest.approx(expected.outward)


@given(regions, st.sampled_from([circle(1.0, 1.0, 1.5), polygon(SQUARE), polygon(L_SHAPE)]))
def test_no_step_against_the_outward_direction_makes_the_excess_grow(
    of: Region, area: CircleArea | PolygonArea
) -> None:
    excess = area.excess(of)
    after = area.excess(of._replace(centre=of.centre - 1e-6 * excess.outward))
    if abs(after.outward - excess.outward) < 1e-3:
        assert after.over_m <= excess.over_m + 1e-9


@pytest.mark.parametrize("area", [circle(), polygon(SQUARE)])
@pytest.mark.parametrize(
    "change",
    [
        {"xx": math.inf},
        {"yy": math.nan},
        {"xy": math.nan},
        {"centre": complex(math.nan, 0.0)},
        {"centre": complex(0.0, math.inf)},
        {"xx": 1e300, "yy": 1e300},
        {"centre": complex(1e200, 0.0)},
    ],
)
def test_a_position_that_is_not_known_is_outside(
    area: CircleArea | PolygonArea, change: dict[str, Any]
) -> None:
    assert area.excess(Region(0j, 0.0, 0.0, 0.0, 0.1)._replace(**change)) == Excess(math.inf, 0j)


def test_a_huge_region_is_a_number() -> None:
    for area in (circle(), polygon(SQUARE), polygon(L_SHAPE)):
        assert 1e5 < area.excess(Region(2e70 + 0j, 1e140, 0.0, 1e130, 0.1)).over_m < math.inf


def test_what_a_body_covers_on_a_line_is_known_exactly() -> None:
    way = Region.of_line(0.5 + 0.5j, 3.5 + 0.5j, 0.5)
    assert polygon(L_SHAPE).excess(way).over_m == pytest.approx(0.0, abs=1e-6)
    assert polygon(L_SHAPE).excess(Region.of_line(0.5 + 3.0j, 3.0 + 0.5j, 0.0)).over_m > 0.3  # past the notch
    assert circle(2.0, 0.5, 1.7).excess(way).over_m == pytest.approx(0.3)


@pytest.mark.parametrize(
    ("points", "words"),
    [
        (SQUARE[:2], "at least 3 items"),
        ([[0, 0], [1, 0], [math.nan, 1]], "finite"),
        ([[0, 0], [1, 0], [math.inf, 1]], "finite|less than or equal"),
        ([[0, 0], [1, 0], [2, 0]], "no area"),
        ([[0, 0], [1, 1], [1, 0], [0, 1]], "no area"),
        ([[0, 0], [2, 2], [2, 0], [0, 1]], "from 0, 0 m to 2, 2 m meets that from 2, 0 m to 0, 1 m"),
        ([[0, 0], [4, 0], [4, 4], [2, 0], [0, 4]], "meets"),  # a corner on another line
        ([[0, 0], [2, 0], [2, 2], [2, 1], [0, 1]], "meets"),  # back on its own line
        ([[1, 0], [2, 2], [0, 2], [1, 0.5], [1, 3]], "meets"),
        ([[0, 0], [1, 0], [1, 0], [0, 1]], "1, 0 m is there twice"),
        ([[0, 0], [1, 0], [1, 1], [0, 0]], "0, 0 m is there twice"),
        ([[0, 0]] * 101, "at most 100"),
        ([[0, 0], [1e9, 0], [0, 1]], "less than or equal to 500"),
    ],
)
def test_a_polygon_that_is_none_is_refused(points: list[list[float]], words: str) -> None:
    with pytest.raises(ValidationError, match=words):
        polygon(points)


def test_many_corners_of_a_border_are_a_polygon() -> None:
    star = [cmath.rect(1.0 + 0.5 * (k % 2), math.tau * k / 100) for k in range(100)]
    assert polygon([[z.real, z.imag] for z in star]).excess(region(0j, 0.9)).over_m < 0.0


def test_the_outline_is_closed() -> None:
    for area in (circle(1.0, 2.0, 3.0), polygon(SQUARE)):
        outline = area.outline()
        assert outline[0] == pytest.approx(outline[-1])
    assert all(
        math.dist(point, (1.0, 2.0)) == pytest.approx(3.0) for point in circle(1.0, 2.0, 3.0).outline()
    )


def test_the_kind_of_area_is_named() -> None:
    make: Callable[[object], object] = AREA.validate_python
    assert make({"type": "circle", "centre_m": [0, 0], "radius_m": 2}) == circle(radius_m=2.0)
    for wrong in ({"type": "circle", "centre_m": [0, 0], "radius_m": 0}, {"type": "box"}, {}):
        with pytest.raises(ValidationError):
            make(wrong)
