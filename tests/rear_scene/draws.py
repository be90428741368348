"""Draws of rigs, sensor errors and slow disturbances for the named sets."""

import math
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from sim_backends.rear_scene.rig import Wheel, looking_back
from tests.rear_scene.rig_file import CalibratedRig
from tests.rear_scene.truth import SensorErrors

Floats: TypeAlias = NDArray[np.float64]

SPEED_M_S = 0.08
"""Travel speed in the field tests of Reina, Ishigami, Nagatani and Yoshida."""
VIEW_WIDTH_M = 0.8
"""Ground seen across the middle of the picture; the rear camera of El-Dorado saw 0.6 m x 0.8 m."""


def wander(steps: int, correlation_steps: float, rng: np.random.Generator) -> Floats:
    """Return smooth noise of unit variance that changes over about `correlation_steps`."""
    margin = math.ceil(4 * correlation_steps)
    smooth = gaussian_filter1d(rng.standard_normal(steps + 2 * margin), correlation_steps)
    return np.asarray(smooth[margin : margin + steps] * math.sqrt(2 * math.sqrt(math.pi) * correlation_steps))


def draw_rig(held_out: bool, fps: float, rng: np.random.Generator) -> CalibratedRig:
    """Return a camera above the rear left wheel; held-out rigs differ in wheels, track and lens too."""
    half_track, b_m, width, lugs = 0.22, 0.30, 0.11, 18
    focal, k1 = rng.uniform(480, 560), rng.uniform(-0.16, -0.04)
    if held_out:
        half_track, b_m, width = rng.uniform(0.20, 0.26), rng.uniform(0.26, 0.34), rng.uniform(0.09, 0.12)
        lugs = int(rng.integers(14, 25))
        focal, k1 = rng.uniform(430, 620), rng.uniform(-0.16, 0.06)
    # The upper edge of the picture looks down by 28 to 36 degrees, so that the view ends within about 1 m.
    tilt_deg = math.degrees(math.atan(240 / focal)) + rng.uniform(28, 36)
    height = VIEW_WIDTH_M * focal / 640 * math.sin(math.radians(tilt_deg)) * rng.uniform(0.9, 1.05)
    centre = np.array([319.5, 239.5]) + rng.normal(0, 6, 2)

    def wheel(name: str, x_m: float, y_m: float) -> Wheel:
        return Wheel(name=name, x_m=x_m, y_m=y_m, width_m=width, lug_count=lugs)

    return CalibratedRig(
        width=640,
        height=480,
        fps=fps,
        camera_matrix=np.array(
            [[focal, 0, centre[0]], [0, focal * rng.uniform(0.995, 1.005), centre[1]], [0, 0, 1]]
        ),
        distortion=np.array([k1, -0.3 * k1 * abs(k1), *rng.normal(0, 5e-4, 2), rng.uniform(-0.01, 0.01)]),
        vehicle_from_camera=looking_back(tilt_deg, rng.normal(0, 2), rng.normal(0, 1.5)),
        camera_m=np.array([-b_m + rng.uniform(-0.05, 0.03), half_track + rng.uniform(-0.06, 0.06), height]),
        wheel=wheel("rear_left", -b_m, half_track),
        other_wheels=(
            wheel("front_left", b_m, half_track),
            wheel("front_right", b_m, -half_track),
            wheel("rear_right", -b_m, -half_track),
        ),
        b_m=b_m,
        nominal_speed_m_s=SPEED_M_S,
    )


def draw_errors(rng: np.random.Generator) -> SensorErrors:
    """Return errors of a cheap gyro, a fluxgate compass and wheel encoders."""
    bias = rng.normal(0, 0.15, 3)
    return SensorErrors(
        gyro_bias_dps=(float(bias[0]), float(bias[1]), float(bias[2])),
        gyro_noise_dps=0.12,
        compass_bias_deg=float(rng.normal(0, 1.5)),
        compass_swing_deg=float(rng.uniform(0.5, 2.0)),
        compass_phase_rad=float(rng.uniform(0, 2 * np.pi)),
        wheel_speed_scale=float(rng.normal(0, 0.01)),
    )
