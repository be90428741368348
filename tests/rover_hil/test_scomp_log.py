"""Slip-compensated odometry of our own logs."""

import json
from pathlib import Path

import numpy as np
import pytest

from controllers.slip.scomp.parameters import ScompParameters
from drivers.errors import LogError
from rover_hil.drives.drive import read_drive
from rover_hil.recording.reader import LogReader
from rover_hil.scomp.drive import SensorRows
from rover_hil.scomp.files import geometry_of, log_rows
from rover_hil.scomp.odometry import estimate_track
from tests.rover_hil.conftest import EL_DORADO_S


@pytest.fixture(scope="module")
def log(el_dorado_log: Path) -> Path:
    """A drive of the simulated four-wheel rover up a slope, with a mound on its left."""
    return el_dorado_log


def truths(path: Path) -> dict[str, np.ndarray]:
    names = ("t_ns", "x_m", "y_m", "yaw_rad", "pitch_rad", "roll_rad")
    records = [
        json.loads(message.data) for message in LogReader(path).messages() if message.topic == "/truth"
    ]
    return {name: np.array([record[name] for record in records], dtype=float) for name in names}


def at_rows(path: Path, rows: SensorRows, name: str) -> np.ndarray:
    truth = truths(path)
    t_s = (truth["t_ns"] - LogReader(path).start_ns) / 1e9
    at: np.ndarray = np.interp(rows.t_s, t_s, truth[name])
    return at


def test_sensors_come_in_the_units_of_the_csv(log: Path) -> None:
    recorded = read_drive(log, with_traces=True)
    drive, _ = log_rows(recorded)
    assert geometry_of(recorded.config, log).wheel_radius_m == 0.092
    assert drive.pitch_rad is not None
    assert drive.roll_rad is not None
    assert drive.gyro_rad_s is not None
    assert drive.compass_rad is not None
    # The house counts a lowered nose as positive, the CSV a raised one: this rover climbs.
    assert float(drive.pitch_rad.mean()) > 0.05
    assert drive.pitch_rad == pytest.approx(-at_rows(log, drive, "pitch_rad"), abs=0.03)
    assert drive.roll_rad == pytest.approx(at_rows(log, drive, "roll_rad"), abs=0.03)
    new = np.isfinite(drive.compass_rad)
    assert 0.05 < new.mean() < 0.2
    assert drive.trace_rad is not None
    assert 10 < np.isfinite(drive.trace_rad).sum() < 5 * EL_DORADO_S
    off = drive.compass_rad[new] - at_rows(log, drive, "yaw_rad")[new]
    assert np.degrees(np.std(off)) < 1.5


def test_the_path_counts_the_slip(log: Path) -> None:
    recorded = read_drive(log, with_traces=True)
    drive, _ = log_rows(recorded)
    result = estimate_track(drive, ScompParameters(rover=geometry_of(recorded.config, log)))
    x_m = at_rows(log, drive, "x_m")
    rolled_m = 0.092 * float(drive.wheel_rad[-1])
    assert abs(result.track.x_m[-1] - x_m[-1]) < 2.5 * result.track.sigma_x_m[-1]
    assert result.track.x_m[-1] < 0.95 * rolled_m
    assert result.notes == ()
    assert any(innovation.name == "trace" for innovation in result.innovations)


def test_a_rover_with_three_wheels_has_no_trace_to_follow(robotino_log: Path) -> None:
    with pytest.raises(LogError, match="four wheels"):
        log_rows(read_drive(robotino_log))
