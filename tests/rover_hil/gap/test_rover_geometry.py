"""Geometry that a configuration lacks: steering ratio, centre of rotation, place of the marker."""

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.gap.measured_rovers import config_text
from benchmarks.gap.measured_rovers import write_log as write_measured_log
from rover_hil.config import Config, load_config
from rover_hil.gap.data.rover_logs import read_rover_runs
from rover_hil.gap.verdict import Verdict
from rover_hil.gap.workflow import analyse
from sim_backends.plants.wheels.settings import WheelsPlantSettings
from sim_backends.wheels_model.model import WheelsModel
from tests.nature.differential_drive import Recorded, TrueDifferential, record
from tests.rover_hil.gap.test_rover_of_wheels import DIFFERENTIAL, LOGS, ROOT, tricycle_run, write_log


@pytest.fixture(autouse=True)
def _in_the_project(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)


def verdict_on(config: Config, runs: Path) -> Verdict:
    settings = config.require_simulation().plant
    assert isinstance(settings, WheelsPlantSettings)
    model = WheelsModel(settings)
    return analyse(model, read_rover_runs(model, [runs])).verdict


def interval(verdict: Verdict, effect: str) -> tuple[float, float]:
    """Return the interval of the strength of an effect that was found."""
    found = next(one for one in verdict.effects if one.name == effect)
    return next(iter(found.parameters.values())).ci95


@pytest.mark.slow
def test_a_steering_ratio_is_named_with_its_size(tmp_path: Path) -> None:
    rng = np.random.default_rng(7)
    config = tmp_path / "tricycle.toml"
    config.write_text(config_text("tricyc"), "utf-8")
    rover = load_config(str(config))
    for number in range(LOGS):
        run = tricycle_run(rng, float(rng.uniform(0.3, 0.7)), 0.0, ratio=1.15)
        write_measured_log(tmp_path / "runs" / f"{number}" / "run.mcap", rover, run, "tricyc")
    verdict = verdict_on(rover, tmp_path / "runs")
    assert any("steering_ratio" in one for one in verdict.confidence_set), verdict.sentence
    low, high = interval(verdict, "steering_ratio")
    assert low < 0.15 < high, verdict.sentence
    assert high - low < 0.1


def skidding_config() -> Config:
    """Return the example of four wheels, with tyres in place of the rollers."""
    table: dict[str, Any] = load_config("docs/examples/mecanum.toml").model_dump(by_alias=True)
    for wheel in (*table["rover"]["wheels"], *table["simulation"]["plant"]["wheels"]):
        wheel["roller_deg"] = None
    table["mission"]["heading"] = "along_path"
    return Config.model_validate(table)


def skid(rng: np.random.Generator, ahead_m: float) -> Recorded:
    """Return a drive on four tyres whose forces are proportional to their slip in every direction.

    Their balance gives the turn; the centre of it lies on the line across the rover this far ahead. Drives
    start in all directions: from one alone, what is lost in turns looks like a slope.
    """
    radius_m, ahead_wheel_m, aside_wheel_m, step_s = 0.05, 0.2, 0.15, 0.001
    t_s = step_s * np.arange(20_000.0)
    mean = 4.0 + 1.0 * np.sin(0.5 * t_s + rng.uniform(0.0, 6.0))
    apart = 1.2 * np.sin(0.4 * t_s + rng.uniform(0.0, 6.0))
    turn = radius_m * apart * aside_wheel_m / (ahead_wheel_m**2 + aside_wheel_m**2)
    yaw = np.concatenate(([0.0], np.cumsum(0.5 * (turn[1:] + turn[:-1]) * step_s))) + rng.uniform(-3.0, 3.0)
    speed = (radius_m * mean - 1j * ahead_m * turn) * np.exp(1j * yaw)
    place = np.concatenate(([0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * step_s)))
    sides = np.stack((mean - apart, mean + apart), axis=1)
    angles = np.cumsum(np.tile(sides, 2) * step_s, axis=0)
    pose = np.stack((place.real, place.imag, yaw), axis=1)
    rows = slice(None, None, 20)
    noise = rng.standard_normal((t_s[rows].size, 4)) * (0.0003, 0.0003, 0.0005, 0.002)
    return Recorded(
        t_s=t_s[rows],
        wheels_rad=angles[rows],
        gyro_rad_s=turn[rows] + noise[:, 3],
        pose=pose[rows] + noise[:, :3],
    )


@pytest.mark.slow
def test_a_centre_of_rotation_ahead_of_the_wheels_is_named_with_its_size(tmp_path: Path) -> None:
    rng, config = np.random.default_rng(11), skidding_config()
    for number in range(LOGS):
        write_log(tmp_path / "runs" / f"{number}" / "run.mcap", skid(rng, 0.08), "truth", config)
    verdict = verdict_on(config, tmp_path / "runs")
    assert verdict.confidence_set[0] == ["rotation_centre"], verdict.sentence
    low, high = interval(verdict, "rotation_centre")
    assert low < 0.08 < high, verdict.sentence
    assert high - low < 0.03


def displaced(drive: Recorded, marker: Mapping[str, float]) -> Recorded:
    """Return a drive as a marker at this place and yaw on the rover shows it."""
    x_m, y_m, yaw = drive.pose.T
    ahead_m, aside_m = marker["marker_x_m"], marker["marker_y_m"]
    cosine, sine = np.cos(yaw), np.sin(yaw)
    x_m = x_m + cosine * ahead_m - sine * aside_m
    y_m = y_m + sine * ahead_m + cosine * aside_m
    return replace(drive, pose=np.stack((x_m, y_m, yaw + marker["marker_yaw_rad"]), axis=1))


@pytest.mark.slow
def test_a_displaced_marker_is_told_with_its_place_and_yaw(tmp_path: Path) -> None:
    marker = {"marker_x_m": 0.06, "marker_y_m": -0.04, "marker_yaw_rad": math.radians(6.0)}
    rng = np.random.default_rng(5)
    for number in range(LOGS):
        drive = displaced(record(TrueDifferential(), rng), marker)
        write_log(tmp_path / "runs" / f"{number}" / "run.mcap", drive, "truth")
    verdict = verdict_on(load_config(DIFFERENTIAL), tmp_path / "runs")
    found = {one.name: one for one in verdict.base_parameters}
    assert not verdict.effects, verdict.sentence
    for name, value in marker.items():
        low, high = found[name].ci95
        assert low < value < high, (name, found[name])
        assert found[name].is_named, (name, found[name])
        assert name in verdict.sentence
