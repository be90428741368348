"""Stop rule about drives that turn their wheels more slowly than commanded, without reporting it."""

import math
from collections import deque
from collections.abc import Iterator
from typing import Annotated, NamedTuple

from pydantic import Field

from controllers.fault import Cause, Fault, Severity
from controllers.roles import DeviceRoles
from controllers.safety.reasons import Cycle, StopRule
from controllers.safety.stall_monitor import StallSettings
from drivers.clock import nanoseconds, seconds
from drivers.safety_event import Outcome, SafetyEvent

WARNING_RATIO = 0.6
"""A wheel that turns at less than this share of its setpoints is a warning."""

LAG_S = 0.3
"""A drive may follow a change of its setpoint as slowly as a low-pass with this time constant.

Least squares of the speed on the setpoint behind this low-pass give the gain of a drive with this lag or with
none, and more than the gain of a drive with a shorter lag: the low-pass e of a setpoint s is e + T e' = s, so
that the integrals of e s and e^2 differ by T / 2 times the change of e^2."""

PARTS = 20
"""Of the window, so that old cycles leave it in steps."""


class ResponseSettings(StallSettings):
    """When a wheel that turns more slowly than commanded stops the rover.

    Attributes:
        response_s: The ratio of measured speed to setpoint of each wheel is that of the least squares
            through zero over this time of driving: with setpoints above `stall_set_point_rad_s`. Where the
            wheel does not follow in the sense of `stall_ratio`, the time counts as soon as it follows again;
            `stall_s` is for a wheel that does not.
        response_ratio: The rover stops when the ratio of a wheel is below this. Below 0.6 it is a warning,
            from half of `response_s` on.
            Both only where the wheel lacks more than `stall_set_point_rad_s` on average, which its load may
            take: with 0.5 rad/s a drive that obeys 40 % is found at 0.87 rad/s, not at 0.8 rad/s. Lower that
            key to what your drives lose under load. Without a value the rover is not stopped.
    """

    response_s: Annotated[float, Field(ge=1.0, le=600.0)] = 5.0
    response_ratio: Annotated[float | None, Field(ge=0.01, le=1.0)] = None


class _Sums(NamedTuple):
    """Integrals over a time of driving, after the low-pass: setpoint times speed, its square, its size.

    `lead` is how much less of the first than of the second a drive without a lag has where it slows down.
    """

    t_s: float = 0.0
    speed: float = 0.0
    square: float = 0.0
    size: float = 0.0
    lead: float = 0.0

    def plus(self, other: "_Sums") -> "_Sums":
        """Return the sums over both times."""
        return _Sums(
            self.t_s + other.t_s,
            self.speed + other.speed,
            self.square + other.square,
            self.size + other.size,
            self.lead + other.lead,
        )


class _Wheel:
    """The newest `response_s` of a wheel's driving, in parts."""

    def __init__(self, response_s: float) -> None:
        self._part_s = response_s / PARTS
        self._full_s = response_s - self._part_s
        self._parts: deque[_Sums] = deque()
        self._full = self._newest = self._open = _Sums()
        self.slow_rad_s = 0.0

    def count(self, sums: _Sums, *, follows: bool) -> None:
        """Count a cycle; one in which the wheel does not follow as soon as it follows again."""
        if self._open.t_s:
            sums, self._open = self._open.plus(sums), _Sums()
        if not follows:
            self._open = sums
            return
        self._newest = self._newest.plus(sums)
        if self._newest.t_s >= self._part_s:
            self._parts.append(self._newest)
            self._newest, self._full = _Sums(), _Sums()
            # A part in which the wheel did not follow for long is longer than the others.
            while sum(part.t_s for part in self._parts) - self._parts[0].t_s >= self._full_s:
                self._parts.popleft()
            for part in self._parts:
                self._full = self._full.plus(part)

    @property
    def open_s(self) -> float:
        """Time of driving in which the wheel has not followed and not yet followed again."""
        return self._open.t_s

    def forget_open(self) -> None:
        """Leave that time out, with what follows from its setpoints: the wheel stalls."""
        self._open = _Sums()
        self.slow_rad_s = 0.0

    @property
    def is_full(self) -> bool:
        """Whether the window is full."""
        return self._full.t_s >= self._full_s

    def response(self, load_rad_s: float) -> float | None:
        """Return the ratio of speed to setpoint over half of the window at least.

        None where the time is shorter, or the load may explain the ratio.
        """
        if self._full.t_s < 0.5 * self._full_s:
            return None
        sums = self._full.plus(self._newest)
        # A window that begins fast and ends slowly blames no drive without a lag.
        speed = sums.speed + max(0.0, sums.lead)
        if speed + load_rad_s * sums.size >= sums.square:
            return None
        return speed / sums.square


class ResponseRule(StopRule):
    """Measures the ratio of speed to setpoint of each wheel that does not stall."""

    is_for_drives = False

    events = (
        SafetyEvent(
            Outcome.STOPS,
            "A drive turns its wheel more slowly than commanded and reports nothing.",
            "`wheel …: turns at … % of its setpoints over … s of driving; …`",
            (
                "tests/controllers/safety/test_response_rule.py::"
                "test_a_drive_that_obeys_two_fifths_stops_the_rover_within_the_time",
            ),
            within="`response_s` of driving",
            settings=("response_ratio", "response_s", "stall_set_point_rad_s"),
            clears="once, after `suspicion_rest_s` at standstill",
        ),
        SafetyEvent(
            Outcome.CONTINUES,
            "A wheel turns at less than 60 % of its setpoints over half of `response_s`, and lacks more "
            "than `stall_set_point_rad_s`.",
            "Warning on the screen, in the log and in the report.",
            ("tests/controllers/safety/test_response_rule.py::test_without_a_setting_it_is_a_warning",),
            settings=("response_s", "stall_set_point_rad_s"),
        ),
    )

    def __init__(self, settings: ResponseSettings, roles: DeviceRoles, wheel_count: int) -> None:
        self._settings = settings
        self._longest_cycle_ns = nanoseconds(settings.response_s / PARTS)
        judged = frozenset(range(wheel_count)) - roles.unmeasured_wheels - roles.undriven_wheels
        self._wheels = {wheel: _Wheel(settings.response_s) for wheel in sorted(judged)}
        self._checked_ns: int | None = None
        self._has_stopped = False

    def check(self, cycle: Cycle) -> Iterator[Fault]:
        """Return a reason for every wheel that turns more slowly than commanded."""
        checked_ns = cycle.now_ns if self._checked_ns is None else self._checked_ns
        elapsed_s = seconds(max(0, min(cycle.now_ns - checked_ns, self._longest_cycle_ns)))
        self._checked_ns = cycle.now_ns
        if not any(cycle.wheels.set.speed_rad_s):
            # After a stop for this the wheels must show again how they respond.
            forgets, self._has_stopped = self._has_stopped, False
            for index, wheel in self._wheels.items():
                if forgets:
                    self._wheels[index] = _Wheel(self._settings.response_s)
                elif wheel.open_s:
                    wheel.forget_open()
        for index, pair in enumerate(
            zip(cycle.wheels.set.speed_rad_s, cycle.wheels.measured_rad_s, strict=True)
        ):
            if index in self._wheels:
                self._count(self._wheels[index], elapsed_s, *pair)
                yield from self._judge(index, self._wheels[index])

    def _count(self, wheel: _Wheel, elapsed_s: float, commanded: float, measured: float) -> None:
        settings = self._settings
        before = wheel.slow_rad_s
        wheel.slow_rad_s += (commanded - wheel.slow_rad_s) * -math.expm1(-elapsed_s / LAG_S)
        expected, size = wheel.slow_rad_s, abs(commanded)
        is_driven = size >= settings.stall_set_point_rad_s
        turning = math.copysign(1.0, commanded) * measured
        sums = _Sums(
            elapsed_s * is_driven,
            elapsed_s * expected * measured,
            elapsed_s * expected**2,
            elapsed_s * abs(expected),
            0.5 * LAG_S * (before**2 - expected**2),
        )
        stalls = is_driven and turning <= settings.least_speed_rad_s(size)
        wheel.count(sums, follows=not stalls and (is_driven or not wheel.open_s))
        if wheel.open_s > settings.stall_s:
            wheel.forget_open()

    def _judge(self, index: int, wheel: _Wheel) -> Iterator[Fault]:
        settings = self._settings
        ratio = wheel.response(settings.stall_set_point_rad_s)
        if ratio is None:
            return
        over_s = settings.response_s if wheel.is_full else 0.5 * settings.response_s
        text = (
            f"wheel {index}: turns at {100.0 * ratio:.0f} % of its setpoints over {over_s:g} s "
            "of driving; drive, motor or supply is weak, or wheel_radius_m or the mapping is wrong"
        )
        if wheel.is_full and settings.response_ratio is not None and ratio < settings.response_ratio:
            self._has_stopped = True
            yield Fault("wheels", Cause.WHEEL_RESPONSE, text, Severity.RECOVERABLE)
        elif ratio < WARNING_RATIO:
            yield Fault("wheels", Cause.WHEEL_RESPONSE, text, Severity.WARNING)
