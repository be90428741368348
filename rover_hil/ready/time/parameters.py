"""Every tuned number of the offsets between devices. Chosen by hand; units are in the names."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class TimingParameters:
    """Blocks of a log that are compared, and when an offset is not used."""

    block_s: float = 4.0  # a constant and a trend are taken out of each block
    least_turn_rad: float = 0.01  # standard deviation that turns leave in a block that is used
    least_blocks: int = 5
    least_readings: int = 8  # of a device in a block
    longest_gap_s: float = 0.6  # between readings of a device in a block
    greatest_offset_s: float = 1.0
    step_s: float = 0.01  # of the first search
    groups: int = 10  # of blocks, for the jackknife
    least_sd_s: float = 0.001
    greatest_sd_s: float = 0.05  # an offset that is less certain is not used
    greatest_residual: float = 0.5  # of what is left over what was there


TIMING = TimingParameters()
