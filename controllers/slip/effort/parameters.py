"""Every tuned number of slip compensation by motor effort.

Provenance, unless a line states another: chosen by hand, no record of the data. What is fitted to drives is
in the file of slip maps (`rover-hil identify slip`, `identify probe`), not here. Units are in the names;
other numbers are ratios. A result's sensitivity to each number is printed by
`python -m benchmarks.sensitivity effort estimation`.
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
class FreeForceParameters:
    """Drive force of a rover that makes progress.

    On twelve floors of four contact laws the force of a healthy rover was 0.5 to 1.6 times that of its travel
    before; 0 or below in the air; 2 to 6 times against a wall and dug in.
    """

    window_m: float = 0.15  # of the wheels: force is work per distance over this
    windows: int = 2  # of free driving, before any force is odd
    none: float = 0.25  # of the force of free driving: less is none
    far: float = 2.0  # of the force of free driving: more is far from it


@dataclass(frozen=True, slots=True, kw_only=True)
class SurfaceParameters:
    """Recognition of the surface by the drive force."""

    window_s: float = 0.5  # force is work per distance over this time: over a single cycle it would be noise
    greatest_age_s: float = 1.5  # of a drive force whose slip is still used
    memory_s: float = 2.0  # the force is averaged over about this time while it stays the same
    unknown_deviations: float = 3.0  # a force further from every surface means an unknown one; in deviations
    turning_share: float = 0.35  # rim speed from turning, over travel speed, up to which curves still hold


@dataclass(frozen=True, slots=True, kw_only=True)
class OwnerParameters:
    """Currents that are those of other wheels, compared with the current of a wheel without load."""

    rest_current: float = 2.0  # of a wheel at rest, over that; a wheel that holds the rover draws less
    turning_current: float = 0.5  # of a wheel that turns: friction alone draws twice as much
    turning_rad_s: float = 1.0
    after_s: float = 0.5


@dataclass(frozen=True, slots=True, kw_only=True)
class RecognitionParameters:
    """Whether the ground is a surface of the map.

    Chosen on simulated floors of one surface, random patchworks and floors of random constants (seeds 0 to 9
    of `benchmarks/robotino/torque_maps.py`).
    """

    windows: int = 6  # half seconds over which level and scatter of the force are compared
    least_windows: int = 4  # for a verdict
    deviations: float = 2.0  # of the level, and of a single half second
    scatter: float = 1.5  # greatest, over the scatter of the surface
    slip_sd: float = 0.05  # of a recognised surface's slip
    greatest_sd: float = 0.12  # with the spread of all surfaces that fit; above it the slip is not valid
    contradiction: float = 0.1  # of a wheel map or a learned curve against the surface's slip


@dataclass(frozen=True, slots=True, kw_only=True)
class LearningParameters:
    """Slip over drive force of the present ground, learned while driving.

    Chosen on 90 simulated drives with the excitation (seeds 0 to 9 of nine kinds of ground), by the error of
    the slip in windows where the excitation was left out for 4.5 s of 6 s.
    """

    weight: float = 0.3  # of the newest slip per force
    least_count: int = 2  # measured slips before the curve is used
    least_force_n: float = 3.0  # a smaller one counts as this: its slip is small
    jump_deviations: float = 3.0  # of the force, in scatters of the map's surfaces: another ground
    sd: float = 0.03
    sd_share: float = 0.25  # growth with slip: that of the excitation, from which it is learned
    sd_share_per_sqrt_m: float = 0.6  # growth with slip and distance since
    sd_per_sqrt_m: float = 0.08
    sd_jump_share: float = 0.7  # of the change that the curve predicts
    greatest_sd: float = 0.2


@dataclass(frozen=True, slots=True, kw_only=True)
class FixParameters:
    """Slip between two pose fixes."""

    greatest_sd: float = 0.04  # of the slip, by the noise of the fixes
    deviations: float = 3.0  # so many of the greatest beyond 0 to 1, one of the two fixes is an outlier
    yaw_sd_rad: float = 0.05  # of a fix whose yaw shows the drift
    straightness: float = 0.97  # distance between the ends over distance travelled
    most_cycles: int = 1000  # that are remembered; a fix may be as old as this
    covered_share: float = 0.7  # of the travel between two fixes, by valid windows that they label
    absent_s: float = 5.0  # without a fix for so long, fixes measure no slip


@dataclass(frozen=True, slots=True, kw_only=True)
class ExcitationParameters:
    """Yaw excitation and its evaluation."""

    rim_share: float = 0.2  # speed of the rims by the excitation, over that of the travel
    least_rim_m_s: float = 0.005  # a slower excitation is lost in the noise of the gyro
    greatest_rim_m_s: float = 0.04  # a faster one exceeds slip speeds, and every contact law is read too low
    usual_rim_m_s: float = 0.03  # without a mission that gives the speed
    notch_s: float = (
        4.0  # time constant of the notch in the yaw rate of the follower: a narrow one, for its lag
    )
    periods: int = 2  # whole ones in which the amplitudes are compared
    least_amplitude: float = 0.5  # of the wheels, over the commanded one
    windows_to_give_up: int = 3  # so many windows below it in travel: the drives cannot follow
    least_distance_m: float = 0.04  # shorter travel in a window has no direction, and its slip hardly matters
    # With four readings in a period the third harmonic of stick and slip looks like the excitation itself.
    least_readings: float = 4.5  # of the gyro in a period, each counted once
    # Near the resonance of relaxation length and inertia the gyro follows the wheels with the wrong sign, and
    # the rule about a gyro that does not follow would stop the rover: so the excitation pauses.
    resonance: float = 1.35  # of the body over the wheels
    pause_s: float = 5.0
    windows_to_rest: int = 3  # valid windows before the excitation may rest
    greatest_residual: float = 0.7  # of the wheels' yaw rate after the fit, over the sinusoid


@dataclass(frozen=True, slots=True, kw_only=True)
class GyroInPlaceParameters:
    """Turn back and forth in place, by which scale and sign of the gyro are judged."""

    rim_m_s: float = 0.072  # amplitude of the rims' speed: faster than the excitation, as no slip is read
    greatest_rad: float = math.radians(10.0)  # to each side: wheels near the centre turn slower for it
    period_s: float = 2.5  # 9 degrees to each side with the wheels 0.125 m from the centre
    settle_s: float = 0.7  # after it, in which the path follower turns the rover back to its heading
    least_turn: float = 0.2  # of the amplitude, rms; the commanded turn has 0.47, less was not compared
    least_share: float = 0.56  # of the wheels' turn: of a gyro of half scale on wheels without slip 0.5


@dataclass(frozen=True, slots=True, kw_only=True)
class BracketParameters:
    """Slip between the secant reading and the bound by lag and force, `slip_bracket`.

    `weight`, `greatest_bound`, `sd` and `sd_secant` were chosen on other simulated rovers, after four of nine
    contact laws were seen.
    """

    weight: float = 0.5  # of the way from the secant reading to the bound
    greatest_bound: float = 0.6  # a larger bound counts as this
    sd: float = 0.06
    sd_secant: float = 0.5  # growth of the standard deviation with the secant reading
    usual_force_n_kg: float = 1.1  # drive force over mass where it is not measured
    idle_force_n_kg: float = 0.2  # a smaller one at a long lag is that of wheels without grip
    idle_lag: float = 0.3  # tangent of a long lag
    deviations: float = 2.0  # of the response's noise, from which on it counts
    least_speed_m_s: float = 0.05  # slower travel counts as this
    greatest_delay_s: float = 0.04  # of a gyro that was not calibrated
    delay_steps: int = 4  # between no delay and the greatest
    least_lag_sd_s: float = 0.001  # of a calibrated gyro: time stamps scatter
    unknown_age_s: float = 0.025  # of wheel positions whose age is unknown; a gyro may be ahead by so much


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
    fade_s: float = 5.0  # the same with the yaw excitation, to the encoders' slip of zero
    encoders_below: float = 0.02  # a held slip below this counts as that of the encoders
    least_speed_m_s: float = 0.02  # slower travel has no direction


@dataclass(frozen=True, slots=True, kw_only=True)
class EffortParameters:
    """All tuned numbers, by their part of the method."""

    motor: MotorParameters = MotorParameters()
    stuck: StuckParameters = StuckParameters()
    free: FreeForceParameters = FreeForceParameters()
    surface: SurfaceParameters = SurfaceParameters()
    owners: OwnerParameters = OwnerParameters()
    recognition: RecognitionParameters = RecognitionParameters()
    learning: LearningParameters = LearningParameters()
    fixes: FixParameters = FixParameters()
    excitation: ExcitationParameters = ExcitationParameters()
    gyro_in_place: GyroInPlaceParameters = GyroInPlaceParameters()
    bracket: BracketParameters = BracketParameters()
    sharing: SharingParameters = SharingParameters()
    range: RangeParameters = RangeParameters()
    hold: HoldParameters = HoldParameters()


EFFORT = EffortParameters()
