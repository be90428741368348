"""How much an error of the rig changes the measured travel."""

from dataclasses import replace

import cv2
import numpy as np

from controllers.ground_motion.flow import GroundFlow
from controllers.ground_motion.ground_patch import Floats, GroundPatch, project
from controllers.ground_motion.mounting_watch import MountingEffects
from controllers.ground_motion.rig import RigGeometry
from controllers.ground_motion.rig_tolerance import RigTolerance

STEP_M = 0.01
"""Travel that is compared; the factor hardly depends on it."""
PITCH_STEP_RAD, FOCAL_STEP = 0.01, 0.01
"""Errors of the rig that are tried; the effects are hardly more than linear."""
BEND_STEP_PER_M = 0.01
"""Curvature of ground that is tried."""
TILT_SD_RAD = (0.002, 0.002, 0.01)
"""Deviations of the angles turned in the fit, as with a gyro; the factor hardly depends on them."""


def scale_of(ground: GroundPatch, flow: GroundFlow, tolerance: RigTolerance) -> tuple[float, float]:
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
    focal = np.diag([1 + tolerance.focal_length_sd, 1 + tolerance.focal_length_sd, 1.0])
    wrong = [
        replace(rig, rotation=pitched(np.radians(tolerance.pitch_sd_deg)) @ rig.rotation),
        replace(rig, camera_matrix=rig.camera_matrix @ focal),
    ]
    effects = [travel_factor(true, ground, flow) - 1 for true in wrong]
    effects += [tolerance.height_sd_m / height_m, tolerance.sinkage_sd_m / height_m]
    return factor, factor * float(np.linalg.norm(effects))


def effects_of(ground: GroundPatch, flow: GroundFlow, tolerance: RigTolerance) -> MountingEffects:
    """Return what errors of the rig do to the motion of near and far ground."""
    rig = ground.rig
    focal = np.diag([1 + FOCAL_STEP, 1 + FOCAL_STEP, 1.0])
    right, by_pitch, by_focal = (
        _fitted_ahead(true, ground, flow)
        for true in (
            rig,
            replace(rig, rotation=pitched(PITCH_STEP_RAD) @ rig.rotation),
            replace(rig, camera_matrix=rig.camera_matrix @ focal),
        )
    )
    bent = _fitted_ahead(rig, ground, flow, BEND_STEP_PER_M) - right
    per_rad, per_focal = (by_pitch - right) / PITCH_STEP_RAD, (by_focal - right) / FOCAL_STEP
    effects = per_rad[4] * np.radians(tolerance.pitch_sd_deg), per_focal[4] * tolerance.focal_length_sd
    return MountingEffects(
        pitch_per_rad=float(per_rad[4]),
        pitch_per_focal=float(per_focal[4]),
        pitch_per_bend=float(bent[4]) / BEND_STEP_PER_M,
        tolerance=float(np.hypot(*effects)),
    )


def travel_factor(true: RigGeometry, ground: GroundPatch, flow: GroundFlow) -> float:
    """Return measured over true travel forward, where the camera is mounted otherwise than the rig says."""
    return float(_fitted_ahead(true, ground, flow)[0])


def _fitted_ahead(
    true: RigGeometry, ground: GroundPatch, flow: GroundFlow, bend_per_m: float = 0.0
) -> Floats:
    """Return the motion that is measured per metre ahead: forward, left, turn, roll, pitch.

    On ground that curves the vehicle lies on its tangent plane, and its rotation is not counted.
    """
    points = ground.to_vehicle(*flow.points_m().T)
    points[:, 2] -= 0.5 * bend_per_m * points[:, 0] ** 2
    before, after = (
        seen_at(true, ground, points + np.array([shift_m, 0.0, 0.0])) for shift_m in (STEP_M, 0.0)
    )
    return np.asarray(flow.fitted((after - before) * (-1.0, 1.0), TILT_SD_RAD) / STEP_M, np.float64)


def pitched(angle_rad: float) -> Floats:
    """Return the turn about the vehicle's left axis that lowers what is ahead."""
    cosine, sine = np.cos(angle_rad), np.sin(angle_rad)
    return np.array([[cosine, 0.0, sine], [0.0, 1.0, 0.0], [-sine, 0.0, cosine]])


def seen_at(true: RigGeometry, ground: GroundPatch, points: Floats) -> Floats:
    """Return where points of the ground (vehicle frame) seem to be, behind and left of the patch's origin."""
    told = ground.rig
    pixels, _ = project(true, points)
    plain = cv2.undistortPoints(pixels[:, None], told.camera_matrix, told.distortion).reshape(-1, 2)
    rays = np.c_[plain, np.ones(len(plain))] @ told.rotation.T
    return ground.to_patch(told.position_m - rays * (told.position_m[2] / rays[:, 2:]))
