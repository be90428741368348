"""Whole virtual runs with slip compensation: exact replay, honest flags, and no oscillation."""

from pathlib import Path

import pytest

from controllers.safety import Mode
from rover_hil.config import load_config
from rover_hil.run.driving import run_virtual
from rover_hil.tune.metrics import reversals_per_s
from rover_hil.tune.scenarios import with_scenario
from rover_hil.tune.simulated_mission import drive
from tests.rover_hil.test_virtual_run import records, replay_file, with_changes

CORRECTION = {"gain_rad_s_nm": 1.0, "bound_rad_s": 0.5}
REVERSAL_RAD_S = 0.5


@pytest.mark.parametrize(
    ("use", "correction"), [("yaw_probe", None), ("surfaces", None), ("linear_m", CORRECTION)]
)
def test_replay_is_exact(tmp_path: Path, use: str, correction: dict[str, object] | None) -> None:
    path = tmp_path / "run.mcap"
    config = with_changes("robotino", slip__use=use, slip__torque_correction=correction)
    result = run_virtual(config, path, 4.0, None)
    replayed = replay_file(path)
    assert replayed.cycles == result.cycles
    assert replayed.differences == []
    slips = [record["slip"] for record in records(path, "/estimate")]
    assert slips[-1]["map"] == use  # type: ignore[index]
    assert len(slips[-1]["wheels"]) == 3  # type: ignore[index]


def test_the_probe_brings_the_estimate_nearer_to_the_truth(tmp_path: Path) -> None:
    errors = {}
    for name, slip in (("without", None), ("with", load_config("robotino").slip)):
        path = tmp_path / f"{name}.mcap"
        run_virtual(load_config("robotino").model_copy(update={"slip": slip}), path, 6.0, None)
        estimate, truth = records(path, "/estimate")[-1]["estimate"], records(path, "/truth")[-1]
        assert isinstance(estimate, dict)
        errors[name] = abs(estimate["x_m"] - float(str(truth["x_m"])))
    assert errors["with"] < 0.5 * errors["without"]


def test_no_slip_is_told_once_the_wheels_are_silent(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    fault = {"type": "unplug", "device": "board", "start_s": 3.0, "duration_s": 2.0}
    run_virtual(with_changes("robotino", simulation__faults=[fault]), path, 4.5, None)
    told = [record["slip"] is not None for record in records(path, "/estimate")]
    assert told[round(2.9 * 50)]
    assert not any(told[round(3.4 * 50) : round(4.4 * 50)])


def rehearse(correction: dict[str, object] | None, site: int) -> tuple[Mode, float]:
    """Return the mode, and the reversals of the busiest wheel per second."""
    config = with_changes(
        "robotino", slip__use="linear_m", slip__unknown_ground="map", slip__torque_correction=correction
    )
    driven = drive(with_scenario(config, site))
    period_s = 1.0 / config.loop.rate_hz
    return driven.mode, reversals_per_s(driven.set_points_rad_s, period_s, REVERSAL_RAD_S)


@pytest.mark.parametrize("site", [1, 3])
@pytest.mark.slow
def test_the_torque_correction_is_stable_with_the_gain_and_bound_it_ships_with(site: int) -> None:
    plain_mode, plain = rehearse(None, site)
    mode, reversals = rehearse({}, site)
    assert plain_mode is mode is Mode.FINISHED
    assert reversals <= plain + 0.5  # two in the window of 4 s; an unstable one has four more


@pytest.mark.slow
def test_it_is_positive_feedback_that_only_the_bound_tames() -> None:
    _, tamed = rehearse({"gain_rad_s_nm": 50.0, "bound_rad_s": 0.1}, 1)
    _, wild = rehearse({"gain_rad_s_nm": 50.0, "bound_rad_s": 5.0}, 1)
    assert wild > tamed + 1.0
