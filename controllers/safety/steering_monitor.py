"""Stop rules about wheels that do not steer as they are commanded to, or whose steering angle is unknown."""

import math
from collections.abc import Iterator
from typing import Annotated

from pydantic import Field

from controllers.fault import Cause, Fault
from controllers.roles import DeviceRoles
from controllers.safety.reasons import Cycle, StopRule
from drivers.clock import nanoseconds
from drivers.safety_event import AFTER_A_WAIT, WHEN_GONE, Outcome, SafetyEvent
from drivers.settings import Settings

PROGRESS_RAD = math.radians(1.0)
"""A wheel that has come closer to its setpoint by this much steers."""


class SteeringSettings(Settings):
    """When a wheel that does not steer stops the rover; only for steering angles that the device reports.

    Attributes:
        steering_s: The rover stops when a wheel has been farther than `steering_error_deg` from its steering
            setpoint for this long and has not come closer by a degree.
        steering_error_deg: A wheel that is closer follows its setpoint. A wheel that is jammed within this
            angle is not detected; where it reports its angle, the odometry stays right. A drive that limits
            the angle to less than `low_deg` or `high_deg` of its wheel is only found beyond this angle: enter
            its limits there. A wheel that reports no angle is assumed to follow: jammed, it makes the
            odometry wrong, and only redundant wheels show it (`contradiction` in the log).
    """

    steering_s: Annotated[float, Field(ge=0.1, le=60.0)] = 2.0
    steering_error_deg: Annotated[float, Field(ge=1.0, le=90.0)] = 10.0


class SteeringMonitor(StopRule):
    """Measures for how long each wheel has not come closer to its steering setpoint."""

    is_for_drives = False

    events = (
        SafetyEvent(
            Outcome.STOPS,
            "A steering drive is jammed, not powered, or has the wrong sign, and reports its angle.",
            "`wheel …: has not steered for … s: …`",
            ("tests/controllers/safety/test_steering_monitor.py::test_a_wheel_that_does_not_steer_is_named",),
            within="`steering_s`",
            settings=("steering_s", "steering_error_deg"),
            clears=AFTER_A_WAIT,
        ),
    )

    def __init__(self, settings: SteeringSettings) -> None:
        self._settings = settings
        self._limit_rad = math.radians(settings.steering_error_deg)
        self._started: dict[int, tuple[int, float]] = {}

    def check(self, cycle: Cycle) -> Iterator[Fault]:
        """Return a reason for every wheel that does not steer."""
        pairs = zip(
            cycle.wheels.set.steering_rad, cycle.wheels.steering_rad, strict=False
        )  # pragma: no mutate
        for wheel, (target, angle) in enumerate(pairs):
            error_rad = target - angle
            if abs(error_rad) < self._limit_rad:
                self._started.pop(wheel, None)
                continue
            since_ns, from_rad = self._started.setdefault(wheel, (cycle.now_ns, angle))
            if math.copysign(1.0, error_rad) * (angle - from_rad) > PROGRESS_RAD:
                self._started[wheel] = (cycle.now_ns, angle)
            elif cycle.now_ns - since_ns >= nanoseconds(self._settings.steering_s):
                angles = f"commanded {math.degrees(target):.0f} deg, measured {math.degrees(angle):.0f} deg"
                yield Fault(
                    "wheels",
                    Cause.STEERING,
                    f"wheel {wheel}: has not steered for {self._settings.steering_s:g} s: {angles}; the "
                    "steering is jammed, not powered, or its sign is wrong",
                )


class SteeringReportRule(StopRule):
    """Stops when a wheel that has reported its steering angle no longer does."""

    is_for_drives = False

    events = (
        SafetyEvent(
            Outcome.STOPS,
            "A wheel no longer reports its steering angle, or reports one that is not finite.",
            "`wheel …: reports no steering angle for … s`",
            (
                "tests/controllers/test_steering.py::"
                "test_a_wheel_whose_reports_end_stops_the_rover_and_is_named",
            ),
            within="`max_age_s` of the wheels and one cycle",
            settings=("devices.NAME.max_age_s",),
            clears=WHEN_GONE,
        ),
    )

    def __init__(self, roles: DeviceRoles) -> None:
        self._limit_s = roles.max_age_s(roles.wheels)

    def check(self, cycle: Cycle) -> Iterator[Fault]:
        """Return a reason for every wheel whose newest angle is older than the wheels' `max_age_s`."""
        for wheel, t_ns in sorted(cycle.wheels.steering_ns.items()):
            if cycle.now_ns - t_ns > nanoseconds(self._limit_s):
                text = f"wheel {wheel}: reports no steering angle for {self._limit_s:g} s"
                yield Fault(f"wheel {wheel}", Cause.STEERING_ANGLE, text)
