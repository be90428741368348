"""Healthy missions on slippery ground are not stopped; `benchmarks.safety.healthy_missions` drives 300."""

import pytest

from benchmarks.safety.missions import ROVERS, drive


@pytest.mark.parametrize(("rover", "seed"), [("robotino", 1005), ("robotino", 1015), ("el-dorado", 4)])
@pytest.mark.slow
def test_a_healthy_mission_on_slippery_ground_is_not_stopped(rover: str, seed: int) -> None:
    # Of twenty sites and eight slopes those on which gyro and wheels differ most.
    driven = drive(ROVERS[rover](seed), limit_s=25.0)
    assert [stop.output.reason for stop in driven.stops()] == []
    assert driven.moments[-1].t_s > 20.0
