"""What is assumed about the slip of wheels whose slip nothing measures."""

from typing import NamedTuple


class SlipPrior(NamedTuple):
    """First-order Gauss-Markov processes over the travel (Gelb 1974, section 3.8), along it and across.

    A ground goes on for some metres, and within it each place has its own slip: with the first alone a slip
    that was once measured would be believed on the next carpet.

    Attributes:
        name: Of the assumption, as in [ground].
        mean: Mean share of the wheels' travel that the rover loses.
        sd: Standard deviation of that share.
        cross_sd: Standard deviation of the motion across the wheels' travel, as a share of that.
        distance_m: The correlation of both falls to 37 % over this distance.
        local_sd: Standard deviation of a slip that changes over `filter.slip_distance_m`, in addition; across
            it is smaller as `cross_sd` is.
        noise_m_sqrt_m: Standard deviation of the position after one metre by what changes from wheel turn to
            wheel turn; None for that of [filter].
        noise_m_sqrt_rad: The same after rotating by one radian.
    """

    name: str
    mean: float
    sd: float
    cross_sd: float
    distance_m: float
    local_sd: float
    noise_m_sqrt_m: float | None = None
    noise_m_sqrt_rad: float = 0.0

    @property
    def local_cross_sd(self) -> float:
        """Standard deviation of the local slip across the travel."""
        return self.local_sd * self.cross_sd / self.sd if self.sd else 0.0

    @property
    def is_informative(self) -> bool:
        """Whether it may be more certain than a measurement of the slip."""
        return self.name != "unknown"


UNKNOWN = SlipPrior("unknown", 0.0, 0.3, 0.1, 10.0, 0.3)
"""Chosen by hand: two standard deviations reach a slip of 0.6, and 0.2 aside, as on a slope of about 10 deg;
a ground goes on for 10 m."""
FIRM = SlipPrior("firm", 0.0, 0.01, 0.005, 10.0, 0.01, 0.002)
"""A tyre loses the rolling resistance (1 to 3 % of the weight) over its slip stiffness (5 to 20 weights per
unit of slip): below 0.6 %; a calibrated radius is known to 0.5 to 1 % (load, wear). Joints and grains: 2 mm
after a metre."""
