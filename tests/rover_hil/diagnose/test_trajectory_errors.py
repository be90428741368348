"""ATE and RPE against closed forms, and against the numbers of evo 1.38.1."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rover_hil.diagnose.intervals import mean_of, short
from rover_hil.diagnose.trajectory_errors import (
    Places,
    Trajectory,
    absolute_errors,
    pairs_by,
    pairs_by_distance,
    pairs_by_rotation,
    relative_errors,
)
from rover_hil.drives.arrays import Array, rms


def complex_of(values: np.ndarray) -> Places:
    return np.asarray(values, np.complex128)


def paths() -> tuple[Trajectory, Trajectory]:
    """Return a path that is 3 % too long and 2 % too much turned, and the true one."""
    t_s = np.arange(1500) * 0.05
    speed, rate = 0.3 + 0.1 * np.sin(t_s), 0.5 * np.sin(0.2 * t_s) + 0.1
    yaw = np.cumsum(rate) * 0.05
    own_yaw = 1.02 * yaw
    true = Trajectory(complex_of(np.cumsum(speed * np.exp(1j * yaw)) * 0.05), yaw)
    own = np.cumsum(1.03 * speed * np.exp(1j * own_yaw)) * 0.05
    return Trajectory(complex_of(own * np.exp(0.3j) + 2.0 + 1.0j), own_yaw + 0.3), true


def straight(length_m: float, count: int = 101) -> Trajectory:
    return Trajectory(complex_of(np.linspace(0.0, length_m, count)), np.zeros(count))


def size(values: Array | np.ndarray) -> float:
    return rms(np.abs(values))


def test_errors_are_those_of_evo() -> None:
    """Numbers of `evo` 1.38.1 for the same poses: APE with --align, RPE with --delta 1 m and 3 rad."""
    own, true = paths()
    assert rms(absolute_errors(own.place_m, true.place_m)) == pytest.approx(EVO["ate"], rel=1e-9)
    legs = relative_errors(own, true, pairs_by_distance(own, 1.0))
    assert size(legs.place_m) == pytest.approx(EVO["rpe"], rel=1e-9)
    lengths = relative_errors(Trajectory(own.place_m, None), true, pairs_by_distance(own, 1.0))
    assert size(lengths.place_m) == pytest.approx(EVO["lengths"], rel=1e-9)
    turns = relative_errors(own, true, pairs_by_rotation(own, 3.0))
    assert turns.yaw_rad is not None
    assert size(turns.yaw_rad) == pytest.approx(EVO["turns"], rel=1e-9)


EVO = {
    "ate": 0.10170464470664572,
    "rpe": 0.02773174370995352,
    "lengths": 0.025410577024473645,
    "turns": 0.04689663657652001,
}


def test_a_factor_of_the_distance_in_closed_form() -> None:
    """The rms distance of even points on a line of length L from their centre is about L / sqrt(12)."""
    count = 1001
    own, true = straight(10.3, count), straight(10.0, count)
    expected = 0.3 * math.sqrt((count + 1.0) / (count - 1.0) / 12.0)
    assert rms(absolute_errors(own.place_m, true.place_m)) == pytest.approx(expected, rel=1e-9)
    legs = relative_errors(own, true, (np.array([0, 500]), np.array([500, 1000])))
    assert legs.place_m == pytest.approx(np.array([0.15, 0.15]))
    assert legs.yaw_rad == pytest.approx(np.zeros(2))


def test_a_factor_of_the_rotation_in_closed_form() -> None:
    yaw = np.linspace(0.0, 4.0 * math.pi, 401)
    place_m = np.zeros(401, np.complex128)
    own, true = Trajectory(place_m, 1.05 * yaw), Trajectory(place_m, yaw)
    turns = relative_errors(own, true, pairs_by_rotation(true, 2.0 * math.pi - 1e-9))
    assert turns.yaw_rad == pytest.approx(np.full(2, 0.05 * 2.0 * math.pi))


@given(st.floats(-10.0, 10.0), st.floats(-10.0, 10.0), st.floats(-3.0, 3.0))
def test_moved_and_turned_paths_have_no_error(x_m: float, y_m: float, turn_rad: float) -> None:
    _, true = paths()
    assert true.yaw_rad is not None
    place_m = true.place_m * np.exp(1j * turn_rad) + complex(x_m, y_m)
    own = Trajectory(complex_of(place_m), true.yaw_rad + turn_rad)
    assert absolute_errors(place_m, true.place_m).max() < 1e-9
    legs = relative_errors(own, true, pairs_by_distance(own, 1.0))
    assert np.abs(legs.place_m).max() < 1e-9


def test_a_mirrored_path_is_not_aligned_by_a_reflection() -> None:
    _, true = paths()
    assert rms(absolute_errors(true.place_m.conjugate(), true.place_m)) > 0.5


@given(st.lists(st.floats(0.0, 3.0), max_size=50))
def test_pairs_follow_each_other_and_reach_the_size(steps: list[float]) -> None:
    first, end = pairs_by(np.array(steps), 1.0)
    assert len(first) == len(end)
    assert np.array_equal(first[1:], end[:-1])
    for begin, last in zip(first, end, strict=True):
        assert math.fsum(steps[begin:last]) >= 1.0 - 1e-9
        assert math.fsum(steps[begin : last - 1]) < 1.0 + 1e-9


def test_intervals_contain_the_mean_at_their_rate() -> None:
    rng = np.random.default_rng(1)
    inside = 0
    for _ in range(400):
        found = mean_of([[value] for value in rng.normal(2.0, 1.0, 6)])
        inside += found.low <= 2.0 <= found.high
    assert 0.92 <= inside / 400 <= 0.98


def test_what_is_not_known_has_no_interval() -> None:
    assert mean_of([]).words("m") == "not known"
    assert "no interval" in mean_of([[1.0]]).words("m")
    assert mean_of([[1.0, 1.2, 0.1]], 0.0).low >= 0.0
    assert [short(value) for value in (math.nan, 1e-5, 0.123, 12.34, -340.0)] == [
        "-",
        "1e-05",
        "0.12",
        "12",
        "-340",
    ]
