"""How wrong the yaw may be while nothing has shown that the gyro measures turns."""

import math

from controllers.estimation.parameters import ESTIMATION
from controllers.estimation.wheels.turn_evidence import TurnEvidence

UNWATCHED_YAW = "unwatched yaw"
"""Cause of what is added to the covariance."""

CERTAIN_SD = 3.0
"""The wheels turn the rover for certain when their turn exceeds so many of its standard deviations."""

AGREES_SD = 2.0
"""And the gyro agrees when it differs by fewer of them."""


class UnwatchedTurn:
    """Greatest error of the yaw, if the gyro measures it wrongly and the wheels slip.

    Each wheel may slip by a share of its motion that stays the same over a distance: a first-order
    Gauss-Markov process. Its integral is the difference between the true turn and that by the wheels. Until
    the gyro has agreed with the wheels in a turn that no slip explains, its own turn may be wrong by that and
    by its difference to the wheels. What it may have been wrong by before stays: nothing has measured it.

    Where headings watch the yaw, they measure what slip adds. Then a gyro only has to show once that it has
    the sign and scale of the wheels; until then the turn by the wheels may be the right one where their slip
    does not explain the difference. Were all of the difference counted, uneven slip on a straight drive would
    leave the yaw to the headings and their deviation. A camera that has seen a rotation as the gyro measures
    it shows the same, also where wheels skid.

    Args:
        slip_distance_m: The correlation of the slip falls to 37 % over this distance.
        is_watched: Whether another source measures the yaw.

    Attributes:
        error_rad: Greatest error of the yaw since the gyro last agreed, not negative.
    """

    def __init__(self, slip_distance_m: float, *, is_watched: bool = False) -> None:
        self._slip_distance_m, self._is_watched = slip_distance_m, is_watched
        self._is_confirmed = False
        self._since, self._window = _Difference(), _Difference()
        self._distance_m = 0.0
        self.error_rad = 0.0

    def agree(self, *, is_rotation: bool) -> None:
        """Take that another sensor has measured the same turn as the gyro: both begin anew.

        Args:
            is_rotation: Whether that turn was none of noise.
        """
        self._since, self._window = _Difference(), _Difference()
        self.error_rad = 0.0
        self._is_confirmed |= is_rotation and self._is_watched

    def drive(self, distance_m: float) -> None:
        """Add a distance driven, not negative; the turn on it follows."""
        self._distance_m += distance_m

    def add(self, turn: TurnEvidence) -> bool:
        """Add the turn on the distance driven since the last one; return whether the gyro has agreed."""
        distance_m, self._distance_m = self._distance_m, 0.0
        if self._is_confirmed:
            return False
        keep = math.exp(-distance_m / self._slip_distance_m)
        for part in (self._since, self._window):
            part.add(turn, distance_m, keep)
        if self._window.agrees:
            self.agree(is_rotation=True)
            return True
        if self._window.distance_m > self._slip_distance_m:
            self._window = _Difference()
        # A bound without headings; with them what one standard deviation does not explain.
        by_slip_rad2 = (-1.0 if self._is_watched else 3.0) * self._since.variance_rad2
        error_rad2 = self._since.difference_rad**2 + by_slip_rad2
        self.error_rad = min(math.pi, math.sqrt(max(0.0, error_rad2)))
        return False


class _Difference:
    """Turns by gyro and wheels over a way, and the variance of the latter by slip."""

    def __init__(self) -> None:
        self.gyro_rad = self.wheels_rad = self.distance_m = 0.0
        self.variance_rad2 = self._with_slip_rad = 0.0

    def add(self, turn: TurnEvidence, distance_m: float, keep: float) -> None:
        self.gyro_rad += turn.gyro_rad
        self.wheels_rad += turn.wheels.turn_rad
        self.distance_m += distance_m
        # A bound is sqrt(3) standard deviations, as those of `ErrorBudget`.
        step_rad = ESTIMATION.pose.gap_turn_error / math.sqrt(3.0) * turn.wheels.both_ways_rad
        self.variance_rad2 += 2.0 * self._with_slip_rad * step_rad + step_rad**2
        self._with_slip_rad = keep * (self._with_slip_rad + step_rad)

    @property
    def difference_rad(self) -> float:
        return self.gyro_rad - self.wheels_rad

    @property
    def agrees(self) -> bool:
        """Whether the gyro has measured a turn of the wheels that their slip does not explain."""
        sd_rad = math.sqrt(self.variance_rad2)
        is_certain = abs(self.wheels_rad) > CERTAIN_SD * sd_rad
        return sd_rad > 0.0 and is_certain and abs(self.difference_rad) < AGREES_SD * sd_rad
