"""What drives show of the slip of their ground, for `[ground] slip = "learned"`."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from drivers.clock import date_of, wall_time_ns

LEAST_LEGS = 6
"""Fewer do not show how the slip differs from place to place."""


class LearnedGround(NamedTuple):
    """Slip of the legs between marks.

    Attributes:
        legs: Number of legs.
        mean: Mean share of the wheels' travel that was lost.
        sd: Standard deviation of the share of a leg to come.
        cross_sd: The same of the motion across the travel, as a share of it.
        noise_m: Standard deviation of the position after one metre and after one radian by what changes from
            place to place; empty where it is part of the slip.
    """

    legs: int
    mean: float
    sd: float
    cross_sd: float
    noise_m: tuple[float, ...] = ()

    @property
    def words(self) -> str:
        """What was learned."""
        return (
            f"{100 * self.mean:.1f} % of the wheels' distance is lost, plus or minus {200 * self.sd:.1f} %, "
            f"and {200 * self.cross_sd:.1f} % goes to the side, from {self.legs} parts of the path"
        )

    def settings(self, source: str) -> dict[str, str | float]:
        """Return the keys of [ground] in a configuration; `source` names the drives."""
        noise = {}
        if self.noise_m:
            keys = ("noise_m_sqrt_m", "noise_m_sqrt_rad")
            noise = {key: float(f"{value:.3g}") for key, value in zip(keys, self.noise_m, strict=True)}
            noise["local_slip_sd"] = 0.0
        return {
            "slip": "learned",
            "slip_mean": round(self.mean, 4),
            "slip_sd": round(self.sd, 4),
            "cross_slip_sd": round(self.cross_sd, 4),
            **noise,
            "source": source,
            "learned_on": date_of(wall_time_ns()).isoformat(),
        }


def ground_of(shares: NDArray[np.complex128]) -> LearnedGround | None:
    """Return the slip of a ground by the travel of legs; None for too few.

    The standard deviation is that of a leg that was not measured: of the legs about their mean, and of the
    mean. It contains the noise of the measured places.

    Args:
        shares: Travel of each leg over that of the wheels, left as imaginary part.
    """
    if len(shares) < LEAST_LEGS:
        return None
    growth = math.sqrt(1.0 + 1.0 / len(shares))
    along, across = 1.0 - shares.real, shares.imag
    return LearnedGround(
        legs=len(shares),
        mean=float(along.mean()),
        sd=growth * float(along.std(ddof=1)),
        # The mean is no part of the prior: a slope that moves the rover aside depends on its heading.
        cross_sd=growth * float(np.sqrt(np.mean(across**2))),
    )
