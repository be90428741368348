"""Every tuned number of the identification of a motor.

Provenance: chosen by hand, no record of the data; none was fitted. Units are in the names; other numbers are
ratios. A result's sensitivity to each number is printed by
`python -m benchmarks.sensitivity motor`. Constants of the motor and of the board are
where they are used, and so is the confidence of the intervals.
"""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordParameters:
    """What a log must contain, and what of it is used."""

    least_readings: int = 3
    hold_s: float = 0.3  # a setpoint that changes after a rest of this length begins a new move
    longest_gap_s: float = 0.3  # positions further apart are not compared
    first_samples: int = 3  # their median is the speed before the first setpoint
    # Positions that differ by more than this from the sum of the reported speeds are not used.
    disagreement: float = 0.3  # share of that sum
    disagreement_rad: float = 10.0  # added, for short drives
    turned_rad_s: float = 1.0  # a motor that is never faster did not turn
    saturated_share: float = (
        0.01  # of readings at the end of the current sensor; with more, a log is not used
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class ResponseParameters:
    """Response of the model to its setpoints."""

    sign_smoothing_rad_s: float = 0.5  # over which Coulomb friction changes sign
    least_damping: float = 0.04  # two time constants that are nearly equal are moved apart by its square root


@dataclass(frozen=True, slots=True, kw_only=True)
class DelayParameters:
    """Loop delay of each move, which is searched on a grid and then refined."""

    longest_s: float = 0.5
    grid_s: float = 0.004  # between two delays that are tried
    largest_change_s: float = 0.01  # of one step of the refinement
    # Costs are sums of squared residuals, in standard deviations.
    low_cost: float = 0.1  # delays that cost no more than this above the best fit alike
    known_cost: float = 25.0  # a move whose worst delay costs no more than this above its best has no delay


@dataclass(frozen=True, slots=True, kw_only=True)
class FitParameters:
    """Search for the best parameters."""

    start_lags_s: tuple[float, float, float, float] = (0.002, 0.01, 0.04, 0.12)  # of the four starts
    start_droop_rad_s_per_a: float = 5.0
    start_motion_share: float = 0.1  # noise of the motion before it is known, over the greatest speed
    first_evaluations: int = 12  # of each start
    last_evaluations: int = 40  # of each round
    rounds: int = 4  # each with the noise of the residuals of the one before
    trusted: float = 3.0  # residuals up to this many standard deviations count in full


@dataclass(frozen=True, slots=True, kw_only=True)
class HiddenParameters:
    """A lag that is too short to be sampled hides lag and inertia."""

    lag_periods: float = 0.5  # sampling periods; a shorter lag is hidden
    least_lag_s: float = 0.002  # lag that the model keeps then
    settled_lags: float = 5.0  # samples this near to a change are not compared then


@dataclass(frozen=True, slots=True, kw_only=True)
class UncertaintyParameters:
    """Intervals of the parameters, and what the data do not determine."""

    fewest_moves: int = 12  # with fewer, stretches of time are the independent units
    blocks: int = 24  # stretches of time
    shortest_block_s: float = 0.5
    null_share: float = 1e-5  # sensitivity of the residuals, over the greatest, below which nothing is known
    lost_share: float = 1e-6  # squared share of a parameter in an unknown direction that makes it unknown
    least_support: float = 1.5  # units that a parameter's interval must rest on
    flat_delay_sd_s: float = 0.04  # a less certain delay is determined by the flat stretch of its cost only
    flat_cost: float = 0.1  # the flat stretch costs no more than this above the best
    flat_reach_s: float = 0.04  # it is searched this far on either side
    flat_step_s: float = 0.001


@dataclass(frozen=True, slots=True, kw_only=True)
class ReportParameters:
    """What is stated about a motor."""

    relative_half: float = 0.5  # of the interval, over the parameter, up to which it is determined
    null_share: float = 1e-6  # the same as `uncertainty.null_share`, for physical constants
    lost_share: float = 1e-3  # share of a constant that may be outside, or inside, a lost combination
    loaded: float = 1.75  # friction over the no-load current that is not the motor's own alone
    spread_periods: float = 0.25  # spread of the delay, in sampling periods, that is reported


@dataclass(frozen=True, slots=True, kw_only=True)
class AverageParameters:
    """Averages over half a second."""

    least_steps: float = 2.5  # of the speed field; of a smaller setpoint, most is the step
    least_drives: int = 10


@dataclass(frozen=True, slots=True, kw_only=True)
class MotorFitParameters:
    """All tuned numbers, by their part of the method."""

    record: RecordParameters = RecordParameters()
    response: ResponseParameters = ResponseParameters()
    delay: DelayParameters = DelayParameters()
    fit: FitParameters = FitParameters()
    hidden: HiddenParameters = HiddenParameters()
    uncertainty: UncertaintyParameters = UncertaintyParameters()
    report: ReportParameters = ReportParameters()
    averages: AverageParameters = AverageParameters()


MOTOR_FIT = MotorFitParameters()
