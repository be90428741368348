"""Devices that send many times as many readings as at first."""

import pytest

from controllers.fault import Cause, Fault
from controllers.roles import DeviceRoles
from controllers.safety.flood_rule import FloodRule
from drivers.clock import nanoseconds
from drivers.samples import (
    HeadingReference,
    HeadingSample,
    LinkSample,
    PoseFixSample,
    RateSample,
    Sample,
    WheelSample,
)
from tests.cases import first_often
from tests.controllers.safety.cycles import make_cycle

ROLES = DeviceRoles(wheels="board", required={}, gyro="imu", headings=("compass",), fixes=("gnss",))
SAMPLES: dict[str, Sample] = {
    "imu": RateSample(device="imu", t_ns=0, rate_z_rad_s=0.0),
    "board": WheelSample(device="board", t_ns=0, wheel=0, position_rad=0.0),
    "compass": HeadingSample(
        device="compass", t_ns=0, heading_rad=0.0, reference=HeadingReference.MAGNETIC
    ),
    "gnss": PoseFixSample(
        device="gnss", t_ns=0, x_m=0.0, y_m=0.0, yaw_rad=0.0, position_std_m=1.0, yaw_std_rad=10.0,
        t_capture_ns=0,
    ),
    "other imu": RateSample(device="other imu", t_ns=0, rate_z_rad_s=0.0),
}  # fmt: skip


class Bench:
    """The rule on a cycle of 20 ms."""

    def __init__(self) -> None:
        self.rule = FloodRule(ROLES)
        self.now_s = 0.0

    def run(self, device: str, rate_hz: float, duration_s: float) -> list[tuple[float, Fault]]:
        """Return the faults with their times since the begin."""
        begin_s, sent, found = self.now_s, 0, []
        while self.now_s - begin_s < duration_s - 1e-9:
            self.now_s += 0.02
            while sent / rate_hz < self.now_s - begin_s - 1e-9:
                self.rule.observe(SAMPLES[device], nanoseconds(begin_s + sent / rate_hz))
                sent += 1
            faults = self.rule.check(make_cycle(now_ns=nanoseconds(self.now_s)))
            found += [(self.now_s - begin_s, fault) for fault in faults]
        return found


@pytest.mark.parametrize(
    ("device", "rate_hz"), first_often([("compass", 10.0), ("imu", 100.0), ("board", 50.0), ("gnss", 5.0)])
)
def test_a_device_that_sends_many_times_as_often_is_named(device: str, rate_hz: float) -> None:
    bench = Bench()
    assert not bench.run(device, rate_hz, 5.0)
    found = bench.run(device, max(20.0 * rate_hz, 2000.0), 3.0)
    assert found[0][0] < 0.5
    assert {(fault.source, fault.cause) for _, fault in found} == {(device, Cause.FLOOD)}
    assert f"more than {max(500, round(6 * rate_hz))} readings" in found[0][1].text
    # It lasts as long as the flood, and until the second after it is over.
    assert len(found) > 120
    after = bench.run(device, rate_hz, 5.0)
    assert max((t_s for t_s, _ in after), default=0.0) <= 2.0


@pytest.mark.parametrize(("before_hz", "after_hz"), first_often([(50.0, 250.0), (1.0, 20.0), (100.0, 1.0)]))
def test_less_than_six_times_as_many_are_allowed(before_hz: float, after_hz: float) -> None:
    bench = Bench()
    assert not bench.run("imu", before_hz, 3.0)
    assert not bench.run("imu", after_hz, 3.0)


def test_a_device_that_begins_slowly_is_measured_by_its_fastest_second() -> None:
    bench = Bench()
    assert not bench.run("imu", 5.0, 1.0)
    assert not bench.run("imu", 200.0, 5.0)
    assert bench.run("imu", 2000.0, 1.0)


def test_a_drive_that_sends_on_change_may_send_more_in_motion() -> None:
    bench = Bench()
    assert not bench.run("board", 2.0, 10.0)
    assert not bench.run("board", 400.0, 10.0)


def test_a_link_that_comes_up_begins_another_start() -> None:
    bench = Bench()
    assert not bench.run("imu", 100.0, 5.0)
    bench.rule.observe(LinkSample(device="imu", t_ns=0, up=True, reason=""), nanoseconds(bench.now_s))
    assert not bench.run("imu", 2000.0, 5.0)


def test_devices_without_a_role_are_not_counted() -> None:
    bench = Bench()
    bench.run("other imu", 10.0, 5.0)
    assert not bench.run("other imu", 10_000.0, 2.0)
