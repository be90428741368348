"""The axes of positions without yaw are turned onto the path of the rover, once both have one shape."""

import cmath
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from controllers.estimation.positions.alignment import PathAlignment


def aligned(path: np.ndarray, places: np.ndarray, std_m: float) -> PathAlignment:
    alignment = PathAlignment()
    for place, then in zip(places.tolist(), path.tolist(), strict=True):
        alignment.take(place, then, std_m)
    return alignment


def curve(length_m: float, count: int) -> np.ndarray:
    yaw = np.linspace(0.0, 2.0, count)
    return np.cumsum(np.exp(1j * yaw)) * length_m / count


@given(
    turned_rad=st.floats(-3.1, 3.1),
    origin=st.complex_numbers(max_magnitude=5e6),
    slip=st.floats(0.0, 0.3),
)
def test_angle_and_origin_are_those_of_the_positions(turned_rad: float, origin: complex, slip: float) -> None:
    path = curve(30.0, 80)
    alignment = aligned(path, origin + (1.0 - slip) * path * cmath.rect(1.0, turned_rad), 0.5)
    assert alignment.is_known
    assert alignment.turned_rad == pytest.approx(turned_rad, abs=1e-3)
    middle = complex(path.mean())
    expected = origin + (1.0 - slip) * middle * cmath.rect(1.0, turned_rad)
    assert abs(alignment.origin_m + middle * cmath.rect(1.0, turned_rad) - expected) < 1e-2


def test_the_error_of_the_angle_is_that_of_its_spread() -> None:
    """80 positions of 0.5 m on 31 m of path, which no pair of them is far enough apart to turn."""
    rng, path = np.random.default_rng(4), curve(31.0, 80)
    spread_sd = float(np.sqrt(np.sum(np.abs(path - path.mean()) ** 2))) / 0.5
    errors = []
    for _ in range(200):
        noise = rng.normal(0.0, 0.5, (2, len(path)))
        alignment = aligned(path, path + noise[0] + 1j * noise[1], 0.5)
        assert alignment.is_known
        errors.append(alignment.turned_rad)
    assert math.sqrt(np.mean(np.square(errors))) == pytest.approx(1.0 / spread_sd, rel=0.2)


@pytest.mark.parametrize("count", [1, 2, 80])
def test_noise_alone_gives_no_angle(count: int) -> None:
    rng = np.random.default_rng(5)
    noise = rng.normal(0.0, 0.5, (2, count))
    assert not aligned(curve(0.5, count), noise[0] + 1j * noise[1], 0.5).is_known


def test_positions_of_another_drive_give_no_angle() -> None:
    path = curve(30.0, 80)
    assert not aligned(path, path.conjugate() ** 2 / 10.0, 0.05).is_known
    assert not aligned(path, 2.0 * path, 0.05).is_known
