"""Every tuned number of odometry, gyro and pose filter that is not a setting of `[filter]`.

Provenance: chosen by hand, no record of the data. Units are in the names; other numbers are ratios. A
result's sensitivity to each number is printed by `python -m benchmarks.sensitivity effort estimation`.
"""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class OdometryParameters:
    """Motion of the rover by its wheels."""

    velocity_time_s: float = 0.05  # time constant of the velocities
    plausible_speed: float = 1.5  # greatest plausible wheel speed, over the greatest setpoint
    arrival_jitter_s: float = 0.05  # between two positions of a wheel
    still_rad: float = 0.005  # a wheel that has turned by less is at standstill
    reported_speed: float = 0.05  # a drive at standstill reports a smaller speed, over the greatest setpoint


@dataclass(frozen=True, slots=True, kw_only=True)
class PoseParameters:
    """Gyro and fixes of the pose."""

    greatest_rate_rad_s: float = 100.0  # a gyro's reading beyond is not plausible
    # Greatest error of the wheels' turn in a gap of the gyro, as a share of what the wheels add to the left
    # and to the right. By `python -m benchmarks.robotino.turn_without_gyro`, as a share of the root of the
    # sum of squares: standard deviation 0.14 (here 0.3 / sqrt(3) = 0.17), 1 % beyond 0.49, greatest 0.59.
    gap_turn_error: float = 0.3
    least_spacing_s: float = 0.005  # two readings of the gyro that arrive closer were not measured so close
    curvature_memory_s: float = 1.0  # memory of the second derivative of the yaw rate
    misled_slip_s: float = 2.0  # memory of the slip that a wrong gyro has misled
    pause_cycles: float = 3.0  # a pause is longer than this many of the usual cycles
    usual_cycle_growth: float = 1.5  # the usual cycle grows by this factor in a cycle at most
    pause_ages: float = 2.0  # a pause, or a silence, is longer than this many age limits of the device
    backlog_s: float = 0.4  # after a pause, until buffers are empty: 4 kB at 115 200 baud take 0.36 s
    # Of pose fixes in a row, before the frame of their device counts as unknown: trials, whatever their rate.
    most_rejections: int = 2


@dataclass(frozen=True, slots=True, kw_only=True)
class ContradictionParameters:
    """What redundant wheels may contradict each other without a sign of slip or fault."""

    window_s: float = 0.5  # time constant of the sums that are compared
    encoder_m: float = 0.0005  # error of the difference of two positions, at the rim
    slip: float = 0.1  # slip and side slip of rolling wheels, per distance of the rim


@dataclass(frozen=True, slots=True, kw_only=True)
class GroundParameters:
    """Motion over the ground that a camera measures.

    Both are priors, wide on purpose, so that the measurement decides: a wheel that begins to slip wholly
    between two frames is still within the gate.
    """

    slip_sd: float = 0.5  # of the wheels' slip, along the travel and across
    noise_m_sqrt_m: float = 0.05  # of the motion between two frames, beside that slip


@dataclass(frozen=True, slots=True, kw_only=True)
class EstimationParameters:
    """All tuned numbers, by their part of the estimate."""

    contradiction: ContradictionParameters = ContradictionParameters()
    ground: GroundParameters = GroundParameters()
    odometry: OdometryParameters = OdometryParameters()
    pose: PoseParameters = PoseParameters()


ESTIMATION = EstimationParameters()
