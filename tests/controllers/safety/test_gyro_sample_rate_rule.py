"""A gyro that sends at another rate than configured: counted over two seconds."""

from collections.abc import Iterable
from dataclasses import replace

import pytest

from controllers.fault import Fault, Severity
from controllers.roles import DeviceRoles
from controllers.safety.gyro_sample_rate_rule import GyroSampleRateRule, GyroSampleRateSettings
from drivers.clock import nanoseconds
from drivers.samples import PowerSample, RateSample, Sample
from tests.controllers.safety.cycles import make_cycle

ROLES = DeviceRoles(wheels="wheels", gyro="imu", required={"imu": 0.1}, gyro_rate_hz=50.0)


def drive(
    rule: GyroSampleRateRule, arrivals_s: Iterable[float], until_s: float, device: str = "imu"
) -> list[tuple[float, Fault]]:
    """Return the reasons of cycles of 20 ms with their times."""
    waiting_ns = [nanoseconds(t_s) for t_s in arrivals_s]
    found: list[tuple[float, Fault]] = []
    for cycle in range(1, round(until_s / 0.02) + 1):
        now_ns = cycle * 20_000_000
        while waiting_ns and waiting_ns[0] <= now_ns:
            t_ns = waiting_ns.pop(0)
            rule.observe(RateSample(device=device, t_ns=t_ns, rate_z_rad_s=0.0), t_ns)
        found += [(now_ns / 1e9, reason) for reason in rule.check(make_cycle(now_ns=now_ns))]
    return found


def every(period_s: float, end_s: float, start_s: float = 0.0) -> list[float]:
    return [start_s + index * period_s for index in range(round((end_s - start_s) / period_s))]


def make_rule(roles: DeviceRoles = ROLES) -> GyroSampleRateRule:
    return GyroSampleRateRule(GyroSampleRateSettings(), roles)


@pytest.mark.parametrize(
    ("rate_hz", "is_wrong"), [(50, 0), (35, 0), (75, 0), (25, 1), (100, 1), (10, 1), (4, 1), (2, 1)]
)
def test_a_rate_that_differs_by_the_factor_is_named_after_the_counting_time(
    rate_hz: int, is_wrong: int
) -> None:
    found = drive(make_rule(), every(1.0 / rate_hz, 4.0), 4.0)
    assert bool(found) == bool(is_wrong)
    if found:
        assert found[0][0] == 2.0
        reason = found[-1][1]
        assert (reason.name, reason.severity, reason.bound.gyro_rad) == (
            "gyro sample rate",
            Severity.STOP,
            0.0,
        )
        assert reason.text == (
            f"imu: sends {rate_hz} yaw rates per second, configured are 50: set the sensor or its rate_hz, "
            "and look for lost messages"
        )


@pytest.mark.parametrize("period_s", [0.04, 0.01])
def test_a_rate_that_differs_by_just_the_factor_is_allowed(period_s: float) -> None:
    rule = GyroSampleRateRule(GyroSampleRateSettings(gyro_rate_factor=2.0), ROLES)
    assert drive(rule, every(period_s, 4.0, 0.5 * period_s), 4.0) == []


def test_a_silence_of_a_quarter_of_the_counting_time_ends_the_count() -> None:
    assert drive(make_rule(), every(0.1, 4.0), 6.0)[-1][0] == 4.4


def test_a_silence_is_no_rate_and_the_count_begins_anew_after_it() -> None:
    assert drive(make_rule(), [*every(0.02, 3.0), *every(0.02, 9.0, 3.49)], 9.0) == []
    assert drive(make_rule(), [*every(0.02, 3.0), *every(0.02, 9.0, 4.5)], 9.0) == []
    found = drive(make_rule(), [*every(0.02, 3.0), *every(0.04, 9.0, 4.5)], 9.0)
    assert found[0][0] == pytest.approx(6.5, abs=0.041)


def test_the_reason_ends_when_the_rate_is_right() -> None:
    found = drive(make_rule(), [*every(0.04, 4.0), *every(0.02, 9.0, 4.0)], 9.0)
    assert found[-1][0] == pytest.approx(4.5, abs=0.1)


def test_without_a_configured_rate_or_of_another_device_nothing_is_counted() -> None:
    assert drive(make_rule(replace(ROLES, gyro_rate_hz=None)), every(0.04, 4.0), 4.0) == []
    assert drive(make_rule(), every(0.04, 4.0), 4.0, device="other") == []
    rule = make_rule()
    other: Sample = PowerSample(device="imu", t_ns=0, voltage_v=12.0, current_a=0.0)
    rule.observe(other, 0)
    assert list(rule.check(make_cycle(now_ns=nanoseconds(5.0)))) == []
