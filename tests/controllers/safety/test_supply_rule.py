"""A supply voltage that is too low stops the rover, after a warning; a dip does not."""

import math

import pytest

from controllers.fault import Cause, Fault, Severity
from controllers.roles import DeviceRoles
from controllers.safety.supply_rule import SupplyRule, SupplySettings
from drivers.clock import nanoseconds
from drivers.samples import PowerSample, RateSample
from tests.controllers.safety.cycles import make_cycle

LEAST_V = 20.0


class Supply:
    """A rule on a cycle of 20 ms, with a reading in every tenth."""

    def __init__(
        self, settings: SupplySettings | None = None, supplies: tuple[str, ...] = ("drive0",)
    ) -> None:
        roles = DeviceRoles(wheels="drive0", required={}, supplies=supplies)
        self.rule = SupplyRule(settings or SupplySettings(least_supply_v=LEAST_V), roles)
        self.cycles = 0
        self.found: list[Fault] = []

    def read(self, duration_s: float, *voltages_v: float, every: int = 10) -> list[Fault]:
        """Return the reasons at the end of this time, in which each device reports its voltage."""
        for _ in range(round(duration_s / 0.02)):
            now_ns = nanoseconds(0.02) * self.cycles
            for device, voltage_v in enumerate(voltages_v):
                if self.cycles % every == 0:
                    sample = PowerSample(device=f"drive{device}", t_ns=now_ns, voltage_v=voltage_v)
                    self.rule.observe(sample, now_ns)
            self.found = list(self.rule.check(make_cycle(now_ns=now_ns, commanded_rad_s=(1.0,))))
            self.cycles += 1
        return self.found


def severities(reasons: list[Fault]) -> list[Severity]:
    return [reason.severity for reason in reasons]


def test_without_the_setting_nothing_is_watched() -> None:
    assert not Supply(SupplySettings()).read(10.0, 1.0)


def test_a_low_supply_is_a_warning_first_and_stops_after_its_time() -> None:
    supply = Supply()
    assert not supply.read(1.0, 24.0)
    assert not supply.read(0.5, 19.9)
    assert severities(supply.read(0.02, 19.9)) == [Severity.WARNING]
    assert supply.found[0].text == (
        "drive0: supply voltage 19.9 V, the rover stops below 20 V; charge the battery"
    )
    assert severities(supply.read(0.48, 19.9)) == [Severity.WARNING]
    (reason,) = supply.read(0.02, 19.9)
    assert reason == Fault(
        "drive0",
        Cause.LOW_SUPPLY,
        "drive0: supply voltage 19.9 V, below safety.least_supply_v (20 V) for 1 s; charge or replace the "
        "battery",
        Severity.FINAL,
    )


def test_a_dip_stops_nothing() -> None:
    supply = Supply()
    for _ in range(10):
        supply.read(0.8, 18.0)
        assert Severity.FINAL not in severities(supply.found)
        assert not supply.read(0.2, 24.0)


@pytest.mark.parametrize(("voltage_v", "warns"), [(20.9, True), (21.0, False)])
def test_near_the_limit_it_is_a_warning_for_ever(voltage_v: float, warns: bool) -> None:
    assert severities(Supply().read(60.0, voltage_v)) == [Severity.WARNING] * warns


def test_the_time_is_a_setting() -> None:
    supply = Supply(SupplySettings(least_supply_v=LEAST_V, supply_s=4.0))
    assert severities(supply.read(4.0, 19.0)) == [Severity.WARNING]
    assert severities(supply.read(0.02, 19.0)) == [Severity.FINAL]


def test_slow_readings_count_until_the_next_one() -> None:
    supply = Supply()
    assert severities(supply.read(1.0, 19.0, every=50)) == [Severity.WARNING]
    assert severities(supply.read(0.02, 19.0, every=50)) == [Severity.FINAL]


def test_one_reading_alone_stops_nothing() -> None:
    supply = Supply()
    supply.read(0.02, 19.0)
    assert severities(supply.read(3.0)) == [Severity.WARNING]


def test_the_low_one_of_two_devices_is_named() -> None:
    supply = Supply()
    supply.read(1.02, 24.0, 19.0)
    assert [reason.name for reason in supply.found] == ["drive1: supply"]


@pytest.mark.parametrize("voltages_v", [(), (math.nan,)], ids=["none", "not a number"])
def test_without_a_voltage_the_rover_stays_stopped(voltages_v: tuple[float, ...]) -> None:
    supply = Supply()
    supply.rule.observe(RateSample(device="imu", t_ns=0, rate_z_rad_s=0.0), 0)
    assert supply.read(1.0, *voltages_v) == [
        Fault("drive0", Cause.UNKNOWN_SUPPLY, "drive0: no supply voltage yet")
    ]


def test_a_voltage_that_is_no_longer_reported_stops_the_rover_until_it_is() -> None:
    supply = Supply()
    supply.read(0.02, 24.0)
    assert not supply.read(5.0)
    assert supply.read(0.02) == [
        Fault("drive0", Cause.UNKNOWN_SUPPLY, "drive0: no supply voltage within 5 s")
    ]
    assert not supply.read(0.2, 24.0)


def test_each_device_that_reports_its_supply_must_have_done_so() -> None:
    supply = Supply(supplies=("drive0", "drive1"))
    assert supply.read(30.0, 24.0) == [Fault("drive1", Cause.UNKNOWN_SUPPLY, "drive1: no supply voltage yet")]
    assert not supply.read(1.0, 24.0, 24.0)


def test_a_low_voltage_before_the_first_motion_ends_nothing() -> None:
    rule = SupplyRule(
        SupplySettings(least_supply_v=LEAST_V),
        DeviceRoles(wheels="drive0", required={}, supplies=("drive0",)),
    )

    def severities_at(cycle: int, voltage_v: float, *commanded_rad_s: float) -> list[Severity]:
        now_ns = nanoseconds(0.1) * cycle
        rule.observe(PowerSample(device="drive0", t_ns=now_ns, voltage_v=voltage_v), now_ns)
        return severities(list(rule.check(make_cycle(now_ns=now_ns, commanded_rad_s=commanded_rad_s))))

    assert [severities_at(cycle, 0.0, 0.0) for cycle in range(20)][-1] == [Severity.STOP]
    assert not severities_at(20, 24.0, 0.0)
    assert not severities_at(21, 24.0, 1.0)
    assert [severities_at(cycle, 0.0, 1.0) for cycle in range(22, 42)][-1] == [Severity.FINAL]
