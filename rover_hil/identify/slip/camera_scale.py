"""The overhead camera's scale and yaw, and whether an apparent slip on smooth ground is an error of scale."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from drivers.errors import LogError
from rover_hil.drives.arrays import Array
from rover_hil.identify.slip.parameters import SLIP_FIT
from rover_hil.identify.slip.run_data import RunWindows
from rover_hil.identify.slip.surface_fit import steady_drift_rad, travel_direction_rad

ROLLING_SURFACE = "table_surface"
"""Smooth and hard: the wheels roll on it, so it gives the camera its scale."""

NOMINAL_MM_PER_PX = 1.84
"""From the data set's own `config/camera_params.json`."""


@dataclass(frozen=True, slots=True)
class CameraScale:
    """The scale and where it comes from.

    Attributes:
        mm_per_px: None where no camera is in pixels.
        is_scale_error: Whether the rolling runs disagree with `NOMINAL_MM_PER_PX` by an error of scale; None
            where there are none.
        verdict: The finding in words.
        drift_rad: How far to the left of the encoders' course the camera sees rolling runs go, on average:
            its marker is turned to the right by as much on the rover. None without such runs.
    """

    mm_per_px: float | None
    is_scale_error: bool | None
    verdict: str
    drift_rad: float | None = None

    @property
    def m_per_px(self) -> float:
        """The scale in m; NaN where there is none to be used."""
        return float("nan") if self.mm_per_px is None else self.mm_per_px / 1000.0


def find_scale(runs: Sequence[RunWindows]) -> CameraScale:
    """Return the scale with which the runs on the smooth table roll without slip.

    Raises:
        LogError: The camera does not see the rover move on the table.
    """
    if not any(run.camera_in_pixels for run in runs):
        return CameraScale(None, None, "The true pose is given in metres: there is no camera scale to find.")
    rolling = [run for run in runs if run.camera_in_pixels and run.surface == ROLLING_SURFACE]
    if len(rolling) < SLIP_FIT.camera.least_runs:
        mm_per_px = SLIP_FIT.camera.calibrated_mm_per_px
        verdict = (
            f"Fewer than {SLIP_FIT.camera.least_runs} training runs on {ROLLING_SURFACE}: the scale of the "
            f"data set's own table runs is taken, {mm_per_px:g} mm/px, and a scale error cannot be "
            "distinguished from slip."
        )
        return CameraScale(mm_per_px, None, verdict)
    encoder_m = np.array([run.encoder_distance_m().sum() for run in rolling])
    camera_px = np.array([run.camera_distance_m(1.0).sum() for run in rolling])
    if not (camera_px > 0.0).all():
        raise LogError(
            f"{rolling[int(np.argmin(camera_px))].path}: the camera sees no motion; leave this run out"
        )
    mm_per_px = round(float(np.median(encoder_m / camera_px)) * 1000.0, 4)
    return _judge(rolling, 1.0 - camera_px * NOMINAL_MM_PER_PX / 1000.0 / encoder_m, mm_per_px)


def _judge(rolling: Sequence[RunWindows], slip: Array, mm_per_px: float) -> CameraScale:
    mean = float(slip.mean())
    direction = np.array([travel_direction_rad(run) for run in rolling])
    current_a = np.array([np.abs(run.current_a).mean() for run in rolling])
    speed = np.array([run.encoder_distance_m().sum() / run.elapsed_s.sum() for run in rolling])
    waves = np.column_stack(
        [
            np.ones(len(slip)),
            np.cos(direction),
            np.sin(direction),
            np.cos(2 * direction),
            np.sin(2 * direction),
        ]
    )
    fit = waves @ np.linalg.lstsq(waves, slip, rcond=None)[0]
    by_direction = float(np.ptp(fit)) / 2.0
    by_current = _effect(current_a, slip)
    has_speeds = float(np.ptp(speed)) > SLIP_FIT.camera.least_speed_span_m_s
    by_speed = _effect(speed, slip) if has_speeds else 0.0
    limit = SLIP_FIT.camera.constant_share * abs(mean)
    is_constant = max(by_direction, by_current, by_speed) < limit
    facts = (
        f"{len(rolling)} runs on {ROLLING_SURFACE}: at the nominal {NOMINAL_MM_PER_PX:g} mm/px the wheels "
        f"seem to slip by {mean:.3f} (standard deviation {slip.std():.3f}); "
        f"direction changes this by at most {by_direction:.3f}, current by {by_current:.3f}"
    )
    facts += f", speed by {by_speed:.3f}. " if has_speeds else f" (one speed only, {speed.mean():.2f} m/s). "
    if abs(mean) < SLIP_FIT.camera.least_slip:
        verdict = f"The nominal scale holds within {SLIP_FIT.camera.least_slip:g}."
    elif is_constant:
        verdict = (
            "The same in all directions and independent of current: this is a SCALE ERROR of the camera, not "
            f"slip. With {mm_per_px:g} mm/px the wheels roll."
        )
    else:
        verdict = (
            "This changes with direction, current or speed: it is slip at least in part, and "
            f"{mm_per_px:g} mm/px makes all slips too small. Calibrate the camera with a ruler."
        )
    drift_rad = float(np.mean([steady_drift_rad(run).mean() for run in rolling]))
    verdict += (
        f" The camera sees them go {math.degrees(drift_rad):.1f} deg to the left of the encoders' course: "
        "its marker is turned to the right by as much, and this is taken off the drift on all surfaces."
    )
    return CameraScale(
        mm_per_px, is_constant and abs(mean) >= SLIP_FIT.camera.least_slip, facts + verdict, drift_rad
    )


def _effect(cause: Array, slip: Array) -> float:
    """Return by how much a straight line over the range of `cause` changes the slip."""
    span = float(np.ptp(cause))
    if span == 0.0:
        return 0.0
    return abs(float(np.polyfit(cause, slip, 1)[0])) * span
