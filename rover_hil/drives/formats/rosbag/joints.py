"""What a topic of joint states holds, gathered over all its messages: the first one decides nothing.

Several nodes may share the topic, a message may name any of the joints, and its arrays may be empty or NaN.
"""

import math
from array import array
from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from controllers.estimation.parameters import ESTIMATION
from controllers.estimation.wheels.angle import MOST_TURNS, ROUNDING, TURN_RAD
from drivers.clock import NANOSECONDS_PER_SECOND
from drivers.errors import LogError
from rover_hil.drives.formats.rosbag.bag import BagMessage
from rover_hil.drives.formats.rosbag.topics import WheelTopic

Array = NDArray[np.float64]

REGULAR = 1.5
"""Two angles are further apart than this many usual periods where messages are missing."""
LEAST_WRAPS = 2
ONE_SIZE = 0.1
"""Jumps of one size differ by this share at most: the motion between two angles is not measured."""
LONGEST_GAP_S = 1.0
"""In a longer gap of the angles the path of the rover is worth a word."""
MOST_JUMPS = 0.02
"""Share of the angles that may jump. More are no restarts of an encoder: chosen by hand."""


class Joint(NamedTuple):
    """How the angle of one wheel is read.

    Attributes:
        has_angle: It comes from angles, else from speeds.
        wrap_rad: The angles wrap after this much; None where they do not.
    """

    has_angle: bool
    wrap_rad: float | None = None


class _Column:
    """Angles and speeds of one joint."""

    def __init__(self) -> None:
        self.messages = 0
        self.speeds = 0
        self.efforts = 0
        self.t_ns = array("q")
        self.angles_rad = array("d")

    def take(self, t_ns: int, position: float, velocity: float, effort: float) -> None:
        self.messages += 1
        self.speeds += math.isfinite(velocity)
        self.efforts += math.isfinite(effort)
        if math.isfinite(position) and (not self.t_ns or t_ns > self.t_ns[-1]):
            self.t_ns.append(t_ns)
            self.angles_rad.append(position)


def values_of(state: Any, name: str) -> tuple[float, float, float]:
    """Return angle, speed and effort of a joint in a message; NaN for what it does not hold.

    An array that does not have one number for each name holds none of them.
    """
    names = list(state.name)
    if name not in names:
        return math.nan, math.nan, math.nan
    place = names.index(name)
    angle, speed, effort = (
        float(values[place]) if len(values) == len(names) else math.nan
        for values in (state.position, state.velocity, state.effort)
    )
    return angle, speed, effort


class JointSurvey:
    """Reads the joint states of a bag once, and says how each wheel is read.

    Args:
        topic: The topic, with the names of the joints.
        limit_rad_s: Greatest setpoint of a wheel.
        messages: All messages of the topic.
        end_ns: Time of the last message of the bag.

    Attributes:
        notes: What a user must know of it, one sentence each.

    Raises:
        LogError: A joint is missing or cannot be used.
    """

    def __init__(
        self, topic: WheelTopic, limit_rad_s: float, messages: Iterable[BagMessage], end_ns: int
    ) -> None:
        self._end_ns = end_ns
        self._topic = topic
        self._limit_rad_s = limit_rad_s
        self._columns = {name: _Column() for name in topic.joints if name}
        self._steering = dict.fromkeys(filter(None, topic.steering), 0)
        self.notes: list[str] = []
        count, names = 0, dict[str, None]()
        for message in messages:
            count += 1
            names.update(dict.fromkeys(message.content.name))
            for name, column in self._columns.items():
                if name in message.content.name:
                    column.take(message.t_ns, *values_of(message.content, name))
            for name in self._steering:
                self._steering[name] += math.isfinite(values_of(message.content, name)[0])
        self._check_names(count, names)
        self._check_values()
        self.joints = tuple(self._joint(name) if name else Joint(has_angle=False) for name in topic.joints)

    def _check_names(self, count: int, names: dict[str, None]) -> None:
        if not count:
            raise LogError(f"topic {self._topic.topic} holds no message: name another topic")
        wanted = (*self._columns, *self._steering)
        missing = ", ".join(name for name in wanted if name not in names)
        if missing:
            known = ", ".join(list(names)[:20]) or "none"
            raise LogError(
                f"topic {self._topic.topic} has no joints {missing} in any of its {count} messages; its "
                f"joints are {known}: correct [wheels]"
            )

    def _check_values(self) -> None:
        unsteered = [name for name, count in self._steering.items() if not count]
        if unsteered:
            raise LogError(
                f"topic {self._topic.topic} holds no angles of {', '.join(unsteered)} in any message: "
                "correct wheels.steering"
            )
        empty = {name: column for name, column in self._columns.items() if not (column.t_ns or column.speeds)}
        if empty:
            only = ", only efforts" if any(column.efforts for column in empty.values()) else ""
            raise LogError(
                f"topic {self._topic.topic} holds neither angles nor speeds of {', '.join(empty)} in any "
                f"message{only}: name another topic, or record one that has them"
            )

    def _joint(self, name: str) -> Joint:
        column = self._columns[name]
        without = column.messages - len(column.t_ns)
        if not column.t_ns:
            self.notes.append(f"{name}: no angles, its speeds are integrated")
            return Joint(has_angle=False)
        if without:
            self.notes.append(f"{name}: {without} of {column.messages} messages hold no new angle")
        t_ns = np.asarray(column.t_ns)
        elapsed_s = np.diff(t_ns) / NANOSECONDS_PER_SECOND
        steps_rad = np.diff(np.asarray(column.angles_rad))
        if not len(steps_rad):
            return Joint(has_angle=True)
        around_ns = np.concatenate(([0], t_ns, [self._end_ns]))
        longest_s = float(np.diff(around_ns).max()) / NANOSECONDS_PER_SECOND
        if longest_s > LONGEST_GAP_S:
            self.notes.append(f"{name}: no angle for up to {longest_s:.1f} s: the path meanwhile is unknown")
        return self._wrapped(
            name, Steps(elapsed_s, steps_rad, float(np.ptp(column.angles_rad)), self._limit_rad_s)
        )

    def _wrapped(self, name: str, steps: "Steps") -> Joint:
        wrap_rad, restarts = (self._topic.wrap_rad, 0) if self._topic.wrap_rad else steps.find_wrap()
        where = f"topic {self._topic.topic}, joint {name}"
        if wrap_rad is None:
            self._check_jumps(where, steps)
            return Joint(has_angle=True)
        if restarts:
            self.notes.append(
                f"{name}: the angle wraps after {wrap_rad:.4g} rad, and jumps {restarts} times besides"
            )
            return Joint(has_angle=True)  # the odometry counts the turns, and begins anew at the jumps
        if not steps.are_counted(wrap_rad):
            reason = (
                f"the angle wraps after {wrap_rad:.4g} rad and comes every {steps.period_s:.2g} s: at "
                f"limits.wheel_speed_rad_s = {self._limit_rad_s:g} the turns between cannot be counted"
            )
            if self._columns[name].speeds < len(steps.steps_rad):
                raise LogError(
                    f"{where}: {reason}; record it faster, or lower that limit if the wheels are slower"
                )
            self.notes.append(f"{name}: {reason}; its speeds are integrated")
            return Joint(has_angle=False)
        self.notes.append(f"{name}: the angle wraps after {wrap_rad:.4g} rad, the turns are counted")
        return Joint(has_angle=True, wrap_rad=wrap_rad)

    def _check_jumps(self, where: str, steps: "Steps") -> None:
        if (around_rad := steps.unknown_wrap()) is not None:
            raise LogError(
                f"{where}: the angle jumps by about {around_rad:.4g} rad each time, it seems to wrap: give "
                "the range after which it does as wrap_rad in [wheels]"
            )
        jumps_rad = steps.jumps_rad()
        if len(jumps_rad) > max(3.0, MOST_JUMPS * len(steps.steps_rad)):
            raise LogError(
                f"{where}: the angle jumps {len(jumps_rad)} times, by up to {max(jumps_rad):.3g} rad, more "
                f"than a wheel turns at limits.wheel_speed_rad_s = {self._limit_rad_s:g}: several nodes send "
                "it, or that limit is too low"
            )


class Steps:
    """Steps between successive angles of a joint, n of them.

    Args:
        elapsed_s: Time of each.
        steps_rad: Their sizes as recorded.
        range_rad: Greatest less smallest angle.
        limit_rad_s: Greatest setpoint of a wheel.
    """

    def __init__(self, elapsed_s: Array, steps_rad: Array, range_rad: float, limit_rad_s: float) -> None:
        self._elapsed_s = elapsed_s
        self.steps_rad = steps_rad
        self._range_rad = range_rad
        self._limit_rad_s = limit_rad_s
        self.period_s = float(np.median(elapsed_s))

    def jumps_rad(self) -> list[float]:
        """Return the sizes of the steps that no wheel makes."""
        sizes_rad: list[float] = np.abs(self.steps_rad[self._is_jump()]).tolist()
        return sizes_rad

    def find_wrap(self) -> tuple[float | None, int]:
        """Return after how many radians the angle wraps, one to four turns, and how many jumps are no wraps.

        At a wrap the wheel goes on as in the step before or after: an encoder that starts from zero again
        does not. None for an angle that does not wrap, or jumps otherwise more often than it wraps. Where a
        wheel may turn by half the range between two angles, going on shows nothing.
        """
        for turns in range(1, MOST_TURNS + 1):
            wrap_rad = turns * TURN_RAD
            if self._range_rad > wrap_rad * (1.0 + ROUNDING):
                continue
            wraps = (np.abs(self.steps_rad) > 0.5 * wrap_rad) & self._is_regular()
            count = int(wraps.sum())
            restarts = count - int(self._goes_on(wrap_rad)[wraps].sum())
            if 2 * restarts < count:
                return wrap_rad, restarts
            if count >= LEAST_WRAPS and self._limit_rad_s * self.period_s >= 0.5 * wrap_rad:
                return wrap_rad, 0
        return None, 0

    def are_counted(self, wrap_rad: float) -> bool:
        """Return whether no other number of turns fits the speed limit in any regular step."""
        regular = self._is_regular()
        other_rad = wrap_rad - np.abs(_unwrapped(self.steps_rad, wrap_rad))
        return bool((other_rad > self._limit_rad_s * self._elapsed_s)[regular].all())

    def unknown_wrap(self) -> float | None:
        """Return the mean size of the wraps of an angle with a range of its own; None where there are none.

        Against the motion before and after, which agree, the angle then jumps by at least all of its range,
        at least twice and by one size.
        """
        before, after = self._around(self.steps_rad / self._elapsed_s)
        slack = 0.5 * np.maximum(np.abs(before), np.abs(after))
        expected_rad = 0.5 * (before + after) * self._elapsed_s
        sizes_rad = np.abs(self.steps_rad - expected_rad)
        wraps = (np.abs(before - after) <= slack) & (sizes_rad >= self._range_rad)
        wraps &= (self.steps_rad * expected_rad < 0.0) & (
            np.abs(expected_rad) > ESTIMATION.odometry.still_rad
        )
        if wraps.sum() < LEAST_WRAPS:
            return None
        mean_rad = float(np.mean(sizes_rad[wraps]))
        return mean_rad if np.ptp(sizes_rad[wraps]) <= ONE_SIZE * mean_rad else None

    def _is_regular(self) -> NDArray[np.bool_]:
        regular: NDArray[np.bool_] = self._elapsed_s <= REGULAR * self.period_s
        return regular

    def _is_jump(self) -> NDArray[np.bool_]:
        most_rad_s = ESTIMATION.odometry.plausible_speed * self._limit_rad_s
        reach_rad = most_rad_s * (self._elapsed_s + ESTIMATION.odometry.arrival_jitter_s)
        jumps: NDArray[np.bool_] = np.abs(self.steps_rad) > reach_rad
        return jumps

    @staticmethod
    def _around(rates: Array) -> tuple[Array, Array]:
        """Return the rates of the step before and of that after each."""
        return np.concatenate((rates[:1], rates[:-1])), np.concatenate((rates[1:], rates[-1:]))

    def _goes_on(self, wrap_rad: float) -> NDArray[np.bool_]:
        """Return at which steps the wheel goes on as before or after, were they wraps."""
        rates = _unwrapped(self.steps_rad, wrap_rad) / self._elapsed_s
        near = np.stack(self._around(rates))
        slack = 0.5 * np.abs(near).max(axis=0) + ESTIMATION.odometry.still_rad / self._elapsed_s
        inside: NDArray[np.bool_] = (rates >= near.min(axis=0) - slack) & (rates <= near.max(axis=0) + slack)
        return inside


def _unwrapped(steps_rad: Array, wrap_rad: float) -> Array:
    half_rad = 0.5 * wrap_rad
    unwrapped: Array = (steps_rad + half_rad) % wrap_rad - half_rad
    return unwrapped
