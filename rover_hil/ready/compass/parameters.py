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


COMPASS_FIT = CompassFitParameters()
