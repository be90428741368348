"""How far wheels that skid while the rover rotates may have displaced it."""

import math

from controllers.estimation.filter.error_budget import ErrorBudget
from controllers.estimation.parameters import ESTIMATION
from controllers.estimation.wheels.bounds import WheelBounds
from controllers.estimation.wheels.odometry import BodyIncrement
from controllers.fault import Bound

SKID = "skid"
"""Cause of what is added to the covariance."""

LEAST_SHARE = 0.01
"""Of the travel of a row, by which the other turns against it, that counts: beyond rounding."""


class SkidBound:
    """Inflates the covariance while two rows of wheels that do not steer turn against each other.

    They slide sideways in every rotation, so that friction resists no other force: on a slope, or where the
    rows slip differently, the rover moves though its wheels show a rotation on the spot. It does so for as
    long as that lasts: the errors add up, not their variances. Where a camera measures the motion, the filter
    follows it as far as the motion is expected to be possible.

    Args:
        budget: Inflates the covariance.
        reach: Motion of the body by angles of the wheels.
    """

    def __init__(self, budget: ErrorBudget, reach: WheelBounds) -> None:
        self._budget, self._reach = budget, reach
        self._skidded_m = 0.0
        self._was_measured = False

    def drive(self, increment: BodyIncrement, slip_sd: float) -> None:
        """Take a motion of the wheels.

        Args:
            increment: Of the body.
            slip_sd: Standard deviation of the slip that nothing measures, as a share of the wheels' travel.
        """
        x_m, _, _ = self._reach.greatest(increment.turned_rad)
        # By the wheels: compensation may have taken a part of the way for slip.
        rolled_m = sum(
            effect_m * angle_rad
            for (effect_m, _, _), angle_rad in zip(self._reach.effects, increment.turned_rad, strict=False)
        )
        against_m = x_m - abs(rolled_m)
        is_skidding = against_m > LEAST_SHARE * x_m
        if increment.is_measured is not self._was_measured or (x_m and not is_skidding):
            self._was_measured, self._skidded_m = increment.is_measured, 0.0
            self._budget.clear(SKID)
        if is_skidding:
            sd = ESTIMATION.ground.slip_sd if increment.is_measured else slip_sd
            # A bound is sqrt(3) standard deviations.
            self._skidded_m += math.sqrt(3.0) * sd * against_m
            self._budget.raise_to(SKID, Bound(position_m=self._skidded_m))
