"""A gyro that is known to be dead."""

import math

import pytest

from controllers.fault import Fault, Severity
from controllers.roles import DeviceRoles
from controllers.safety.dead_gyro_rule import DeadGyroRule
from controllers.safety.gyro_turn_rules import GyroTurnSettings
from controllers.safety.unproven_turn import UnprovenTurn
from drivers.samples import RateSample
from tests.controllers.safety.cycles import make_cycle

STEP_NS = 20_000_000
BIAS_RAD_S = 0.1


class Gyro:
    def __init__(self) -> None:
        self.unproven = UnprovenTurn()
        roles = DeviceRoles(wheels="wheels", gyro="imu", required={})
        self.rule = DeadGyroRule(GyroTurnSettings(), roles, self.unproven)
        self.now_ns = 0

    def read(self, rate_rad_s: float, duration_s: float, device: str = "imu") -> list[Fault]:
        """Return the last reasons of a time with one reading, and some cycles of alternating noise."""
        found: list[Fault] = []
        for index in range(round(duration_s * 1e9 / STEP_NS)):
            self.now_ns += STEP_NS
            noise_rad_s = 0.04 * math.copysign(1.0, (index % 2) - 0.5)
            sample = RateSample(
                device=device, t_ns=self.now_ns, rate_z_rad_s=BIAS_RAD_S + rate_rad_s + noise_rad_s
            )
            self.rule.observe(sample, self.now_ns)
            found = list(self.rule.check(make_cycle(now_ns=self.now_ns, gyro_bias_rad_s=BIAS_RAD_S)))
        return found


def test_a_gyro_that_is_not_known_to_be_dead_stops_nothing() -> None:
    assert Gyro().read(0.0, 2.0) == []


@pytest.mark.parametrize("rate_rad_s", [0.08, -0.08])
def test_a_dead_gyro_keeps_the_rover_stopped_until_it_shows_a_signal(rate_rad_s: float) -> None:
    gyro = Gyro()
    gyro.unproven.is_dead = True
    (reason,) = gyro.read(0.0, 20.0)
    assert reason.severity is Severity.STOP
    assert reason.name == "gyro dead"
    assert reason.text == (
        "imu: no signal, although the rover turned: wrong axis, or broken; the rover stays stopped until the "
        "gyro measures a turn"
    )
    assert gyro.read(rate_rad_s, 1.0, device="other") != []
    assert gyro.read(rate_rad_s, 0.6) == []
    assert gyro.read(0.0, 1.0) == []
