"""A marker that sits askew on the rover looks like drift on all surfaces; the smooth table shows it."""

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
import pytest

from rover_hil.identify.slip.camera_scale import find_scale
from rover_hil.identify.slip.identification import identify_slip_maps
from rover_hil.identify.slip.report import result_record
from rover_hil.identify.slip.run_data import RunWindows
from rover_hil.identify.slip.surface_fit import fit_surface_map
from tests.rover_hil.identify.test_slip_fit import surface_runs, table_runs

MM_PER_PX = 2.0
ASKEW_RAD = math.radians(1.4)


def seen_askew(runs: Sequence[RunWindows], drift_rad: float) -> list[RunWindows]:
    """Return runs whose way is seen `drift_rad` further to the left."""
    cosine, sine = math.cos(drift_rad), math.sin(drift_rad)
    to_left = np.array([[cosine, sine, 0.0], [-sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    return [dataclasses.replace(run, camera_velocity=run.camera_velocity @ to_left) for run in runs]


def lawn_runs(drift_rad: float) -> list[RunWindows]:
    """Return runs in pixels on a lawn that makes the rover drift by itself."""
    pixels = np.array([1000.0 / MM_PER_PX, 1000.0 / MM_PER_PX, 1.0])
    rng = np.random.default_rng(1)
    return [
        dataclasses.replace(run, camera_velocity=run.camera_velocity * pixels, camera_in_pixels=True)
        for run in seen_askew(surface_runs("lawn", 0.6, 0.3, rng), drift_rad)
    ]


@pytest.mark.parametrize("askew_rad", [ASKEW_RAD, -0.05, 0.0])
def test_the_table_tells_how_askew_the_marker_is(askew_rad: float) -> None:
    scale = find_scale(seen_askew(table_runs(MM_PER_PX), askew_rad))
    assert scale.drift_rad == pytest.approx(askew_rad, abs=1e-6)
    assert f"{math.degrees(askew_rad):.1f} deg to the left" in scale.verdict


def test_what_is_left_is_the_drift_of_the_surface() -> None:
    runs = seen_askew([*table_runs(MM_PER_PX), *lawn_runs(0.1)], ASKEW_RAD)
    found = identify_slip_maps(runs, lambda: None)
    drift = {model.name: model.drift_rad for model in found.maps.surfaces.surfaces}
    for direction_rad in np.linspace(-3.0, 3.0, 13).tolist():
        assert drift["table_surface"].at(direction_rad, 0.2) == pytest.approx(0.0, abs=1e-3)
        assert drift["lawn"].at(direction_rad, 0.2) == pytest.approx(0.1, abs=5e-3)
    record = result_record(found, {}, [])
    assert record["camera_yaw_deg"] == pytest.approx(1.4, abs=1e-3)


def test_without_the_table_nothing_is_taken_off() -> None:
    scale = find_scale(lawn_runs(0.1))
    assert scale.drift_rad is None
    assert "to the left" not in scale.verdict
    (lawn,) = fit_surface_map(lawn_runs(0.1), MM_PER_PX / 1000.0).surfaces
    assert lawn.drift_rad.at(0.5, 0.2) == pytest.approx(0.1, abs=5e-3)


def test_another_camera_is_not_corrected() -> None:
    metres = [dataclasses.replace(run, camera_in_pixels=False) for run in lawn_runs(0.1)]
    (lawn,) = fit_surface_map(metres, MM_PER_PX / 1000.0, ASKEW_RAD).surfaces
    assert lawn.drift_rad.at(0.5, 0.2) == pytest.approx(0.1, abs=5e-3)


def test_where_the_rover_is_held_its_course_is_noise() -> None:
    runs = lawn_runs(0.0)
    rng = np.random.default_rng(2)
    for index in range(0, len(runs), 2):
        noise = rng.normal(0.0, 0.1, runs[index].camera_velocity.shape)  # pixels: the rover stands
        runs[index] = dataclasses.replace(runs[index], camera_velocity=noise)
    (lawn,) = fit_surface_map(runs, MM_PER_PX / 1000.0).surfaces
    for direction_rad in np.linspace(-3.0, 3.0, 13).tolist():
        assert lawn.drift_rad.at(direction_rad, 0.2) == pytest.approx(0.0, abs=0.02)
