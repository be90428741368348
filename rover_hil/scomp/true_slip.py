"""True slip and slip angle of a drive in windows."""

from dataclasses import dataclass

import numpy as np

from drivers.errors import ModelError
from rover_hil.drives.arrays import Array, in_body_frame
from rover_hil.drives.ground_truth import TruePoses
from rover_hil.drives.windows import Windows, body_steps
from rover_hil.scomp.drive import SensorRows

WINDOW_S = 2.0
SLOWEST_RIM_M_S = 0.01
FEWEST_WINDOWS = 8
LONGEST_TRUTH_GAP_S = 2.5
"""Enough for a pose fix every two seconds; the truth is not interpolated over more."""
GRID_S = 0.1
POINTS = 31


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SlipWindows:
    """A drive divided into k windows in which the wheels turn.

    Attributes:
        t_s: Middle of each, shape (k,) as everything else.
        slip: Eq 3, from the true distance along the wheels over that of their rims.
        slip_angle_rad: Eq 4, from the true motion, against the direction in which the wheels roll.
        pitch_rad: Mean, with the sign of the log; None without pitch. Likewise roll_rad.
        steering_rad: Mean steering angle of the wheels, 0 for wheels that do not steer.
        without_truth: Number of windows not used because they begin or end within a gap of the truth.
    """

    t_s: Array
    slip: Array
    slip_angle_rad: Array
    pitch_rad: Array | None
    roll_rad: Array | None
    steering_rad: Array
    without_truth: int = 0


def smoothed(t_s: Array, values: Array, memory_s: float) -> Array:
    """Return values through a first-order low-pass, as on the rover."""
    result = np.empty_like(values)
    state = float(values[0])
    steps_s = np.diff(t_s, prepend=t_s[0])
    for index, share in enumerate((-np.expm1(-steps_s / memory_s)).tolist()):
        state += share * (float(values[index]) - state)
        result[index] = state
    return result


def cut(drive: SensorRows, truth: TruePoses, wheel_radius_m: float) -> SlipWindows:
    """Divide a drive into windows of two seconds and compare its wheels with the truth.

    Raises:
        ModelError: Log and truth overlap in fewer than eight windows in which the wheels turn.
    """
    start = max(float(drive.t_s[0]), float(truth.t_s[0]))
    end = min(float(drive.t_s[-1]), float(truth.t_s[-1]))
    edges = np.arange(start, end, WINDOW_S)
    windows = Windows(edges)
    distance_m = wheel_radius_m * windows.step(drive.t_s, drive.wheel_rad) if len(edges) > 1 else edges
    turns = distance_m > SLOWEST_RIM_M_S * WINDOW_S
    after = np.searchsorted(truth.t_s, edges).clip(1)
    is_known = np.diff(truth.t_s)[after - 1] <= LONGEST_TRUTH_GAP_S
    use = turns & is_known[1:] & is_known[:-1]
    if np.count_nonzero(use) < FEWEST_WINDOWS:
        raise ModelError(
            f"log and truth share {np.count_nonzero(use)} windows of {WINDOW_S:g} s with turning wheels, "
            f"{FEWEST_WINDOWS} are needed: check that both use the same clock, and give a longer drive"
        )

    def means(values: Array | None) -> Array | None:
        return None if values is None else windows.mean(drive.t_s, values)

    steering_rad = means(drive.steering_rad)
    steering_rad = np.zeros(len(edges) - 1) if steering_rad is None else steering_rad
    travel_m = body_steps(windows, truth.t_s, truth.x_m, truth.y_m, truth.yaw_rad)
    ahead_m, aside_m = in_body_frame(*travel_m, steering_rad)
    pitch_rad, roll_rad = means(drive.pitch_rad), means(drive.roll_rad)
    return SlipWindows(
        t_s=windows.middle_s[use],
        slip=(1.0 - ahead_m[use] / distance_m[use]),
        slip_angle_rad=np.arctan2(aside_m, ahead_m)[use],
        pitch_rad=None if pitch_rad is None else pitch_rad[use],
        roll_rad=None if roll_rad is None else roll_rad[use],
        steering_rad=steering_rad[use],
        without_truth=int(np.count_nonzero(turns & ~use)),
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TrueVelocity:
    """Motion by the truth at n times: slip angle in rad (any number at rest), speed, yaw rate."""

    slip_angle_rad: Array
    speed_m_s: Array
    yaw_rate_rad_s: Array


def true_velocity(truth: TruePoses, t_s: Array) -> TrueVelocity:
    """Return the true motion at times, from parabolas through three seconds of the truth around each."""
    # Imported here because scipy takes a second that `--help` must not cost.
    from scipy.signal import savgol_filter

    grid_s = np.arange(truth.t_s[0], truth.t_s[-1], GRID_S)
    points = min(POINTS, len(grid_s) - 1 + len(grid_s) % 2)
    rates = [
        np.interp(t_s, grid_s, savgol_filter(np.interp(grid_s, truth.t_s, values), points, 2, 1, GRID_S))
        for values in (truth.x_m, truth.y_m, truth.yaw_rad)
    ]
    psi = np.interp(t_s, truth.t_s, truth.yaw_rad)
    ahead, aside = in_body_frame(rates[0], rates[1], psi)
    return TrueVelocity(
        slip_angle_rad=np.arctan2(aside, ahead), speed_m_s=np.hypot(ahead, aside), yaw_rate_rad_s=rates[2]
    )
