"""A drive of another author: on ground that takes no print the imprints of the wheels are parted by 8 cm."""

import csv
from pathlib import Path

import cv2
import numpy as np
import pytest

from controllers.ftrace.estimator import TraceAngle, TraceEstimator
from controllers.ground_motion.rig import RigFile
from drivers.clock import nanoseconds
from rover_hil.ftrace.telemetry import read_telemetry


@pytest.fixture(scope="module")
def folder(shared_data: Path) -> Path:
    """Return the drive, or skip."""
    folder = shared_data / "trace_drives/dropout_104"
    if not folder.is_dir():
        pytest.skip("trace drives not found in ../shared/data")
    return folder


@pytest.fixture(scope="module")
def angles(folder: Path) -> list[TraceAngle]:
    rig = RigFile.model_validate_json((folder / "rig.json").read_text("utf-8"))
    estimator = TraceEstimator(rig.geometry())
    frames = sorted((folder / "frames").iterdir())
    return [
        estimator.step(
            nanoseconds(row.t_s),
            np.asarray(cv2.imread(str(frame), cv2.IMREAD_GRAYSCALE), np.uint8),
            wheel_speed_m_s=row.wheel_speed_m_s,
            rates_rad_s=row.rates_rad_s,
        )
        for frame, row in zip(frames, read_telemetry(folder / "telemetry.csv").values(), strict=True)
    ]


@pytest.fixture(scope="module")
def truth_deg(folder: Path) -> list[float]:
    with (folder / "truth.csv").open(encoding="utf-8", newline="") as file:
        return [float(row["theta_t_deg"]) for row in csv.DictReader(file)]


def test_the_angle_is_right_where_one_edge_lies_in_the_front_wheels_imprint(
    angles: list[TraceAngle], truth_deg: list[float]
) -> None:
    """The evidence of this faint trace is no stronger than that of some bare ground: it is not reported."""
    parted = range(88, 98)

    assert {angles[place].source for place in parted} <= {"trace", "flow"}
    assert max(abs(angles[place].theta_deg - truth_deg[place]) for place in parted) < 1.0
    assert not any(angle.detected for angle in angles[17:66])


def test_no_angle_is_held_before_one_was_seen(angles: list[TraceAngle]) -> None:
    """What looks like a trace in the first frame may be a shadow."""
    first = angles[0]

    assert (first.source, first.detected, first.theta_rad) == ("none", False, None)
