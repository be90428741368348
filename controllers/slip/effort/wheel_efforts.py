"""Efforts of all wheels, from the currents that arrive one by one."""

import math
import operator
from collections.abc import Sequence

from controllers.estimation.wheels.odometry import BodyIncrement
from controllers.slip.effort.motor_model import (
    SIGN_UNKNOWN,
    EffortFlag,
    EffortObserver,
    MotorSettings,
    WheelEffort,
)
from drivers.samples import WheelSample

KNOWN_BUT_FOR_SIGN = frozenset((None, *SIGN_UNKNOWN))


class WheelEfforts:
    """Keeps the newest current of each wheel, and turns them into efforts.

    Args:
        motor: The motor of every wheel.
        count: Number of wheels.

    Attributes:
        newest: As of the newest increment; empty before the first.
    """

    def __init__(self, motor: MotorSettings, count: int) -> None:
        self._motor = motor
        self._currents: list[WheelSample | None] = [None] * count
        self._current_ns = [-1] * count
        self._position_ns = [0] * count
        self._observers: list[EffortObserver] = []
        self.newest: tuple[WheelEffort, ...] = ()

    @property
    def positions_ns(self) -> int:
        """Time of the oldest of the newest positions: up to it the odometry is known."""
        return min(self._position_ns)

    @property
    def unknown_work(self) -> EffortFlag | None:
        """Why the work of a wheel is unknown; None where that of all is known."""
        return next(filter(None, [effort.unknown_work for effort in self.newest]), None)

    @property
    def are_torques_known(self) -> bool:
        """Whether the torques of all wheels are known."""
        return bool(self.newest) and all(effort.unknown_torque is None for effort in self.newest)

    def feed(self, sample: WheelSample, t_ns: int) -> None:
        """Take the current of a wheel as of `t_ns`, unless it is missing, not finite or not newer."""
        wheel, current_a = sample.wheel, sample.current_a
        if not 0 <= wheel < len(self._currents):
            return
        if sample.position_rad is not None:
            self._position_ns[wheel] = max(t_ns, self._position_ns[wheel])
        if t_ns > self._current_ns[wheel] and current_a is not None and math.isfinite(current_a):
            self._currents[wheel] = sample
            self._current_ns[wheel] = t_ns

    def observe(self, increment: BodyIncrement, set_speed_rad_s: Sequence[float]) -> None:
        """Update the efforts by an increment; a current counts once."""
        self.newest = tuple(self._observe(increment, set_speed_rad_s))
        self._currents = [None] * len(self._currents)

    def work_j(self, increment: BodyIncrement) -> float:
        """Return the work of the wheels in an increment, unknown ones as 0."""
        torques_nm = [effort.wheel_torque_nm for effort in self.newest]
        work_j: float = sum(map(operator.mul, torques_nm, increment.turned_rad))
        return work_j

    def work_but_for_sign_j(self, increment: BodyIncrement) -> float | None:
        """Return the work; None where more than the sign of a current is unknown."""
        if any(effort.unknown_torque not in KNOWN_BUT_FOR_SIGN for effort in self.newest):
            return None
        return self.work_j(increment)

    def _observe(self, increment: BodyIncrement, set_speed_rad_s: Sequence[float]) -> list[WheelEffort]:
        if not self._observers and all(self._currents):
            self._observers = [
                EffortObserver(self._motor, current_is_signed=sample.current_is_signed)
                for sample in self._currents
                if sample is not None
            ]
        if not self._observers:
            missing = WheelEffort(0.0, 0.0, 0.0, 0.0, (EffortFlag.NO_CURRENT,))
            return [missing] * len(self._currents)
        return [
            observer.step(
                increment.duration_s,
                None if sample is None else sample.current_a,
                turned_rad / increment.duration_s,
                set_rad_s,
            )
            for observer, sample, turned_rad, set_rad_s in zip(
                self._observers, self._currents, increment.turned_rad, set_speed_rad_s, strict=True
            )
        ]
