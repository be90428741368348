"""Tests of the slip between pose fixes."""

import pytest

from controllers.slip.effort.slip_by_fixes import SlipAtForce, SlipByFixes
from drivers.samples import PoseFixSample

CYCLE_NS = 20_000_000
STEP_M = 0.004
SLIP = 0.4
FORCE_N = 20.0


class Drive:
    """A rover that goes straight ahead and slips by `SLIP`."""

    def __init__(self) -> None:
        self.slip = SlipByFixes()
        self.t_ns = CYCLE_NS
        self.x_m = 0.0

    def go(self, cycles: int) -> None:
        for _ in range(cycles):
            self.t_ns += CYCLE_NS
            self.x_m += STEP_M * (1.0 - SLIP)
            self.slip.move(self.t_ns, complex(STEP_M), 0.0, FORCE_N * STEP_M)

    def fix(self, device: str = "a", off_m: float = 0.0) -> SlipAtForce | None:
        return self.slip.take(
            PoseFixSample(
                device=device,
                t_ns=self.t_ns,
                x_m=self.x_m + off_m,
                y_m=0.0,
                yaw_rad=0.0,
                position_std_m=0.01,
                yaw_std_rad=0.02,
                t_capture_ns=self.t_ns,
            )
        )


def is_true(found: SlipAtForce | None) -> bool:
    return found is not None and tuple(found) == pytest.approx((FORCE_N, SLIP))


def test_the_fixes_of_two_devices_are_not_compared() -> None:
    drive = Drive()
    found = []
    for index in range(8):
        drive.go(60)
        device = "ab"[index % 2]
        found.append(drive.fix(device, off_m=0.0 if device == "a" else 2.0))
    assert found[:2] == [None, None]
    assert all(map(is_true, found[2:]))
