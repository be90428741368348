"""Geometry that a configuration lacks: steering ratio, centre of rotation, place of the marker."""

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.gap.drive_logs import write_log
from benchmarks.gap.third_party_rovers import DRIVINGS, Hidden, configurations
from benchmarks.gap.third_party_rovers import verdict_on as verdict_on_third_party
from benchmarks.gap.tricycle import write_config, write_drive
from rover_hil.config import Config, load_config
from rover_hil.gap.data.rover_logs import read_rover_runs
from rover_hil.gap.verdict import Verdict
from rover_hil.gap.workflow import analyse
from sim_backends.plants.wheels.settings import WheelsPlantSettings
from sim_backends.wheels_model.model import WheelsModel
from tests.nature.differential_drive import Recorded, TrueDifferential, record
from tests.rover_hil.gap.test_rover_of_wheels import DIFFERENTIAL, LOGS, ROOT, tricycle_run

pytestmark = pytest.mark.timeout(600)
"""A search among pairs of effects takes half a minute of one free processor."""


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
    rover = write_config(tmp_path / "tricycle.toml")
    for number in range(LOGS):
        run = tricycle_run(rng, float(rng.uniform(0.3, 0.7)), 0.0, ratio=1.15)
        write_drive(tmp_path / "runs" / f"{number}" / "run.mcap", rover, run)
    verdict = verdict_on(rover, tmp_path / "runs")
    assert any("steering_ratio" in one for one in verdict.confidence_set), verdict.sentence
    low, high = interval(verdict, "steering_ratio")
    assert low < 0.15 < high, verdict.sentence
    assert high - low < 0.1


@pytest.mark.nightly
def test_a_centre_of_rotation_ahead_of_the_wheels_is_named_with_its_size() -> None:
    ahead = Hidden(name="rotation_centre", changes={"ahead_m": 0.08})
    verdict = verdict_on_third_party(configurations()["four_fixed"], ahead, DRIVINGS["all headings"], seed=11)
    assert verdict.confidence_set == [["rotation_centre"]], verdict.sentence
    low, high = interval(verdict, "rotation_centre")
    assert low < 0.08 < high, verdict.sentence
    assert high - low < 0.03


@pytest.mark.slow
def test_ground_without_resistance_is_not_named_a_slope_where_all_drives_head_one_way() -> None:
    """A slope along the only heading explains as much as the resistance that is not there."""
    smooth = Hidden(name="rolling_resistance", changes={"ahead_m": 0.08, "rolling": 0.0, "friction": 1e3})
    verdict = verdict_on_third_party(configurations()["four_fixed"], smooth, DRIVINGS["one heading"], seed=11)
    assert ["rolling_resistance", "rotation_centre"] in verdict.confidence_set, verdict.sentence


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
    rng, config = np.random.default_rng(5), load_config(DIFFERENTIAL)
    for number in range(LOGS):
        drive = displaced(record(TrueDifferential(), rng), marker)
        write_log(tmp_path / "runs" / f"{number}" / "run.mcap", config, drive)
    verdict = verdict_on(config, tmp_path / "runs")
    found = {one.name: one for one in verdict.base_parameters}
    assert not verdict.effects, verdict.sentence
    for name, value in marker.items():
        low, high = found[name].ci95
        assert low < value < high, (name, found[name])
        assert found[name].is_named, (name, found[name])
        assert name in verdict.sentence
