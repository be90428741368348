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
    earliest_delay_s: float = -0.1
    longest_delay_s: float = 0.3
    shortest_lag_s: float = 1e-4
    longest_lag_s: float = 0.3
    greatest_bandwidth_hz: float = 200.0  # a lag that is shorter than this cannot be seen
    # Of delay and lag: what the jackknife cannot see, such as the contact's lag and the positions' age.
    least_sd_s: float = 0.0015
    least_gain_sd: float = 0.01
    # Where setpoints and gyro have the same rate, the steps of the setpoints alias onto the turns.
    same_rate: float = 0.03  # distance of the ratio of both rates from 1
    same_rate_sd_s: float = 0.008  # of delay and lag then
    # A result outside these bounds is not used.
    least_gain: float = 0.85
    greatest_gain: float = 1.2
    greatest_residual: float = 0.35


@dataclass(frozen=True, slots=True, kw_only=True)
class GyroFitParameters:
    """All of them."""

    turns: TurnParameters = TurnParameters()
    response: ResponseParameters = ResponseParameters()


GYRO_FIT = GyroFitParameters()
