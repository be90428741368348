"""Poses and positions that were measured from outside while a recorded drive was driven."""

import math
from typing import Annotated

import numpy as np
from pydantic import Field

from controllers.motion.planar import wrap_angle
from drivers.clock import seconds
from drivers.nmea_gnss.codec import correlated_std_m
from drivers.samples import UNKNOWN_YAW_STD_RAD, PoseFixSample
from drivers.settings import Settings
from rover_hil.config.ros2_settings import POSE_FIX
from rover_hil.drives.arrays import Array, Flags
from rover_hil.drives.quality.oddities import Oddity


class MarkerPlace(Settings):
    """Where on the rover a pose is measured: the place of a marker or antenna.

    Attributes:
        x_m: Ahead of the origin of the rover.
        y_m: To the left of it.
        yaw_deg: Direction of the marker's x axis, counter-clockwise from ahead.
    """

    x_m: float = 0.0
    y_m: float = 0.0
    yaw_deg: float = 0.0


class FixNoise(Settings):
    """How certain fixes are, where the drive does not say so.

    Attributes:
        sigma_m: Standard deviation of x and of y.
        yaw_sigma_deg: Standard deviation of the yaw.
        correlation_s: Time over which errors of successive positions are alike; they count for less by it.
    """

    sigma_m: Annotated[float, Field(gt=0, le=100)] = 3.0
    yaw_sigma_deg: Annotated[float, Field(gt=0, le=180)] = 5.0
    correlation_s: Annotated[float, Field(ge=0, le=600)] = 3.0


class FixMaker:
    """Makes fixes of what a drive holds.

    Args:
        noise: Where the drive does not say how certain they are.
        marker: What is measured.
    """

    def __init__(self, noise: FixNoise, marker: MarkerPlace) -> None:
        self._noise = noise
        self._marker_m = marker.x_m, marker.y_m
        self._marker_yaw_rad = math.radians(marker.yaw_deg)
        self._newest_ns: int | None = None

    def make(
        self,
        t_ns: int,
        x_m: float,
        y_m: float,
        yaw_rad: float = math.nan,
        std_m: float = math.nan,
        yaw_std_rad: float = math.nan,
    ) -> PoseFixSample | None:
        """Return a fix; NaN is what the drive does not hold. None without a place."""
        if not (math.isfinite(x_m) and math.isfinite(y_m)):
            return None
        has_yaw = math.isfinite(yaw_rad)
        arm_x_m, arm_y_m = self._marker_m
        if has_yaw:
            yaw_rad = wrap_angle(yaw_rad - self._marker_yaw_rad)
            cosine, sine = math.cos(yaw_rad), math.sin(yaw_rad)
            x_m -= cosine * arm_x_m - sine * arm_y_m
            y_m -= sine * arm_x_m + cosine * arm_y_m
            arm_x_m = arm_y_m = 0.0
        std_m = std_m if math.isfinite(std_m) and std_m > 0.0 else self._noise.sigma_m
        elapsed_s = None if self._newest_ns is None else seconds(t_ns - self._newest_ns)
        self._newest_ns = t_ns
        if not has_yaw:
            yaw_std_rad = UNKNOWN_YAW_STD_RAD
        elif not (math.isfinite(yaw_std_rad) and yaw_std_rad > 0.0):
            yaw_std_rad = math.radians(self._noise.yaw_sigma_deg)
        return PoseFixSample(
            device=POSE_FIX,
            t_ns=t_ns,
            x_m=x_m,
            y_m=y_m,
            yaw_rad=yaw_rad if has_yaw else 0.0,
            position_std_m=correlated_std_m(std_m, elapsed_s, self._noise.correlation_s),
            yaw_std_rad=yaw_std_rad,
            t_capture_ns=t_ns,
            arm_x_m=arm_x_m,
            arm_y_m=arm_y_m,
        )


FAR = 10.0
"""A pose that is further from the one before than this many usual steps is no motion since it."""
LEAST_REPEATS = 3


def lost_poses(x_m: Array, y_m: Array, yaw_rad: Array) -> tuple[Flags, Flags]:
    """Return which poses a tracker has invented when it had lost the rover, n.

    Args:
        x_m: Of poses in the order of their times, NaN where there is none, n.
        y_m: The same.
        yaw_rad: The same.

    Returns:
        Poses that repeat one before, to the last bit, until the next one is far away; and unit poses, all
        zeros, far from their neighbours.
    """
    known = np.flatnonzero(np.isfinite(x_m) & np.isfinite(y_m) & np.isfinite(yaw_rad))
    repeats, units = np.zeros(len(x_m), bool), np.zeros(len(x_m), bool)
    poses = np.column_stack((x_m, y_m, yaw_rad))[known]
    if len(poses) < LEAST_REPEATS:
        return repeats, units
    steps_m = np.hypot(*np.diff(poses[:, :2], axis=0).T)
    far_m = FAR * float(np.quantile(steps_m[steps_m > 0.0], 0.9)) if (steps_m > 0.0).any() else math.inf
    is_zero = ~poses.any(axis=1)
    moving = poses[~is_zero]
    if is_zero.any() and len(moving):
        ranges_m = np.hypot(moving[:, 0], moving[:, 1])
        steps_m = np.hypot(*np.diff(moving[:, :2], axis=0).T) if len(moving) > 1 else np.zeros(1)
        moved = steps_m[steps_m > 0.0]
        far_m = FAR * float(np.quantile(moved, 0.9)) if len(moved) else far_m
        # The neighbours that are no unit poses.
        before = np.searchsorted(np.flatnonzero(~is_zero), np.flatnonzero(is_zero)) - 1
        near_m = np.minimum(
            np.where(before >= 0, ranges_m[np.maximum(before, 0)], math.inf),
            np.where(
                before + 1 < len(ranges_m), ranges_m[np.minimum(before + 1, len(ranges_m) - 1)], math.inf
            ),
        )
        units[known[is_zero]] = near_m > far_m
    without_unit = np.flatnonzero(~units[known])
    same = np.concatenate(([False], (np.diff(poses[without_unit], axis=0) == 0.0).all(axis=1)))
    starts = np.flatnonzero(~same)
    for start, end in zip(starts, [*starts[1:], len(without_unit)], strict=True):
        if end - start <= LEAST_REPEATS or end == len(without_unit):
            continue
        jump_m = math.dist(poses[without_unit[end - 1], :2], poses[without_unit[end], :2])
        if jump_m > far_m:
            repeats[known[without_unit[start + 1 : end]]] = True
    return repeats, units


def invented_poses(x_m: Array, y_m: Array, yaw_rad: Array, oddities: list[Oddity]) -> frozenset[int]:
    """Return the places of the poses that `lost_poses` finds, and note them."""
    repeats, units = lost_poses(x_m, y_m, yaw_rad)
    for what, lost in (
        ("true poses that repeat one before until the tracker finds the rover again", repeats),
        ("unit poses of a tracker that has lost the rover", units),
    ):
        if lost.any():
            oddities.append(Oddity(what=what, where="truth", count=int(lost.sum())))
    return frozenset(np.flatnonzero(repeats | units).tolist())
