"""How the error of the odometry grows: planted noise is found."""

import math

import numpy as np
import pytest

from rover_hil.diagnose.drive_errors import ESTIMATE, ODOMETRY, Compared
from rover_hil.diagnose.error_growth import error_growth
from rover_hil.diagnose.trajectory_errors import Trajectory
from rover_hil.drives.arrays import Array

TRUE_M, TRUE_RAD = 0.0005, 0.003
STEPS = 1500
PER_RAD, PER_M, PLACE = 0.01, 0.02, 0.003


def path_of(moves_m: Array, turns_rad: Array, place_noise: Array) -> Trajectory:
    yaw_rad = np.concatenate(([0.0], np.cumsum(turns_rad)))
    middle_rad = 0.5 * (yaw_rad[1:] + yaw_rad[:-1])
    steps_m = (moves_m + place_noise) * np.exp(1j * middle_rad)
    return Trajectory(np.concatenate(([0j], np.cumsum(steps_m))), yaw_rad)


def driven(rate: float, speed: float, rng: np.random.Generator, noise: float = 1.0) -> Compared:
    """Return a drive whose true motion differs from that of the wheels by random walks."""
    moves_m, turns_rad = np.full(STEPS, 0.05 * speed), np.full(STEPS, 0.05 * rate)
    yaw_sd = np.sqrt(PER_RAD**2 * np.abs(turns_rad) + PER_M**2 * moves_m)
    errors = noise * rng.standard_normal((4, STEPS))
    place = PLACE * np.sqrt(moves_m) * (errors[1] + 1j * errors[2])
    wheels = path_of(moves_m, turns_rad, np.zeros(STEPS))
    true = path_of(moves_m, turns_rad + yaw_sd * errors[0], place)
    seen = rng.standard_normal((3, STEPS + 1))
    assert true.yaw_rad is not None
    known = Trajectory(true.place_m + TRUE_M * (seen[0] + 1j * seen[1]), true.yaw_rad + TRUE_RAD * seen[2])
    t_s = np.linspace(0.0, 0.05 * STEPS, STEPS + 1)
    return Compared(t_s=t_s, true=known, tracks={ODOMETRY: wheels, ESTIMATE: wheels})


def test_planted_noise_is_found() -> None:
    rng = np.random.default_rng(1)
    drives = [
        driven(rate, speed, rng) for _ in range(6) for rate, speed in ((0.4, 0.0), (0.0, 0.2), (0.3, 0.2))
    ]
    found = error_growth(drives, 0.0)
    assert found is not None
    assert found.yaw_rad_sqrt_rad == pytest.approx(PER_RAD, rel=0.4)
    assert found.yaw_rad_sqrt_m == pytest.approx(PER_M, rel=0.25)
    assert found.place_m_sqrt_m == pytest.approx(PLACE, rel=0.3)
    assert found.place_m_sqrt_rad < 0.0005
    assert found.slip < 0.01


def test_what_the_ground_truth_cannot_show_is_not_known() -> None:
    rng = np.random.default_rng(2)
    drives = [driven(rate, speed, rng, noise=0.0) for rate, speed in 2 * ((0.4, 0.0), (0.0, 0.2), (0.3, 0.2))]
    found = error_growth(drives, 0.0)
    assert found is not None
    assert found.yaw_rad_sqrt_rad >= found.true_rad / math.sqrt(0.05 * 0.4 * STEPS) * 0.999
    assert found.place_m_sqrt_rad >= found.true_m / math.sqrt(0.05 * 0.4 * STEPS) * 0.999
    assert found.place_m_sqrt_m >= found.true_m / math.sqrt(0.05 * 0.2 * STEPS) * 0.999


@pytest.mark.parametrize(("count", "rate"), [(3, 0.3), (6, 0.0)])
def test_few_drives_and_straight_ones_show_no_growth(count: int, rate: float) -> None:
    rng = np.random.default_rng(3)
    assert error_growth([driven(rate, 0.2, rng) for _ in range(count)], 0.0) is None
