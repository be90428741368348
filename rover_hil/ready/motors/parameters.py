"""Every tuned number of the field of motors at a compass. Chosen by hand; units are in the names."""

from dataclasses import dataclass


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
