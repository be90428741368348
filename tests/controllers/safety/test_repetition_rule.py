"""Devices that send again what they have sent before are named, with what that may have made wrong."""

import itertools
import math

import numpy as np
import pytest

from controllers.estimation.wheels.turn_evidence import TurnEvidence, WheelTurn
from controllers.fault import Bound, Cause, Fault
from controllers.roles import DeviceRoles
from controllers.safety import repetition_rule
from controllers.safety.repeated_readings import RepeatedReadings
from controllers.safety.repetition_rule import RepetitionRule
from drivers.clock import nanoseconds
from drivers.samples import (
    HeadingReference,
    HeadingSample,
    PoseFixSample,
    RateSample,
    Sample,
    WheelSample,
)
from tests.controllers.safety.cycles import make_cycle

ROLES = DeviceRoles(wheels="board", required={}, gyro="imu", headings=("compass",), fixes=("gnss",))
STEP_S = 0.02
SPEED_RAD_S = 3.0
NOISE = np.random.default_rng(11).normal(size=(4000, 2)).tolist()


def make_sample(device: str, index: int, t_ns: int) -> Sample:
    """Return a reading of a rover that drives straight on."""
    x, y = NOISE[index]
    if device == "imu":
        return RateSample(device="imu", t_ns=t_ns, rate_z_rad_s=0.01 * x, rate_x_rad_s=0.01 * y)
    if device == "compass":
        heading_rad = round(0.02 * x, 3)
        return HeadingSample(
            device="compass", t_ns=t_ns, heading_rad=heading_rad, reference=HeadingReference.MAGNETIC
        )
    if device == "board":
        return WheelSample(
            device="board", t_ns=t_ns, wheel=0, position_rad=SPEED_RAD_S * STEP_S * index + 0.002 * x
        )
    return PoseFixSample(
        device="gnss", t_ns=t_ns, x_m=0.01 * index + 0.01 * x, y_m=0.01 * y, yaw_rad=0.0,
        position_std_m=0.01, yaw_std_rad=10.0, t_capture_ns=t_ns,
    )  # fmt: skip


def driven(rule: RepetitionRule, device: str, indices: list[int], from_cycle: int = 0) -> list[list[Fault]]:
    """Return the faults of each cycle, in which the device sends one of its readings."""
    found = []
    for cycle, index in enumerate(indices, from_cycle):
        t_ns = nanoseconds(1.0 + STEP_S * cycle)
        rule.observe(make_sample(device, index, t_ns), t_ns)
        turn = TurnEvidence(gyro_rad=0.2 * STEP_S, wheels=WheelTurn(duration_s=STEP_S, left_rad=0.5 * STEP_S))
        found.append(
            list(
                rule.check(
                    make_cycle(
                        now_ns=t_ns, turn=turn, distance_m=0.01, commanded_rad_s=(SPEED_RAD_S, -SPEED_RAD_S)
                    )
                )
            )
        )
    return found


@pytest.mark.parametrize("device", ["imu", "compass", "board", "gnss"])
@pytest.mark.parametrize("period", [13, 200])
def test_a_device_that_repeats_its_readings_is_named(device: str, period: int) -> None:
    rule = RepetitionRule(ROLES)
    healthy = [*range(600)]
    assert not any(driven(rule, device, healthy))
    again = [*itertools.islice(itertools.cycle(healthy[-period:]), 200)]
    faults = driven(rule, device, again, 600)
    first = next(index for index, each in enumerate(faults) if each)
    assert first < 60
    ((fault,), *_) = faults[first:]
    assert (fault.source, fault.cause) == (device, Cause.REPEATS)
    assert f"{device}: repeats" in fault.text
    assert f"{period} readings before" in fault.text
    # Live readings end it.
    assert not any(driven(rule, device, [*range(800, 900)], 800))


@pytest.mark.parametrize("device", ["imu", "compass", "board", "gnss"])
def test_the_bound_contains_what_was_driven_since_the_first_repeated_reading(device: str) -> None:
    rule = RepetitionRule(ROLES)
    driven(rule, device, [*range(300)])
    faults = driven(rule, device, [*range(200, 280)], 300)
    ((*_, fault),) = faults[-1:]
    # Rates and increments are wrong since the first repeated reading; what is absolute is older.
    repeated_s = (180 if device in ("compass", "gnss") else 80) * STEP_S
    bound = fault.bound
    expected = {
        "imu": Bound(gyro_rad=0.3),
        "compass": Bound(yaw_rad=0.5),
        "board": Bound(wheel_rad=(SPEED_RAD_S, -SPEED_RAD_S)),
        "gnss": Bound(position_m=0.5),
    }[device]
    for name, per_s in expected._asdict().items():
        actual = getattr(bound, name)
        pairs = zip(actual, per_s, strict=True) if name == "wheel_rad" else [(actual, per_s)]
        for value, rate in pairs:
            assert abs(value) == pytest.approx(abs(rate) * repeated_s, abs=abs(rate) * 2.1 * STEP_S)
            assert value * rate >= 0.0


@pytest.mark.parametrize("variation_rad", [0.0, 0.06])
def test_two_headings_of_one_device_are_two_quantities(variation_rad: float) -> None:
    """A compass at rest, in steps of 0.1 deg, that sends magnetic and true headings in turn."""
    rule = RepetitionRule(ROLES)
    for cycle in range(3000):
        t_ns = nanoseconds(1.0 + 0.1 * cycle)
        heading_rad = math.radians(round(0.1 * NOISE[cycle][0], 1))
        for reference, offset_rad in (
            (HeadingReference.MAGNETIC, 0.0),
            (HeadingReference.TRUE, variation_rad),
        ):
            rule.observe(
                HeadingSample(
                    device="compass", t_ns=t_ns, heading_rad=heading_rad + offset_rad, reference=reference
                ),
                t_ns,
            )
        assert not [*rule.check(make_cycle(now_ns=t_ns))]


@pytest.mark.parametrize("noise_deg", [0.0, 0.1])
def test_a_rover_that_turns_steadily_does_not_repeat_itself(noise_deg: float) -> None:
    """A compass in whole degrees comes to the same numbers in each turn."""
    rule = RepetitionRule(ROLES)
    for cycle in range(3000):
        t_ns = nanoseconds(1.0 + 0.1 * cycle)
        heading_rad = math.radians(round(3.0 * cycle + noise_deg * NOISE[cycle][0]) % 360 - 180)
        sample = HeadingSample(
            device="compass", t_ns=t_ns, heading_rad=heading_rad, reference=HeadingReference.MAGNETIC
        )
        rule.observe(sample, t_ns)
        assert not [*rule.check(make_cycle(now_ns=t_ns))]


def test_devices_without_a_role_are_not_judged() -> None:
    rule = RepetitionRule(DeviceRoles(wheels="wheels", required={}))
    for device in ("imu", "compass", "board", "gnss"):
        assert not any(driven(rule, device, [*range(100), *range(100)]))


def test_wheels_that_repeat_themselves_without_a_jump_back_move_to_and_fro() -> None:
    rule = RepetitionRule(ROLES)
    for cycle in range(400):
        t_ns = nanoseconds(1.0 + STEP_S * cycle)
        position_rad = 0.01 * NOISE[cycle % 100][0]
        rule.observe(WheelSample(device="board", t_ns=t_ns, wheel=0, position_rad=position_rad), t_ns)
        assert not [*rule.check(make_cycle(now_ns=t_ns))]


def test_each_source_makes_its_history_once(monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[RepeatedReadings[object]] = []

    def make() -> RepeatedReadings[object]:
        made.append(RepeatedReadings())
        return made[-1]

    monkeypatch.setattr(repetition_rule, "RepeatedReadings", make)
    for device in ("imu", "compass", "board"):
        driven(RepetitionRule(ROLES), device, list(range(20)))
    assert len(made) == 3
