"""Rigs and drives with a known answer, for tests of the rear scene."""

import math

import numpy as np
from numpy.typing import NDArray

from sim_backends.rear_scene.ground_map import GroundSettings, Rut, Sun
from sim_backends.rear_scene.rig import Wheel, looking_back
from sim_backends.rear_scene.scene import Lens, Pose, RearScene
from tests.rear_scene.motion import RATE_HZ, Motion, Plan
from tests.rear_scene.rig_file import CalibratedRig

SPEED_M_S = 0.08
B_M, HALF_TRACK_M = 0.30, 0.22
PLAIN_GROUND = GroundSettings(kind="fine_sand", patchiness=0.0)
HIGH_SUN = Sun(azimuth_deg=0.0, elevation_deg=89.0)
NO_NOISE = Lens(exposure_s=0.0, noise_grey=0.0, vignette=0.0)
PAINT = Rut(depth_m=0.002, berm_m=0.0, lug_m=0.0, tone=0.05, compaction=1.0, smear_m=0.0)
"""Not a rut but a black stripe as wide as the wheel."""


def rig(
    distortion: tuple[float, ...] = (-0.2, 0.03, 5e-4, -4e-4, 0.004), bank_deg: float = 1.5
) -> CalibratedRig:
    def wheel(name: str, x_m: float, y_m: float) -> Wheel:
        return Wheel(name=name, x_m=x_m, y_m=y_m)

    return CalibratedRig(
        width=640,
        height=480,
        fps=5.0,
        camera_matrix=np.array([[520.0, 0, 323.0], [0, 518.0, 236.0], [0, 0, 1]]),
        distortion=np.array(distortion),
        vehicle_from_camera=looking_back(56.0, 2.0, bank_deg),
        camera_m=np.array([-B_M - 0.08, HALF_TRACK_M + 0.02, 0.54]),
        wheel=wheel("rear_left", -B_M, HALF_TRACK_M),
        other_wheels=(
            wheel("front_left", B_M, HALF_TRACK_M),
            wheel("front_right", B_M, -HALF_TRACK_M),
            wheel("rear_right", -B_M, -HALF_TRACK_M),
        ),
        b_m=B_M,
    )


def plan(
    duration_s: float,
    drift_deg: float = 0.0,
    yaw_rate_dps: float = 0.0,
    slip: float = 0.0,
    rock_deg: tuple[float, float] = (0.0, 0.0),
    start_yaw_rad: float = 0.4,
) -> Plan:
    steps = round(duration_s * RATE_HZ)
    return Plan(
        rim_speed_m_s=np.full(steps, SPEED_M_S),
        slip=np.full(steps, slip),
        slip_angle_rad=np.full(steps, math.radians(drift_deg)),
        yaw_rate_rad_s=np.full(steps, math.radians(yaw_rate_dps)),
        rock_rad=np.radians(np.tile(rock_deg, (steps, 1))),
        start_yaw_rad=start_yaw_rad,
    )


def pose_at(
    x_m: float = 0.0,
    y_m: float = 0.0,
    yaw_rad: float = 0.0,
    depth_m: float = 0.0,
    wheel_angle_rad: float = 0.0,
) -> Pose:
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    return Pose(
        position_m=np.array([x_m, y_m, -depth_m]),
        vehicle_to_world=np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]]),
        yaw_rad=yaw_rad,
        wheel_angle_rad=wheel_angle_rad,
    )


def drive_scene(scene: RearScene, motion: Motion, last: int, stride: int = 5) -> None:
    for step in [*range(0, last, stride), last]:
        scene.drive(motion.pose(step))


def grey(image: NDArray[np.uint8]) -> NDArray[np.float64]:
    return np.asarray(image.mean(axis=2, dtype=np.float64))
