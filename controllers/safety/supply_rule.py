"""Stop rule about a supply voltage that is too low, or is no longer reported."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated

from pydantic import Field

from controllers.fault import Cause, Fault, Severity
from controllers.roles import DeviceRoles
from controllers.safety.reasons import Cycle, StopRule
from drivers.clock import nanoseconds
from drivers.safety_event import RESTART, WHEN_GONE, Outcome, SafetyEvent
from drivers.samples import PowerSample, Sample
from drivers.settings import Settings

WARNING_RATIO = 1.05
"""A voltage below `least_supply_v` times this is a warning."""

OLDEST_READING_S = 5.0
"""Devices report their supply more slowly than their wheels: some once per second."""


class SupplySettings(Settings):
    """When a low supply voltage stops the rover.

    Attributes:
        least_supply_v: The rover stops until restart when each reading of the supply voltage of a device has
            been below this for `supply_s`; it warns when each has been below 1.05 times this for half of
            that time. Before the first motion the rover only waits for a higher voltage. It also stops while
            a device that reports its supply voltage has not done so for 5 s, or not yet. Needs such a
            device; without a value it is not watched.
        supply_s: Time for which the voltage must be too low: it dips for moments when the motors accelerate.
    """

    least_supply_v: Annotated[float | None, Field(ge=0.1, le=1000.0)] = None
    supply_s: Annotated[float, Field(ge=0.1, le=60.0)] = 1.0


@dataclass(slots=True)
class _Supply:
    """Readings of one device.

    Attributes:
        voltage_v: The newest reading.
        t_ns: Its time.
        low_ns: Since when all readings have been below the limit; None where the newest is not.
        near_ns: The same for the limit of the warning.
    """

    voltage_v: float
    t_ns: int
    low_ns: int | None = None
    near_ns: int | None = None


class SupplyRule(StopRule):
    """Measures for how long each supply voltage has been too low.

    A device that starts may report 0 V at first, so before the first motion a low voltage ends nothing.
    """

    is_for_drives = False
    observes = (PowerSample,)

    events = (
        SafetyEvent(
            Outcome.ENDS,
            "The supply voltage is too low.",
            "`…: supply voltage …, below safety.least_supply_v (… V) for … s; …`; `emergency "
            "stop`, exit code 1",
            (
                "tests/controllers/safety/test_supply_rule.py::"
                "test_a_low_supply_is_a_warning_first_and_stops_after_its_time",
            ),
            within="`supply_s`",
            settings=("least_supply_v", "supply_s"),
            clears=RESTART,
        ),
        SafetyEvent(
            Outcome.STOPS,
            "With `least_supply_v`, a device has not yet reported its voltage, or no longer reports it for "
            "5 s, or its voltage is too low before the first motion.",
            "`…: no supply voltage yet`, `…: no supply voltage within 5 s`, `…: supply voltage …`",
            (
                "tests/controllers/safety/test_supply_rule.py::"
                "test_a_voltage_that_is_no_longer_reported_stops_the_rover_until_it_is",
            ),
            within="one cycle; 5 s",
            settings=("least_supply_v",),
            clears=WHEN_GONE,
        ),
        SafetyEvent(
            Outcome.CONTINUES,
            "The voltage is below 1.05 times the limit for half of `supply_s`.",
            "Warning on the screen, in the log and in the report.",
            ("tests/controllers/safety/test_supply_rule.py::test_near_the_limit_it_is_a_warning_for_ever",),
            settings=("least_supply_v", "supply_s"),
        ),
    )

    def __init__(self, settings: SupplySettings, roles: DeviceRoles) -> None:
        self._settings = settings
        self._expected = roles.supplies
        self._has_moved = False
        self._stop_ns = nanoseconds(settings.supply_s)
        self._warning_ns = self._longest_gap_ns = nanoseconds(0.5 * settings.supply_s)
        self._supplies: dict[str, _Supply] = {}

    def observe(self, sample: Sample, t_ns: int) -> None:
        """Take a supply voltage."""
        least_v = self._settings.least_supply_v
        if least_v is None or not isinstance(sample, PowerSample) or not math.isfinite(sample.voltage_v):
            return
        before = self._supplies.get(sample.device)
        now = _Supply(sample.voltage_v, t_ns)
        if sample.voltage_v < least_v:
            now.low_ns = t_ns if before is None or before.low_ns is None else before.low_ns
        if sample.voltage_v < WARNING_RATIO * least_v:
            now.near_ns = t_ns if before is None or before.near_ns is None else before.near_ns
        self._supplies[sample.device] = now

    def check(self, cycle: Cycle) -> Iterator[Fault]:
        """Return a reason for every supply that is too low or unknown."""
        least_v = self._settings.least_supply_v
        if least_v is None:
            return
        self._has_moved |= any(cycle.wheels.set.speed_rad_s)
        for device in self._expected:
            if device not in self._supplies:
                yield Fault(device, Cause.UNKNOWN_SUPPLY, f"{device}: no supply voltage yet")
        for device, supply in self._supplies.items():
            # A single reading is no evidence of more time than half of `supply_s`.
            until_ns = min(cycle.now_ns, supply.t_ns + self._longest_gap_ns)
            reads = f"{device}: supply voltage {supply.voltage_v:.1f} V"
            if cycle.now_ns - supply.t_ns > nanoseconds(OLDEST_READING_S):
                text = f"{device}: no supply voltage within {OLDEST_READING_S:g} s"
                yield Fault(device, Cause.UNKNOWN_SUPPLY, text)
            elif supply.low_ns is not None and until_ns - supply.low_ns >= self._stop_ns:
                text = (
                    f"{reads}, below safety.least_supply_v ({least_v:g} V) for "
                    f"{self._settings.supply_s:g} s; charge or replace the battery"
                )
                severity = Severity.FINAL if self._has_moved else Severity.STOP
                yield Fault(device, Cause.LOW_SUPPLY, text, severity)
            elif supply.near_ns is not None and until_ns - supply.near_ns >= self._warning_ns:
                text = f"{reads}, the rover stops below {least_v:g} V; charge the battery"
                yield Fault(device, Cause.LOW_SUPPLY, text, Severity.WARNING)
