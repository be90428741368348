"""Every tuned number of the calibration of a compass. Chosen by hand; units are in the names."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class CompassFitParameters:
    """Turns that are used, and when a result is not.

    The deviation has at most `most_harmonics` waves per turn: the number that is best on held-out turns.
    """

    sectors: int = 36  # of the directions, for the coverage
    least_covered: int = 34
    least_turns: int = 3
    least_readings_per_turn: int = 20
    most_harmonics: int = 4
    least_lag_s: float = 0.03  # a shorter lag of a compass is not modelled as damping
    table_step_deg: int = 10  # between the entries of a deviation table
    greatest_rms_deg: float = 3.0  # on held-out turns; with more the calibration is not written
    greatest_scale_error: float = 0.15  # of the turns of the reference over those of the compass
    vertical_step_counts: float = 50.0  # by which the vertical field is varied to see its effect
    vertical_sds: float = 10.0  # by which a vertical field must exceed its own noise
    longest_gap_s: float = 0.5  # nothing is integrated over a longer gap between readings of the reference
    steepest_rad: float = 1.0  # pitch up to which rates are turned into a yaw rate


@dataclass(frozen=True, slots=True, kw_only=True)
class MotorFieldParameters:
    """How the field of motors is fitted, and when a result is not used."""

    waves: int = 2  # of the deviation that the calibration of the compass has left
    prior_sd_per_a: float = (
        0.2  # of the field of a motor, over the earth's: holds what the drive does not show
    )
    iterations: int = 4  # the field is not small against the earth's
    block_s: float = 5.0  # of the drive; whole blocks are held out
    folds: int = 5
    least_headings: int = 200
    least_current_change_a: float = 0.1  # standard deviation of the current of at least one motor
    least_own_share: float = 0.05  # of the variance of a current that is not a mixture of the others
    least_direction_spread: float = 0.15  # of the currents across their main direction; 0.5 for a square
    greatest_share_of_before: float = 0.8  # of the error on held-out blocks; else the motors do not matter
    greatest_rms_deg: float = 3.0  # on held-out blocks


MOTOR_FIELD = MotorFieldParameters()
COMPASS_FIT = CompassFitParameters()
