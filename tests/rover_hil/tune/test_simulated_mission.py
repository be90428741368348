"""Measures of a drive, random scenarios, and missions on the simulated rover."""

import math
from pathlib import Path

import numpy as np
import pytest

from rover_hil.config import Config, load_config
from rover_hil.config.tune_settings import MOST_CASES, CaseSettings
from rover_hil.recording.reader import LogReader
from rover_hil.report.tracks import Track
from rover_hil.run.driving import run_virtual
from rover_hil.tune.metrics import (
    TruePath,
    closure_m,
    effort_rad_s2,
    heading_rms_rad,
    path_rms_m,
    reversals_per_s,
)
from rover_hil.tune.scenarios import held_out_seeds, ranking_seeds, train_seeds, with_scenario
from rover_hil.tune.simulated_mission import simulate_mission
from tests.rover_hil.tune.tuning import TUNE, make_config

SQUARE = ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0), (0.0, 0.0))
PERIOD_S = 0.02


def way_through(*points: tuple[float, float], yaw_rad: float = 0.0) -> TruePath:
    rows = [(float(index), x_m, y_m, yaw_rad) for index, (x_m, y_m) in enumerate(points)]
    return TruePath.of(Track.of(np.array(rows, dtype=np.float64)))


def with_plant(config: Config, **changes: object) -> Config:
    assert config.simulation is not None
    plant = config.simulation.plant.model_copy(update=changes)
    return config.model_copy(update={"simulation": config.simulation.model_copy(update={"plant": plant})})


def last_truth(log: Path) -> dict[str, float]:
    truth = [message.json() for message in LogReader(log).messages() if message.topic == "/truth"][-1]
    assert isinstance(truth, dict)
    return truth


def test_the_path_itself_has_no_error() -> None:
    true_path = way_through(*SQUARE)
    assert path_rms_m(true_path, SQUARE) < 1e-9
    assert closure_m(true_path, SQUARE) == 0.0
    assert len(true_path.x_m) == 401


def test_a_shifted_line_is_off_by_the_shift() -> None:
    line = ((0.0, 0.0), (10.0, 0.0))
    assert path_rms_m(way_through((0.0, 0.03), (10.0, 0.03)), line) == pytest.approx(0.03, rel=1e-6)


def test_half_of_the_path_is_not_the_path() -> None:
    # Commanded points up to 1 m beyond the end: mean square 1/3 over half of the path, half of the weight.
    true_path = way_through((0.0, 0.0), (1.0, 0.0))
    assert path_rms_m(true_path, ((0.0, 0.0), (2.0, 0.0))) == pytest.approx(
        math.sqrt(0.5 * 0.5 / 3.0), rel=0.01
    )
    assert closure_m(true_path, ((0.0, 0.0), (2.0, 0.0))) == pytest.approx(1.0)


def test_a_rover_that_never_moved_has_measures_too() -> None:
    true_path = way_through((0.0, 0.0), (0.0, 0.0))
    assert path_rms_m(true_path, SQUARE) > 0.4
    assert heading_rms_rad(true_path, SQUARE, along_path=False) == 0.0
    assert effort_rad_s2(np.array([]), PERIOD_S) == 0.0
    assert reversals_per_s(np.array([]), PERIOD_S, 0.5) == 0.0


def test_heading_is_against_the_start_or_against_the_line() -> None:
    true_path = way_through((0.0, 0.0), (0.0, 1.0), yaw_rad=math.pi / 2 - 0.1 + math.tau)
    line = ((0.0, 0.0), (0.0, 1.0))
    assert heading_rms_rad(true_path, line, along_path=True) == pytest.approx(0.1)
    assert heading_rms_rad(true_path, line, along_path=False) == pytest.approx(math.pi / 2 - 0.1)


def test_effort_does_not_depend_on_the_rate() -> None:
    for period_s in (0.01, 0.05):
        ramp = np.arange(0.0, 2.0, period_s)[:, np.newaxis] * [3.0, -3.0]
        assert effort_rad_s2(ramp, period_s) == pytest.approx(3.0)


@pytest.mark.parametrize(
    ("frequency_hz", "amplitude_rad_s", "expected"), [(1.0, 0.4, 2.0), (0.5, 3.0, 1.0), (2.0, 0.2, 0.0)]
)
def test_a_limit_cycle_turns_round_twice_per_period(
    frequency_hz: float, amplitude_rad_s: float, expected: float
) -> None:
    t_s = np.arange(0.0, 12.0, PERIOD_S)
    calm = 3.0 + 0.0 * t_s
    shaking = calm + amplitude_rad_s * np.sin(math.tau * frequency_hz * t_s)
    found = reversals_per_s(np.column_stack((calm, shaking)), PERIOD_S, 0.5)
    assert found == pytest.approx(expected, abs=0.26)


def test_short_oscillation_is_found_in_a_long_calm_drive() -> None:
    t_s = np.arange(0.0, 100.0, PERIOD_S)
    speed = np.where((t_s > 50.0) & (t_s < 54.0), np.sin(math.tau * 2.0 * t_s), 0.0)
    assert reversals_per_s(speed[:, np.newaxis], PERIOD_S, 0.5) == pytest.approx(4.0, abs=0.3)


def test_seeds_of_search_ranking_and_comparison_never_overlap() -> None:
    most = CaseSettings(train=MOST_CASES, ranking=MOST_CASES, held_out=MOST_CASES)
    all_seeds = [*train_seeds(most), *ranking_seeds(most), *held_out_seeds(most)]
    assert len(set(all_seeds)) == len(all_seeds) == 3 * MOST_CASES
    with pytest.raises(ValueError, match="less than or equal"):
        CaseSettings(train=MOST_CASES + 1)


def test_a_site_is_the_same_for_the_same_seed_and_other_ground_for_another(tmp_path: Path) -> None:
    config = make_config(tmp_path)
    first, again, other = (with_scenario(config, seed).simulation for seed in (1, 1, 2))
    assert first == again
    assert first is not None
    assert other is not None
    assert first.plant != other.plant
    assert (first.seed, other.seed) == (1, 2)
    assert config == make_config(tmp_path)


def test_missions_repeat_and_differ_between_scenarios(tmp_path: Path) -> None:
    config = make_config(tmp_path)
    first, again, other = (simulate_mission(config, seed) for seed in (1, 1, 2))
    assert first.refused == ""
    assert first.terms == again.terms
    assert first.terms["path_rms_m"] != other.terms["path_rms_m"]


def test_a_simulated_mission_is_the_run_that_the_log_would_hold(tmp_path: Path) -> None:
    config = make_config(tmp_path)
    run_virtual(with_scenario(config, 5), tmp_path / "run.mcap", 60.0, None)
    truth = last_truth(tmp_path / "run.mcap")
    true_path = simulate_mission(config, 5).true_path
    logged = truth["x_m"], truth["y_m"]
    assert (true_path.x_m[-1], true_path.y_m[-1]) == pytest.approx(logged, abs=6e-8)  # the digits of a log


def test_cameras_without_a_role_change_only_the_steps_of_the_integration(tmp_path: Path) -> None:
    mission = {"type": "line", "length_m": 0.1, "heading": "along_path"}
    table = load_config("el-dorado").model_dump(by_alias=True)
    table["mission"] = mission
    table["scomp"] = table["roles"]["camera"] = None
    table["tune"] = make_config(tmp_path).model_dump(by_alias=True)["tune"]
    config = Config.model_validate(table)
    slim = with_scenario(config, 3)
    assert set(config.devices) - set(slim.devices) == {"camera"}
    full = slim.model_copy(update={"devices": config.devices})
    ends = []
    for name, each in (("slim", slim), ("full", full)):
        run_virtual(each, tmp_path / name, 60.0, None)
        ends.append(last_truth(tmp_path / name))
    assert ends[0]["t_ns"] == ends[1]["t_ns"]
    for key in ("x_m", "y_m", "yaw_rad"):
        assert ends[0][key] == pytest.approx(ends[1][key], abs=2e-4)
        assert ends[0][key] != 0.0


def test_the_camera_that_sees_the_trace_stays(tmp_path: Path) -> None:
    table = load_config("el-dorado").model_dump(by_alias=True)
    table["tune"] = make_config(tmp_path).model_dump(by_alias=True)["tune"]
    assert "camera" in with_scenario(Config.model_validate(table), 3).devices


def test_unstable_gains_are_refused(tmp_path: Path) -> None:
    calm = make_config(tmp_path, TUNE, MISSION_FAST)
    wild = make_config(tmp_path, TUNE, MISSION_FAST.replace("lookahead_m = 0.2", "lookahead_m = 0.02"))
    assert simulate_mission(calm, 1).refused == ""
    assert "a wheel setpoint reversed" in simulate_mission(wild, 1).refused


def test_an_unfinished_mission_is_refused(tmp_path: Path) -> None:
    config = make_config(tmp_path)
    late = config.model_copy(update={"loop": config.loop.model_copy(update={"time_limit_s": 2.0})})
    assert simulate_mission(late, 1).refused == "the mission was not finished: mode 'running' after 2 s"
    walled = with_plant(config, bumper_x_m=0.05)
    assert "emergency stop" in simulate_mission(walled, 1).refused


MISSION_FAST = """
[mission]
type = "rectangle"
length_m = 0.9
width_m = 0.4
speed_m_s = 0.35
lookahead_m = 0.2
"""
