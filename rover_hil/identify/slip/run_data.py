"""What slip is identified from: readings of a drive at common times, and means in windows."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from controllers.motion.kinematics import OmniKinematics
from controllers.motion.rover_geometry import OmniRoverSettings
from rover_hil.drives.arrays import Array, Flags
from rover_hil.drives.robotino_csv import ROBOTINO

WHEELS = 3


@dataclass(frozen=True, slots=True, kw_only=True)
class AlignedReadings:
    """Readings of a drive at the times of its first wheel, and poses; n readings, m frames, three wheels.

    Attributes:
        path: Where it was read from.
        surface: Name of the surface.
        t_s: Times of the readings, increasing, shape (n,).
        position_rad: Angles of the wheels, (n, 3).
        current_a: Currents, (n, 3); infinite where the sensor is at its end, NaN where it is silent.
        current_is_signed: False for magnitudes.
        set_speed_rad_s: Setpoints of the wheels, (n, 3), NaN where unknown.
        camera_t_s: Times of new camera frames, (m,).
        camera: Pose x, y, yaw, (m, 3), x and y in metres or pixels.
        camera_in_pixels: Which of the two.
        rover: Geometry of the wheels.
        truth: Where the poses of a log come from, in words; empty for a CSV file.
        fix_sd_m: Of noisy poses, the standard deviation of the place of a wheel on the ground, (m,).
    """

    path: Path
    surface: str
    t_s: Array
    position_rad: Array
    current_a: Array
    current_is_signed: bool
    set_speed_rad_s: Array
    camera_t_s: Array
    camera: Array
    camera_in_pixels: bool
    rover: OmniRoverSettings = ROBOTINO
    truth: str = ""
    fix_sd_m: Array | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class RunWindows:
    """A run in k windows of about half a second; everything is a mean over the window.

    Attributes:
        path: Where it was read from.
        surface: Name of the surface.
        elapsed_s: Length of each window, (k,).
        start_s: Its beginning, (k,).
        wheel_speed_rad_s: From the wheels' angles, (k, 3).
        current_a: Signed currents, (k, 3).
        paper_torque_nm: M, (k, 3).
        wheel_torque_nm: Torque at the wheel, (k, 3).
        usable: False where a wheel's effort is flagged for half of the window, (k, 3).
        work_known: False where the work of any wheel is not known for half of the window, (k,).
        encoder_velocity: vx, vy, yaw rate of rolling wheels in the body frame, (k, 3), m/s and rad/s.
        camera_velocity: The same by the camera, m/s or pixel/s.
        camera_in_pixels: Which of the two.
        rover: Geometry of the wheels.
        truth: Where the poses of a log come from, in words; empty for a CSV file.
        rejected: How many windows were left out, by reason.
    """

    path: Path
    surface: str
    elapsed_s: Array
    start_s: Array
    wheel_speed_rad_s: Array
    current_a: Array
    paper_torque_nm: Array
    wheel_torque_nm: Array
    usable: Flags
    work_known: Flags
    encoder_velocity: Array
    camera_velocity: Array
    camera_in_pixels: bool
    rover: OmniRoverSettings = ROBOTINO
    truth: str = ""
    rejected: Mapping[str, int] = field(default_factory=dict)

    def encoder_distance_m(self) -> Array:
        """Return the distance in each window by the encoders, (k,)."""
        return np.hypot(self.encoder_velocity[:, 0], self.encoder_velocity[:, 1]) * self.elapsed_s

    def camera_distance_m(self, m_per_px: float) -> Array:
        """Return the distance in each window by the camera, (k,)."""
        scale = m_per_px if self.camera_in_pixels else 1.0
        distance: Array = (
            np.hypot(self.camera_velocity[:, 0], self.camera_velocity[:, 1]) * self.elapsed_s * scale
        )
        return distance

    def camera_wheel_speed_rad_s(self, m_per_px: float) -> Array:
        """Return the effective wheel speeds w_eff = J v_cam / R, (k, 3)."""
        velocity = self.camera_velocity.copy()
        velocity[:, :2] *= m_per_px if self.camera_in_pixels else 1.0
        return velocity @ to_wheels(self.rover).T


def to_wheels(rover: OmniRoverSettings) -> Array:
    """Return the matrix J / R from body motion to wheel speeds."""
    kinematics = OmniKinematics(rover)
    columns = [kinematics.wheel_speeds(*axis) for axis in np.eye(3).tolist()]
    return np.array(columns).T
