"""Odometries to compare with the sComp filter: plain, with the compass, and sComp as in paper 000."""

from collections.abc import Callable

import numpy as np

from controllers.slip.scomp.parameters import ScompParameters
from drivers.errors import ModelError
from rover_hil.drives.arrays import Array
from rover_hil.scomp.drive import SensorRows, Track
from rover_hil.scomp.odometry import with_compass_sign


def plain_track(drive: SensorRows, parameters: ScompParameters) -> Track:
    """Return wheel odometry: no slip, heading by the difference of the wheels."""
    rover = parameters.rover
    heading = rover.wheel_radius_m * drive.wheel_yaw_rad / (0.5 * rover.track_m)
    return _integrate(drive, parameters, heading - heading[0], np.zeros_like(heading), None)


def compass_track(drive: SensorRows, parameters: ScompParameters) -> Track:
    """Return wheel odometry turned by the compass, the paper's "enhanced odometry"."""
    heading = _compass_heading(drive, parameters)
    return _integrate(drive, parameters, heading, np.zeros_like(heading), None)


def paper_track(drive: SensorRows, parameters: ScompParameters) -> Track:
    """Return sComp as the paper has it, with eq 15 corrected: V_x = r w (1 - s_x0 - k (|beta| - beta0)).

    The slip angle is the trace's, the last one held; the heading is the compass', unfiltered.

    Raises:
        ModelError: The drive has no trace or no compass.
    """
    if drive.trace_rad is None:
        msg = "sComp as in the paper needs trace angles, and the drive has none: use the pose estimator"
        raise ModelError(msg)
    beta = parameters.trace.sign * _held(drive.trace_rad)
    return _integrate(
        drive, parameters, _compass_heading(drive, parameters), beta, parameters.two_segment_slip.slip_at
    )


def _compass_heading(drive: SensorRows, parameters: ScompParameters) -> Array:
    """Return the heading by the unfiltered compass.

    Raises:
        ModelError: The drive has no compass.
    """
    if drive.compass_rad is None:
        msg = "compass-enhanced odometry needs a compass, and the drive has none: use plain odometry"
        raise ModelError(msg)
    parameters, _ = with_compass_sign(drive, parameters)
    compass = parameters.compass
    heading: Array = (compass.sign or 1) * _held(drive.compass_rad) - (compass.offset_rad or 0.0)
    return heading


def _held(values: Array) -> Array:
    """Return each value until the next; before the first there is zero."""
    index = np.maximum.accumulate(np.where(np.isfinite(values), np.arange(len(values)), -1))
    return np.where(index >= 0, values[np.maximum(index, 0)], 0.0)


def _integrate(
    drive: SensorRows,
    parameters: ScompParameters,
    heading_rad: Array,
    slip_angle_rad: Array,
    slip_at: Callable[[float], float] | None,
) -> Track:
    """Integrate eqs 15-17; every row moves by the means of its two ends."""
    slip = np.zeros_like(heading_rad)
    if slip_at is not None:
        slip = np.array([slip_at(beta) for beta in slip_angle_rad.tolist()])
    rim_m = parameters.rover.wheel_radius_m * np.diff(drive.wheel_rad)
    along = rim_m * (1.0 - slip[1:])
    across = along * np.tan(slip_angle_rad[1:])
    middle = 0.5 * (heading_rad[1:] + heading_rad[:-1])
    x_m = np.concatenate(([0.0], np.cumsum(np.cos(middle) * along - np.sin(middle) * across)))
    y_m = np.concatenate(([0.0], np.cumsum(np.sin(middle) * along + np.cos(middle) * across)))
    unknown = np.full_like(heading_rad, np.nan)
    return Track(
        t_s=drive.t_s,
        x_m=x_m,
        y_m=y_m,
        heading_rad=heading_rad,
        slip=slip,
        slip_angle_rad=slip_angle_rad,
        sigma_x_m=unknown,
        sigma_y_m=unknown,
    )
