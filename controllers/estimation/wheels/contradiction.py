"""How far redundant wheels contradict each other: evidence of slip or of a fault."""

import math
from dataclasses import dataclass

from controllers.estimation.parameters import ESTIMATION
from controllers.estimation.wheels.odometry import BodyIncrement
from controllers.motion.kinematics import Kinematics


@dataclass(frozen=True, slots=True, kw_only=True)
class ContradictionReport:
    """Residuals of the least squares over all wheels, summed with a fading memory of half a second.

    Attributes:
        scaled: Root mean square of the residuals per redundant constraint, over what encoder noise and the
            usual slip explain. Above 1 some wheel slips more, or its encoder, radius or steering is wrong.
        wheel: The wheel with the greatest residual where `scaled` is above 1; else None.
        rolling_m: Residual of the rolling of each wheel.
        side_m: Residual of its side slip, 0 for a wheel that may slip sideways.
    """

    scaled: float
    wheel: int | None
    rolling_m: tuple[float, ...]
    side_m: tuple[float, ...]


class WheelContradiction:
    """Sums the residuals of the wheels and compares them with noise and usual slip.

    Args:
        kinematics: Geometry of the wheels.

    Attributes:
        report: Of the last cycle; None where the wheels are not redundant.
    """

    def __init__(self, kinematics: Kinematics) -> None:
        count = kinematics.wheel_count
        self._kinematics = kinematics
        self._rolling_m = [0.0] * count
        self._side_m = [0.0] * count
        self._travel_m = [0.0] * count
        self.report: ContradictionReport | None = None

    def add(self, increment: BodyIncrement) -> ContradictionReport | None:
        """Take the motion of one cycle; return the report, None where the wheels are not redundant."""
        residuals = self._kinematics.residuals(increment.turned_rad, increment.steering_rad)
        if residuals is None or residuals.redundant == 0:
            self.report = None
            return None
        rolling_m, side_m, rim_m, redundant = residuals
        kept = math.exp(-increment.duration_s / ESTIMATION.contradiction.window_s)
        self._rolling_m = [kept * old + new for old, new in zip(self._rolling_m, rolling_m, strict=True)]
        self._side_m = [kept * old + new for old, new in zip(self._side_m, side_m, strict=True)]
        self._travel_m = [kept * old + abs(new) for old, new in zip(self._travel_m, rim_m, strict=True)]
        self.report = self._compare(redundant)
        return self.report

    def _compare(self, redundant: int) -> ContradictionReport:
        noise_m = ESTIMATION.contradiction.encoder_m
        # A wheel at standstill while the others drive contradicts them: the envelope is that of the rover.
        slip_m = ESTIMATION.contradiction.slip * sum(self._travel_m) / len(self._travel_m)
        squares = [
            (rolling**2 + side**2) / (noise_m**2 + slip_m**2)
            for rolling, side in zip(self._rolling_m, self._side_m, strict=True)
        ]
        scaled = math.sqrt(sum(squares) / redundant)
        return ContradictionReport(
            scaled=scaled,
            wheel=squares.index(max(squares)) if scaled > 1.0 else None,
            rolling_m=tuple(self._rolling_m),
            side_m=tuple(self._side_m),
        )
