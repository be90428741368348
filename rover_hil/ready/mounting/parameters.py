"""Every tuned number of the calibration of a mounting. Chosen by hand; units are in the names."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class MountingFitParameters:
    """Rests and turns that are used, and when a result is not."""

    block_s: float = 0.5  # a rest or a turn is found in blocks of this length
    rest_rad_s: float = 0.04  # mean rate of a block at rest, from the quietest one; a turn is faster
    rest_scatter: float = 4.0  # scatter of the rates in a block at rest, over that of the quietest one
    least_rest_s: float = 1.0  # shorter rests do not part two turns
    least_turn_rad: float = 3.0  # a smaller turn does not count
    least_scale: float = 0.8  # beyond, the turns were counted wrongly
    greatest_scale: float = 1.25
    greatest_scale_sd: float = 0.01
    greatest_axis_deg: float = 3.0  # by which the axes of two turns may differ
    greatest_gravity_deg: float = 20.0  # by which gravity may differ from the axis of the turns: a slope
    least_expected_share: float = 0.5  # cosine of the angle from the mounting in the configuration
    greatest_residual_deg: float = 8.0  # of a turn, after scaling


MOUNTING_FIT = MountingFitParameters()
