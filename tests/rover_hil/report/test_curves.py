"""Curves for pages on which one can zoom: nothing lost that matters, and small."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rover_hil.report.curves import CHARTS, MOST_POINTS, run_curves, viewer_data
from rover_hil.report.read_run import read_run
from rover_hil.report.run_data import EstimatedSlip, RunData, SlipData, WheelData
from rover_hil.report.thinning import visible_spans
from rover_hil.report.tracks import Series
from tests.rover_hil.report.test_read_run import Drive, write_log

HOUR_S = 3600.0


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> RunData:
    path = tmp_path_factory.mktemp("curves") / "run.mcap"
    return read_run(write_log(path, Drive(stop=(4.0, 6.0))))


def test_ways_carry_the_time_of_each_point_and_charts_their_units(run: RunData) -> None:
    curves = run_curves(run, "one")
    assert [way["name"] for way in curves["paths"]] == ["encoders", "truth", "estimate"]
    for way in curves["paths"]:
        assert len(way["t"]) == len(way["x"]) == len(way["y"]) > 10
        assert way["t"] == sorted(way["t"])
    assert curves["paths"][2]["x"][-1] == pytest.approx(run.estimate.x_m[-1], abs=1e-4)
    assert set(curves["charts"]) <= set(CHARTS)
    (stop,) = curves["stops"]
    assert stop == pytest.approx((4.0, 6.0), abs=0.1)
    yaw = next(curve for curve in curves["charts"]["headings"] if curve["name"] == "estimate")
    assert yaw["y"][-1] == pytest.approx(np.degrees(run.estimate.yaw_rad[-1]), rel=1e-3, abs=1e-6)


def test_without_truth_there_is_no_distance_from_it(tmp_path: Path) -> None:
    blind = read_run(write_log(tmp_path / "run.mcap", Drive(has_truth=False, duration_s=6.0)))
    curves = run_curves(blind, "one")
    assert "error" not in curves["charts"]
    assert [way["name"] for way in curves["paths"]] == ["encoders", "estimate"]


def test_slip_that_is_not_valid_is_left_out(run: RunData) -> None:
    t_s = np.arange(6.0)
    slip = Series(t_s, np.full(6, 0.25))
    reasons = ["", "", "surface not recognised", "", "", ""]
    estimated = EstimatedSlip(slip=slip, paper_torque_nm=slip, wheel_torque_nm=slip, reasons=reasons)
    data = SlipData(map="m", t_s=t_s, surfaces=[""] * 6, wheels=[estimated] * len(run.wheels))
    wheel, *_ = run_curves(replace(run, slip=data, drift=None), "one")["charts"]["slip"]
    assert wheel["y"] == [25.0, 25.0, None, 25.0, 25.0, 25.0]


def test_an_hour_of_six_wheels_keeps_its_peaks_and_stays_small(run: RunData) -> None:
    t_s = np.arange(0.0, HOUR_S, 0.02)
    noise = np.random.default_rng(3).normal(0.0, 1.0, len(t_s))
    noise[90_001] = 40.0
    series = Series(t_s, noise)
    wheels = [
        WheelData(
            name=f"wheel {n}", set_point=series, speed=series, current=series, slip=None, true_speed=None
        )
        for n in range(6)
    ]
    curves = run_curves(replace(run, wheels=wheels, slip=None, drift=None), "long")
    assert max(value for value in curves["charts"]["currents"][3]["y"] if value is not None) == 40.0
    points = sum(len(curve["x"]) for chart in curves["charts"].values() for curve in chart)
    assert 0.3 * MOST_POINTS < points < 1.3 * MOST_POINTS
    assert len(json.dumps(viewer_data([curves]))) < 2_000_000


def test_spans_that_cannot_be_told_apart_are_drawn_as_one() -> None:
    t_s = np.linspace(0.0, 1199.98, 60_000)
    flicker = ["x" if index % 3 else "" for index in range(30_000)] + [""] * 30_000
    assert visible_spans(t_s, flicker) == [pytest.approx((0.02, 600.0))]
    assert visible_spans(t_s, ["x"] * 100 + [""] * 30_000 + ["x"] * 29_900) == [
        pytest.approx((0.0, 2.0)),
        pytest.approx((602.0, 1199.98)),
    ]


def test_numbers_that_are_not_finite_never_reach_the_page(run: RunData) -> None:
    speed = Series(np.arange(4.0), np.array([1.0, np.inf, np.nan, -np.inf]))
    odd = replace(run, duration_s=float("inf"), computed={"cross_track_m": speed})
    page = viewer_data([run_curves(odd, "odd")])
    assert json.loads(json.dumps(page, allow_nan=False))["runs"][0]["charts"]["beside"][0]["y"] == [
        1000.0,
        None,
        None,
        None,
    ]
