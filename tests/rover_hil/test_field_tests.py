"""A short drive through the benchmark of the field tests: plant, pictures, trace, odometries, steering."""

import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.four_wheels import field_drives
from benchmarks.four_wheels.field_crab import crab_drive, distances
from benchmarks.four_wheels.field_drives import (
    SIDEWAYS,
    FieldDrive,
    Rover,
    compass_error_deg,
    draw_rover,
    field_drive,
)
from benchmarks.four_wheels.field_pictures import draw_test
from benchmarks.four_wheels.field_tests import ODOMETRIES, path_of, score, see, trace_quality, with_traces
from controllers.slip.scomp.parameters import ScompParameters
from rover_hil.scomp.columns import drive_of
from sim_backends.plants.el_dorado.plant import table_of
from sim_backends.plants.el_dorado.settings import ElDoradoPlantSettings
from tests.cases import first_often

SEED = 3
SHORT = replace(SIDEWAYS, way_m=0.45)


@pytest.fixture(scope="module")
def rover() -> Iterator[Rover]:
    """A rover on the library's sand, whose forces other tests have computed already."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(field_drives, "build_table", lambda *_: table_of(ElDoradoPlantSettings()))
        yield draw_rover(SEED)


@pytest.fixture(scope="module")
def recorded(rover: Rover) -> FieldDrive:
    return field_drive(rover, SHORT, SEED)


def test_the_log_tells_what_the_sensors_make_of_the_drive(rover: Rover, recorded: FieldDrive) -> None:
    log, truth = recorded.log, recorded.truth
    assert set(map(len, log.values())) == set(map(len, truth.values()))
    way_m = float(np.hypot(np.diff(truth["x_m"]), np.diff(truth["y_m"])).sum())
    assert way_m == pytest.approx(SHORT.way_m, abs=0.01)
    turned_m = 0.092 * float(np.mean([log[f"position{wheel}_rad"][-1] for wheel in (1, 2, 3, 4)]))
    drives = truth["t_s"] > 4.0
    # Rising 5 deg, the wheels turn further than the rover moves, and the sensors are off by their biases.
    assert 1.05 < turned_m / way_m < 1.4
    assert float(truth["slip"][drives].mean()) == pytest.approx(1.0 - way_m / turned_m, abs=0.05)
    tilt_deg = SHORT.inclination_deg + rover.tilt_bias_deg[0]
    assert float(np.mean(log["pitch_deg"])) == pytest.approx(tilt_deg, abs=0.7)
    compass_deg = compass_error_deg(0.0, rover)
    assert float(np.mean(log["heading_deg"])) == pytest.approx(compass_deg, abs=0.3)
    assert abs(compass_deg) > 0.01


def test_frames_traces_and_odometries(recorded: FieldDrive, tmp_path: Path) -> None:
    traces = see(recorded, "fused")
    frames = len(recorded.sequence.truth)
    assert len(traces.theta_deg) == frames == math.ceil(len(recorded.log["t_s"]) / 4)
    assert traces.last_image.shape == (480, 640, 3)
    quality = trace_quality(recorded, traces)
    assert quality["rms_deg"] < 3.0
    assert 0.0 <= quality["missed_share"] < 0.5
    columns = with_traces(recorded.log, traces)
    assert columns["beta_new"].sum() == frames
    drive, _ = drive_of(columns, "simulated")
    assert drive.trace_rad is not None
    assert np.isfinite(drive.trace_rad).sum() == traces.detected.sum()
    tracks = {name: run(drive, ScompParameters()) for name, run in ODOMETRIES.items()}
    scores = {name: score(track, recorded.truth, path_of(recorded)) for name, track in tracks.items()}
    assert scores["ours"]["final_m"] < scores["plain"]["final_m"]
    assert scores["plain"]["slip"] > 0.1
    draw_test(tracks, recorded.truth, tmp_path / "test.png")
    assert (tmp_path / "test.png").stat().st_size > 20_000


@pytest.mark.parametrize("driver", first_often(["heading only", "crab"]))
def test_a_steered_rover_reaches_the_end_of_its_line(rover: Rover, driver: str) -> None:
    way = crab_drive(rover, SHORT, SEED, driver, ScompParameters())  # type: ignore[arg-type]
    assert way[-1, 0] == pytest.approx(SHORT.way_m, abs=0.05)
    assert distances(way)["rms_m"] < 0.05


def test_distances_count_along_the_line() -> None:
    way = np.array([(0.0, 0.0), (1.0, 0.3), (1.01, 0.3), (2.0, 0.0)])
    found = distances(way)
    assert found["final_m"] == 0.0
    assert found["rms_m"] == pytest.approx(0.3 / math.sqrt(3.0), rel=0.02)
