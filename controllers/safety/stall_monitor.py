"""Stop rule about wheels that do not turn as they are commanded to."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated

from pydantic import Field

from controllers.fault import Bound, Cause, Fault, Severity
from controllers.safety.reasons import Cycle, StopRule
from drivers.clock import nanoseconds, seconds
from drivers.safety_event import AFTER_A_WAIT, Outcome, SafetyEvent
from drivers.settings import Settings


class StallSettings(Settings):
    """When a wheel that does not turn, or turns against its setpoint, stops the rover.

    Attributes:
        stall_s: The rover stops when a wheel has not followed its setpoints for this long.
        stall_set_point_rad_s: Least setpoint that every wheel follows under its greatest load. Friction, and
            a drive whose speed decreases under load, may take up smaller setpoints, so they are no evidence.
            306 runs of a Robotino on four surfaces: a setpoint of 0.43 rad/s turns every wheel. A mission
            with a smaller wheel speed (`speed_m_s` over `wheel_radius_m`) is refused, because no stall could
            be detected. In the last centimetres before a corner setpoints are smaller, too: a wheel that jams
            there is not detected.
        stall_ratio: A wheel follows when it turns faster than this share of what its setpoint exceeds
            `stall_set_point_rad_s` by, and faster than `stall_speed_rad_s`.
        stall_speed_rad_s: A slower wheel does not turn. Not more: a loaded wheel that creeps moves the rover.
            Not less: a step of the encoder between two reports of a wheel at standstill, 0.0098 rad/s of the
            Robotino, is no rotation.
        creep_set_point_rad_s: Smaller setpoints are not watched: a drive with coarse steps sends zero.
        creep_rad: The rover stops when setpoints between `creep_set_point_rad_s` and `stall_set_point_rad_s`
            would have turned a wheel by this angle, and it has not turned.
        reverse_s: The rover stops when a wheel has turned against its setpoints for this long, faster than
            twice `stall_speed_rad_s` (the ground drags a jammed wheel back, too), and differs from them by
            more than `stall_set_point_rad_s`.
    """

    stall_s: Annotated[float, Field(ge=0.1, le=10.0)] = 1.0
    stall_set_point_rad_s: Annotated[float, Field(ge=0.01, le=50.0)] = 0.5
    stall_ratio: Annotated[float, Field(ge=0.01, le=0.9)] = 0.1
    stall_speed_rad_s: Annotated[float, Field(ge=0.001, le=1.0)] = 0.01
    creep_set_point_rad_s: Annotated[float, Field(ge=0.0, le=50.0)] = 0.2
    creep_rad: Annotated[float, Field(ge=0.1, le=100.0)] = 1.5
    reverse_s: Annotated[float, Field(ge=0.1, le=10.0)] = 0.5

    def least_speed_rad_s(self, set_point_rad_s: float) -> float:
        """Return the speed above which a wheel follows a setpoint of this size."""
        share_rad_s = self.stall_ratio * (set_point_rad_s - self.stall_set_point_rad_s)
        return max(self.stall_speed_rad_s, share_rad_s)


@dataclass(slots=True)
class _Wheel:
    """What a wheel has not done since it last turned as commanded: times, and angles by the setpoints.

    Attributes:
        missing_rad: Setpoints less measured speeds, added up. It fades within `stall_s` while the wheel
            turns in the direction of its setpoint: one that turns too fast for it is wrong as well, as where
            the encoders of two wheels are swapped.
    """

    stalled_ns: int = 0
    reversed_ns: int = 0
    creep_rad: float = 0.0
    missing_rad: float = 0.0

    def clear(self, kept: float) -> None:
        """Forget what the wheel has not done, except for a share of the missing angle."""
        self.stalled_ns = self.reversed_ns = 0
        self.creep_rad = 0.0
        self.missing_rad *= kept

    @property
    def has_not_followed(self) -> bool:
        """Whether it has not turned as commanded in any way."""
        return bool(self.stalled_ns or self.reversed_ns or self.creep_rad)


class StallMonitor(StopRule):
    """Measures for how long each wheel has not followed its setpoints.

    Setpoints below `stall_set_point_rad_s` count by the angle they add up to. They do not clear: a setpoint
    that swings through zero must not hide a stall. Motion as commanded clears, and so does a rover commanded
    to rest.
    """

    is_for_drives = False

    events = (
        SafetyEvent(
            Outcome.STOPS,
            "A wheel is jammed, not powered, or its encoder has failed.",
            "`wheel …: has not followed its setpoint for … s: …`",
            (
                "tests/controllers/test_stops.py::"
                "test_a_jammed_wheel_is_noticed_in_about_a_second_at_any_set_point_a_drive_can_"
                "follow",
            ),
            within="`stall_s` and 0.3 s",
            settings=("stall_s", "stall_set_point_rad_s", "stall_ratio", "stall_speed_rad_s"),
            clears=AFTER_A_WAIT,
        ),
        SafetyEvent(
            Outcome.STOPS,
            "A small setpoint does not turn a wheel.",
            "`wheel …: has not turned although its setpoints add up to … rad: …`",
            (
                "tests/controllers/safety/test_stall_monitor.py::"
                "test_small_set_points_must_turn_a_wheel_before_they_add_up_to_the_creep_angle",
            ),
            within="`creep_rad` over the setpoint; 0.06 m (Robotino) or 0.14 m (El-Dorado) of travel",
            settings=("creep_rad", "creep_set_point_rad_s", "stall_set_point_rad_s"),
            clears=AFTER_A_WAIT,
        ),
        SafetyEvent(
            Outcome.STOPS,
            "An encoder or motor is reversed, one or all.",
            "`wheel …: turns against its setpoint for … s: …`",
            ("tests/controllers/test_wrong_sensors.py::test_reversed_encoders_are_named_within_the_bar",),
            within="`reverse_s` and 0.1 s, from half of `stall_set_point_rad_s` on",
            settings=("reverse_s", "stall_speed_rad_s", "stall_set_point_rad_s"),
            clears=AFTER_A_WAIT,
        ),
    )

    def __init__(self, settings: StallSettings, wheel_count: int) -> None:
        self._settings = settings
        self._longest_cycle_ns = nanoseconds(0.5 * settings.stall_s)
        self._reverse_ns = nanoseconds(settings.reverse_s)
        self._wheels = [_Wheel() for _ in range(wheel_count)]
        self._checked_ns: int | None = None

    def check(self, cycle: Cycle) -> Iterator[Fault]:
        """Return a reason for every wheel that does not follow the setpoints of the cycle before."""
        checked_ns = cycle.now_ns if self._checked_ns is None else self._checked_ns
        # After a pause of the loop the setpoints have expired: the pause is no stall. In a damaged log, time
        # may run back.
        elapsed_ns = max(0, min(cycle.now_ns - checked_ns, self._longest_cycle_ns))
        self._checked_ns = cycle.now_ns
        elapsed_s = seconds(elapsed_ns)
        is_at_rest = not any(cycle.wheels.set.speed_rad_s)
        kept = math.exp(-elapsed_s / self._settings.stall_s)
        pairs = tuple(zip(cycle.wheels.set.speed_rad_s, cycle.wheels.measured_rad_s, strict=True))
        for index, (commanded, measured) in enumerate(pairs):
            wheel = self._wheels[index]
            # In the direction of the setpoint.
            turning = math.copysign(1.0, commanded) * measured
            if is_at_rest:
                self._wheels[index] = wheel = _Wheel()
            elif turning > self._settings.least_speed_rad_s(abs(commanded)):
                wheel.clear(kept)
            else:
                self._count(wheel, elapsed_ns, commanded, turning)
            wheel.missing_rad += (commanded - measured) * elapsed_s
        for index, (commanded, measured) in enumerate(pairs):
            if self._wheels[index].has_not_followed:
                yield from self._judge(index, commanded, measured)

    def _count(self, wheel: _Wheel, elapsed_ns: int, commanded: float, turning: float) -> None:
        settings, set_point = self._settings, abs(commanded)
        turns_back = turning < -2.0 * settings.stall_speed_rad_s
        if turns_back and set_point - turning >= settings.stall_set_point_rad_s:
            wheel.reversed_ns += elapsed_ns
        else:
            wheel.reversed_ns = 0
        if set_point >= settings.stall_set_point_rad_s:
            wheel.stalled_ns += elapsed_ns
        elif set_point >= settings.creep_set_point_rad_s:
            # Only the size of the sum counts, so that -= is as good.
            wheel.creep_rad += commanded * seconds(elapsed_ns)  # pragma: no mutate

    def _judge(self, index: int, commanded: float, measured: float) -> Iterator[Fault]:
        wheel, settings = self._wheels[index], self._settings
        speeds = f"commanded {commanded:.2f} rad/s, measured {measured:.2f} rad/s"
        if wheel.reversed_ns >= self._reverse_ns:
            text = f"wheel {index}: turns against its setpoint for {settings.reverse_s:g} s: {speeds}"
            yield self._reason(Cause.WHEEL_REVERSED, f"{text}; encoder or motor reversed")
        elif wheel.stalled_ns >= 2 * self._longest_cycle_ns:
            text = f"wheel {index}: has not followed its setpoint for {settings.stall_s:g} s: {speeds}"
            yield self._reason(Cause.WHEEL_STALL, text)
        elif abs(wheel.creep_rad) >= settings.creep_rad:
            text = (
                f"wheel {index}: has not turned although its setpoints add up to {settings.creep_rad:g} rad"
            )
            yield self._reason(Cause.WHEEL_STALL, f"{text}: {speeds}")
        elif wheel.stalled_ns:
            yield Fault(
                "wheels", Cause.WHEEL_STALL, f"wheel {index}: does not follow its setpoint", Severity.SYMPTOM
            )

    def _reason(self, cause: Cause, text: str) -> Fault:
        """Return a reason to stop; the other wheels may have the same fault."""
        return Fault(
            "wheels", cause, text, bound=Bound(wheel_rad=tuple(wheel.missing_rad for wheel in self._wheels))
        )
