"""The rows of a drive as sComp reads them, and the estimated path."""

from dataclasses import dataclass

import numpy as np

from rover_hil.drives.arrays import Array
from rover_hil.drives.ground_truth import TruePoses


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SensorRows:
    """Readings of a drive; n rows. NaN means no new reading, None no such sensor.

    Attributes:
        t_s: Increasing times, shape (n,) as all other arrays.
        wheel_rad: Mean angle turned by the wheels, forward positive, without NaN.
        wheel_yaw_rad: Half the difference of right and left wheels' angles.
        compass_rad: Readings with the sign of the log, unwrapped from one to the next.
        gyro_rad_s: Yaw rate, counter-clockwise positive, without NaN.
        pitch_rad: With the sign of the log, without NaN.
        roll_rad: With the sign of the log, without NaN.
        trace_rad: Angle of the rear left wheel's trace, new valid readings only.
        steering_rad: Mean steering angle of the wheels, counter-clockwise, without NaN; None for wheels that
            do not steer.
        fix_m: Absolute positions in the frame of the pose at start, shape (n, 2).
    """

    t_s: Array
    wheel_rad: Array
    wheel_yaw_rad: Array
    compass_rad: Array | None = None
    gyro_rad_s: Array | None = None
    pitch_rad: Array | None = None
    roll_rad: Array | None = None
    trace_rad: Array | None = None
    steering_rad: Array | None = None
    fix_m: Array | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Track:
    """An estimated path; n rows.

    Attributes:
        heading_rad: Unwrapped.
        slip: Slip ratio of the rover, eq 3.
        slip_angle_rad: Of the centre of mass, eq 1.
        sigma_x_m: Standard deviation of x; NaN where unknown. Likewise sigma_y_m.
    """

    t_s: Array
    x_m: Array
    y_m: Array
    heading_rad: Array
    slip: Array
    slip_angle_rad: Array
    sigma_x_m: Array
    sigma_y_m: Array


def final_error_m(track: Track, truth: TruePoses) -> float:
    """Return the distance between the two ends, eq 18, both paths counted from their own start position."""
    end = min(float(track.t_s[-1]), float(truth.t_s[-1]))
    start = max(float(track.t_s[0]), float(truth.t_s[0]))

    def moved(t_s: Array, values: Array) -> float:
        return float(np.interp(end, t_s, values) - np.interp(start, t_s, values))

    return float(
        np.hypot(
            moved(track.t_s, track.x_m) - moved(truth.t_s, truth.x_m),
            moved(track.t_s, track.y_m) - moved(truth.t_s, truth.y_m),
        )
    )
