"""Every tuned number of the identification of a gyro.

Provenance, unless a line states another: chosen by hand, no record of the data. Units are in the names; other
numbers are ratios. A result's sensitivity to each number is printed by
`python -m benchmarks.sensitivity gyro`.
"""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class TurnParameters:
    """Stretches of a log in which the rover turns in place."""

    block_s: float = 1.0  # turns are cut into blocks of this length; blocks with travel are left out
    grid_s: float = 0.001  # between the times at which the wheels' yaw rate is computed
    longest_gap_s: float = 0.15  # nothing is interpolated over a longer gap between readings of a wheel
    least_rate_rad_s: float = 0.03  # standard deviation of the wheels' yaw rate in a block that is used
    least_blocks: int = 4
    least_readings: int = 10  # of the gyro and of each wheel
    in_place_m_s: float = 0.03  # mean speed below which the rover turns in place


@dataclass(frozen=True, slots=True, kw_only=True)
class ResponseParameters:
    """Fit of gain, delay and lag."""

    groups: int = 10  # of blocks, for the jackknife
    starts_s: tuple[tuple[float, float], ...] = (  # delay and lag; the best result is used
        (-0.03, 0.005),
        (0.01, 0.005),
        (0.05, 0.005),
        (0.0, 0.03),
    )
    # Period over 2 pi, damping and drag of the contacts: rovers that spring at 20 Hz and at 8 Hz.
    springs_s: tuple[tuple[float, float, float], ...] = ((0.008, 0.002, 0.002), (0.02, 0.005, 0.01))
    # Bounds of delay, lag, period, damping and drag: a rover springs at 2 to 100 Hz.
    least_s: tuple[float, ...] = (-0.1, 1e-4, 0.0016, 0.0, 0.0)
    greatest_s: tuple[float, ...] = (0.3, 0.3, 0.08, 0.05, 0.2)
    shortest_lag_s: float = 1e-4
    least_explained: float = 0.03  # rms, over that of the readings, by a low-pass or a spring that is used
    greatest_spring: float = (
        0.015  # change of size and angle of the response to the excitation, by the contacts
    )
    greatest_bandwidth_hz: float = 200.0  # a lag that is shorter than this cannot be seen
    # Of delay and lag: what the jackknife cannot see, such as the contact's lag and the positions' age.
    least_sd_s: float = 0.0015
    least_gain_sd: float = 0.01
    # Where setpoints and gyro have the same rate, the steps of the setpoints alias onto the turns.
    same_rate: float = 0.03  # distance of the ratio of both rates from 1
    same_rate_sd_s: float = 0.008  # of delay and lag then
    gain_tolerance: float = 0.02  # standard deviation of a gyro's scale, by its data sheet
    deviations: float = 3.0
    better: float = 0.98  # residual of blocks that were left out, over that without constants
    greatest_residual: float = 0.15  # of all readings; more is a motion that the model does not know


@dataclass(frozen=True, slots=True, kw_only=True)
class GyroFitParameters:
    """All of them."""

    turns: TurnParameters = TurnParameters()
    response: ResponseParameters = ResponseParameters()


GYRO_FIT = GyroFitParameters()
