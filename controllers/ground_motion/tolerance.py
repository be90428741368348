"""How much an error of the rig changes the measured travel."""

from dataclasses import replace

import cv2
import numpy as np

from controllers.ground_motion.ground_patch import Floats, GroundPatch, project
from controllers.ground_motion.rig import RigGeometry
from controllers.ground_motion.rig_tolerance import RigTolerance

STEP_M = 0.01
"""Travel that is compared; the factor hardly depends on it."""
STRIDE = 16
"""Every so many pixels of the rectified ground are compared."""


def scale_of(ground: GroundPatch, tolerance: RigTolerance) -> tuple[float, float]:
    """Return the factor from measured to true travel by scale and usual sinkage, and its standard deviation.

    Where the scale is calibrated, only its deviation and that of the sinkage are left. Otherwise the
    deviation is the root of the sum of squares of the effects of each one. 1 % of height is 1 % of travel;
    pitch and focal length act by the view.
    """
    rig = ground.rig
    height_m = float(rig.position_m[2])
    factor = tolerance.scale * (1 - tolerance.sinkage_m / height_m)
    if tolerance.scale_sd is not None:
        return factor, factor * float(np.hypot(tolerance.scale_sd, tolerance.sinkage_sd_m / height_m))
    pitch = np.radians(tolerance.pitch_sd_deg)
    cosine, sine = np.cos(pitch), np.sin(pitch)
    pitched = np.array([[cosine, 0.0, sine], [0.0, 1.0, 0.0], [-sine, 0.0, cosine]])
    focal = np.diag([1 + tolerance.focal_length_sd, 1 + tolerance.focal_length_sd, 1.0])
    # A change of the focal length leaves the principal point where it is.
    matrix = rig.camera_matrix @ focal
    effects = [
        tolerance.height_sd_m / height_m,
        tolerance.sinkage_sd_m / height_m,
        travel_factor(replace(rig, rotation=pitched @ rig.rotation), ground) - 1,
        travel_factor(replace(rig, camera_matrix=matrix), ground) - 1,
    ]
    return factor, factor * float(np.linalg.norm(effects))


def travel_factor(true: RigGeometry, ground: GroundPatch) -> float:
    """Return measured over true travel forward, where the camera is mounted otherwise than the rig says."""
    rows, columns = np.nonzero(ground.visible[::STRIDE, ::STRIDE])
    back = np.asarray((rows * STRIDE + 0.5) * ground.pixel_m, np.float64)
    left = np.asarray((columns * STRIDE - ground.centre) * ground.pixel_m, np.float64)
    points = ground.to_vehicle(back, left)
    before, after = (
        _seen_at(true, ground.rig, points + np.array([shift_m, 0.0, 0.0])) for shift_m in (STEP_M, 0.0)
    )
    return float(np.median((before - after)[:, 0]) / STEP_M)


def _seen_at(true: RigGeometry, told: RigGeometry, points: Floats) -> Floats:
    """Return where points of the ground (vehicle frame) seem to be, by the rig that is told."""
    pixels, _ = project(true, points)
    plain = cv2.undistortPoints(pixels[:, None], told.camera_matrix, told.distortion).reshape(-1, 2)
    rays = np.c_[plain, np.ones(len(plain))] @ told.rotation.T
    return np.asarray((told.position_m - rays * (told.position_m[2] / rays[:, 2:]))[:, :2], np.float64)
