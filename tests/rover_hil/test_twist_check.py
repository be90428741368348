"""Pose against twist of the same messages."""

from collections.abc import Callable

import numpy as np
import pytest

from rover_hil.drives.arrays import Array
from rover_hil.drives.quality.twist_check import twist_fault


def drive(wheel_noise_m_s: float = 0.0) -> tuple[Array, Array, Array]:
    """Return times, poses and twists of a drive on a figure of eight with a travel to the left."""
    t_s = np.linspace(0.0, 40.0, 801)
    rate = 0.4 * np.sin(0.3 * t_s)
    forward, left = 0.3 + 0.1 * np.cos(0.2 * t_s), 0.05 * np.sin(0.5 * t_s)
    fine = np.linspace(0.0, 40.0, 80001)
    yaw = 0.4 / 0.3 * (1.0 - np.cos(0.3 * fine))
    velocity = (0.3 + 0.1 * np.cos(0.2 * fine) + 0.05j * np.sin(0.5 * fine)) * np.exp(1j * yaw)
    place = np.concatenate(([0j], np.cumsum(0.5 * (velocity[1:] + velocity[:-1]) * np.diff(fine))))[::100]
    noise = wheel_noise_m_s * np.random.default_rng(1).standard_normal((801, 3))
    pose = np.column_stack((place.real, place.imag, yaw[::100]))
    return t_s, pose, np.column_stack((forward, left, rate)) + noise


def test_a_twist_that_is_the_motion_of_the_pose_is_no_fault() -> None:
    t_s, pose, twist = drive(0.01)
    assert twist_fault(t_s, pose, twist) == ""
    assert twist_fault(t_s, pose, 1.1 * twist) == ""
    assert twist_fault(t_s, pose, np.zeros((801, 3))) == ""
    assert twist_fault(t_s[:5], pose[:5], -twist[:5]) == ""


@pytest.mark.parametrize(
    ("words", "change"),
    [
        ("travel: the twist has the opposite sign", lambda twist, yaw: twist * (-1.0, -1.0, 1.0)),
        ("rotation: the twist has the opposite sign", lambda twist, yaw: twist * (1.0, 1.0, -1.0)),
        ("rotation: the twist is in deg/s", lambda twist, yaw: twist * (1.0, 1.0, 57.29578)),
        ("in the travel; the pose is used", lambda twist, yaw: twist * (2.0, 2.0, 1.0)),
        (
            "travel: the twist is in the axes of the map",
            lambda twist, yaw: np.column_stack(
                (
                    twist[:, 0] * np.cos(yaw) - twist[:, 1] * np.sin(yaw),
                    twist[:, 0] * np.sin(yaw) + twist[:, 1] * np.cos(yaw),
                    twist[:, 2],
                )
            ),
        ),
    ],
)
def test_another_twist_is_named(words: str, change: Callable[[Array, Array], Array]) -> None:
    t_s, pose, twist = drive()
    assert words in twist_fault(t_s, pose, change(twist, pose[:, 2]))
