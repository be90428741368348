"""What a commissioning learns of the slip of its ground, for `[ground] slip = "learned"`."""

import cmath
import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from rover_hil.drives.marks import Marks
from rover_hil.ready.commission.drive import Poses
from rover_hil.ready.commission.worth import LEAST_LEG_M

LEAST_LEGS = 6
"""Fewer do not show how the slip differs from place to place."""


class LearnedGround(NamedTuple):
    """Slip of the legs between marks.

    Attributes:
        legs: Number of legs.
        mean: Mean share of the wheels' travel that was lost.
        sd: Standard deviation of the share of a leg to come.
        cross_sd: The same of the motion across the travel, as a share of it.
    """

    legs: int
    mean: float
    sd: float
    cross_sd: float

    @property
    def words(self) -> str:
        """What was learned."""
        return (
            f"{100 * self.mean:.1f} % of the wheels' distance is lost, plus or minus {200 * self.sd:.1f} %, "
            f"and {200 * self.cross_sd:.1f} % aside, from {self.legs} legs"
        )


def learn_ground(drives: Sequence[tuple[Poses, Marks]]) -> LearnedGround | None:
    """Return the slip of a ground by marks measured by hand; None for too few straight legs.

    The standard deviation is that of a leg that was not measured: of the legs about their mean, and of the
    mean. It contains the noise of the tape, which is not taken off: the legs of a commissioning are few.
    """
    shares = np.array([share for poses, marks in drives for share in _shares(poses, marks)])
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


def _shares(poses: Poses, marks: Marks) -> Iterator[complex]:
    """Yield the travel between marks over that of the wheels, in the body frame, left as imaginary part.

    Only legs at whose end the yaw was measured: both travels are turned by their own yaw there.
    """
    place = poses.at(0.0)
    before_m, wheels_before_m = 0j, complex(*poses.odometry[place, :2])
    for number, t_s in enumerate(marks.t_s.tolist()):
        place = poses.at(t_s)
        here_m = complex(marks.x_m[number], marks.y_m[number])
        wheels_m = complex(*poses.odometry[place, :2])
        leg_m, rolled_m = here_m - before_m, wheels_m - wheels_before_m
        before_m, wheels_before_m = here_m, wheels_m
        yaw_rad = math.radians(float(marks.yaw_deg[number]))
        if abs(rolled_m) < LEAST_LEG_M or not math.isfinite(yaw_rad):
            continue
        turned = cmath.rect(1.0, float(poses.odometry[place, 2]) - yaw_rad)
        yield leg_m * turned / rolled_m
