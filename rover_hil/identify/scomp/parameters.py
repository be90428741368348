"""Every tuned number of the fit of sComp's parameters to a drive.

Provenance, unless a line states another: chosen by hand, no record of the data. Units are in the names; other
numbers are ratios. A result's sensitivity to each number is printed by
`python -m benchmarks.sensitivity scomp_fit`.
"""

import math
from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class CheckParameters:
    """A truth that cannot be that of the log is rejected."""

    slip_angle_rad: float = math.radians(60.0)  # greater ones are no driving forwards
    astray_share: float = 0.5  # of the windows, with a greater slip angle
    stuck_slip: float = 0.95  # median of a rover that does not move
    along_x_rad: float = 2e-3  # heading at start below which the frame of the truth starts along x
    inverted_share: float = 0.7  # misfit of the other sign, over this one's, that inverts pitch or compass


@dataclass(frozen=True, slots=True, kw_only=True)
class PitchParameters:
    """Slip by the pitch, and the two-segment law."""

    two_segment_range_rad: tuple[float, float] = (0.0, math.radians(25.0))  # as in paper 000
    resistance_prior: tuple[float, float] = (0.06, 0.05)  # mean and standard deviation of c_rr
    stiffness_prior_sd: float = 0.6  # of the logarithm of C_x
    resistance_range: tuple[float, float] = (-0.15, 0.5)
    stiffness_reach: float = 2.0  # of the logarithm of C_x on either side of the default
    outlier_sd: float = 3.0  # residuals further off get less weight
    least_fluctuation: float = 0.03
    longest_memory_s: float = 20.0  # of the correlation of residuals, here and of the roll
    # By how much, as a share, C_x may differ on the next ground; added to the fit's own uncertainty.
    transfer: float = 0.08


@dataclass(frozen=True, slots=True, kw_only=True)
class RollParameters:
    """Slip angle by the roll."""

    gain_prior: tuple[float, float] = (1.0, 0.7)  # mean and standard deviation
    transfer: float = 0.15  # as that of the pitch, of the gain
    least_alone_deg: float = 3.0  # standard deviation of the slip angle
    least_rest_deg: float = 1.5  # the same, of what the roll does not explain
    shortest_memory_s: float = 4.0
    told_rest_deg: float = 10.0  # a greater rest is reported where it is also more than the next share
    told_share: float = 0.7  # of the drift alone


@dataclass(frozen=True, slots=True, kw_only=True)
class CompassParameters:
    """Errors of the compass."""

    transfer_rad: float = math.radians(0.5)  # change of the offset until the next drive
    least_noise_rad: float = math.radians(0.05)


@dataclass(frozen=True, slots=True, kw_only=True)
class GyroParameters:
    """Noise of the gyro."""

    fewest_readings: int = 10
    least_walk_rad_sqrt_s: float = math.radians(0.01)


@dataclass(frozen=True, slots=True, kw_only=True)
class TraceParameters:
    """Errors of the trace angle, and the distance of the rear axle."""

    rear_axle_sd_m: float = 0.1  # of the drawing's
    offset_sd_rad: float = math.radians(0.5)  # of the camera's mounting
    greatest_error_rad: float = math.radians(10.0)  # a trace further off is wrong
    fewest: int = 20
    slowest_m_s: float = 0.02  # a slower rover's trace has no direction
    inverted_share: float = 0.5  # median error of the other sign, over this one's, that inverts it
    least_noise_rad: float = math.radians(0.2)
    time_range_s: tuple[float, float] = (0.05, 2.0)  # of the noise's correlation


@dataclass(frozen=True, slots=True, kw_only=True)
class ScompFitParameters:
    """All tuned numbers, by their part of the fit."""

    check: CheckParameters = CheckParameters()
    pitch: PitchParameters = PitchParameters()
    roll: RollParameters = RollParameters()
    compass: CompassParameters = CompassParameters()
    gyro: GyroParameters = GyroParameters()
    trace: TraceParameters = TraceParameters()


SCOMP_FIT = ScompFitParameters()
