"""What a report says that slip compensation has changed, and its cost, on written tracks."""

import math
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from rover_hil.report.compensation import Compensation, compensation_of
from rover_hil.report.run_data import RunData
from rover_hil.report.tracks import Track


def run(
    *, yaw_error_rad: float = 0.0, slip: float = 0.0, has_slip: bool = True, fixes: tuple[str, ...] = ()
) -> RunData:
    """Return a drive of 1 m along x by the estimate; wheels that slip, and that turn aside at once."""
    t_s = np.linspace(0.0, 10.0, 101)
    rolled_m = 0.1 * t_s / (1.0 - slip)
    course = np.exp(1j * yaw_error_rad)
    wheels = rolled_m * course
    data: Any = SimpleNamespace(
        config=SimpleNamespace(roles=SimpleNamespace(fixes=fixes)),
        slip=object() if has_slip else None,
        drift=None,
        ground=None,
        estimate=Track(t_s, 0.1 * t_s, 0.0 * t_s, 0.0 * t_s),
        encoders=Track(t_s, wheels.real, wheels.imag, np.full(101, yaw_error_rad)),
        covariance=np.tile([4e-4, 0.0, 0.0, 4e-4, 0.0, 1e-4], (101, 1)),
    )
    return cast(RunData, data)


def test_what_the_wheels_lose_is_what_compensation_has_changed() -> None:
    found = compensation_of(run(slip=0.2))
    assert found is not None
    # A difference that grows evenly to 0.25 m.
    assert found.moved_m == pytest.approx(0.25 / math.sqrt(3.0), rel=0.02)
    assert found.further == pytest.approx(0.25)
    assert found.sd_m == pytest.approx(math.sqrt(8e-4))


def test_a_wrong_yaw_of_the_wheels_does_not_count() -> None:
    found = compensation_of(run(yaw_error_rad=0.5))
    assert found is not None
    assert found.moved_m == pytest.approx(0.0, abs=1e-9)


def test_a_run_without_compensation_or_without_a_drive() -> None:
    assert compensation_of(run(has_slip=False)) is None
    assert compensation_of(run(slip=0.2, fixes=("overhead",))) is None
    still = run()
    object.__setattr__(still, "estimate", Track(*(np.zeros(2),) * 4))
    assert compensation_of(still) is None


def test_a_change_within_its_own_uncertainty_is_said_to_be_so() -> None:
    assert "which is more than it has changed" in Compensation(moved_m=0.01, sd_m=0.02, further=0.1).words
    assert (
        "the rover moved as far as the wheels rolled"
        in Compensation(moved_m=0.03, sd_m=0.02, further=-0.1).words
    )
    assert "more than" not in Compensation(moved_m=0.03, sd_m=0.02, further=0.1).words
