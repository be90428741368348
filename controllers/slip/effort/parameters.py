"""Every tuned number of slip compensation by motor effort.

Provenance, unless a line states another: chosen by hand, no record of the data. What is fitted to drives is
in the file of slip maps (`rover-hil identify slip`, `identify probe`), not here. Units are in the names;
other numbers are ratios. A result's sensitivity to each number is printed by
`python -m benchmarks.robotino.parameter_sensitivity`.
"""

import math
from dataclasses import dataclass

SPEED_STEP_RAD_S = 27.0 * math.tau / 60.0 / 16.0
"""One step of a Robotino's speed field at the wheel: 27 rpm at the motor, gear 16."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MotorParameters:
    """Effort of a motor from current and speed."""

    slowest_rad_s: float = 3.0 * SPEED_STEP_RAD_S  # slip and M of slower wheels are too uncertain to be used
    filter_time_s: float = 0.1  # of the low-pass on current and speed; about the delay of the speed loop
    sign_settle_s: float = 0.1  # an unsigned current is not used this long after its wheel changed direction


@dataclass(frozen=True, slots=True, kw_only=True)
class StuckParameters:
    """Wheels that draw current and do not turn."""

    after_s: float = 0.3  # until then the wheel may be starting
    current: float = 2.0  # over the no-load current
    # Not the step of the speed field: with the droop of its speed loop, 0.4 rad/s per ampere, a loaded wheel
    # creeps with 0.1 rad/s and moves the rover, and a slip of 1 would hide that.
    standing_rad_s: float = 0.02  # a stuck wheel turns no faster


@dataclass(frozen=True, slots=True, kw_only=True)
class SurfaceParameters:
    """Recognition of the surface by the drive force."""

    window_s: float = 0.5  # force is work per distance over this time: over a single cycle it would be noise
    memory_s: float = 2.0  # the force is averaged over about this time while it stays the same
    unknown_deviations: float = 3.0  # a force further from every surface means an unknown one; in deviations
    turning_share: float = 0.35  # rim speed from turning, over travel speed, up to which curves still hold


@dataclass(frozen=True, slots=True, kw_only=True)
class ExcitationParameters:
    """Evaluation of the yaw excitation."""

    window_s: float = 0.5  # the amplitudes are compared over this time, at least one period
    least_amplitude: float = 0.3  # of the wheels, over the commanded one
    least_distance_m: float = 0.02  # shorter travel in a window has no direction, and its slip hardly matters
    least_readings: float = 4.0  # of the gyro in a period
    greatest_residual: float = 0.7  # of the wheels' yaw rate after the fit, over the sinusoid


@dataclass(frozen=True, slots=True, kw_only=True)
class SharingParameters:
    """Slip of each wheel from that of the rover."""

    slip_scatter: float = 0.1  # of the wheels' slips about that of the rover, as on patchy ground
    turn_noise_rad: float = 0.005  # of the missing turn: wheels and gyro are not read at quite the same time


@dataclass(frozen=True, slots=True, kw_only=True)
class RangeParameters:
    """Travel for which a map holds, beyond that of the drives that it was fitted to."""

    direction_gap_rad: float = math.radians(30.0)  # from the nearest direction of those drives
    speed_margin: float = 0.3  # share of an end of their range of speeds


@dataclass(frozen=True, slots=True, kw_only=True)
class HoldParameters:
    """Slip between two values, and direction of travel."""

    hold_s: float = 1.0  # without a new value the slip of a wheel decays to the surface's with this time
    least_speed_m_s: float = 0.02  # slower travel has no direction


@dataclass(frozen=True, slots=True, kw_only=True)
class EffortParameters:
    """All tuned numbers, by their part of the method."""

    motor: MotorParameters = MotorParameters()
    stuck: StuckParameters = StuckParameters()
    surface: SurfaceParameters = SurfaceParameters()
    excitation: ExcitationParameters = ExcitationParameters()
    sharing: SharingParameters = SharingParameters()
    range: RangeParameters = RangeParameters()
    hold: HoldParameters = HoldParameters()


EFFORT = EffortParameters()
