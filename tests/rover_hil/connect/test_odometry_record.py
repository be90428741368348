"""The record that other programs get, against the truth of the simulated rover."""

import itertools
import math

import numpy as np
import pytest

from rover_hil.config import load_config
from rover_hil.connect.odometry_record import NO_COMPENSATION, OdometryRecorder
from rover_hil.connect.records import OdometryRecord
from rover_hil.recording.reader import LogReader
from rover_hil.recording.schema import (
    ESTIMATE,
    ESTIMATE_SHAPE,
    TRUTH,
    TRUTH_SHAPE,
    EstimateRecord,
    TruthRecord,
)
from rover_hil.run.driving import run_virtual

DRIVE_S = 12.0
ROBOTINO = load_config("robotino")


@pytest.fixture(scope="module")
def drive(
    tmp_path_factory: pytest.TempPathFactory,
) -> list[tuple[EstimateRecord, OdometryRecord, TruthRecord]]:
    path = tmp_path_factory.mktemp("records") / "run.mcap"
    config = load_config("robotino")
    run_virtual(config, path, DRIVE_S, None)
    log = LogReader(path)
    messages = list(log.messages())
    truth = {each.t_ns: log.parse(each, TRUTH_SHAPE) for each in messages if each.topic == TRUTH}
    recorder = OdometryRecorder(config.filter, config.ground)
    found = []
    for each in messages:
        if each.topic == ESTIMATE:
            cycle = log.parse(each, ESTIMATE_SHAPE)
            record = recorder.record(log.wall_offset_ns, cycle)
            if record is not None:
                found.append((cycle, record, truth[each.t_ns]))
    return found


def test_the_variance_of_the_velocity_is_that_of_its_errors(
    drive: list[tuple[EstimateRecord, OdometryRecord, TruthRecord]],
) -> None:
    scaled = []
    for _, record, true in drive:
        if record["mode"] == "running":
            errors = (
                record["velocity_x_m_s"] - true["velocity_x_m_s"],
                record["velocity_y_m_s"] - true["velocity_y_m_s"],
                record["yaw_rate_rad_s"] - true["yaw_rate_rad_s"],
            )
            scaled.append(np.array(errors) / np.sqrt(record["velocity_variance"]))
    assert len(scaled) > 300
    root = np.sqrt(np.mean(np.square(scaled), axis=0))
    # A variance of zero, or one that is too large by a factor of 100, would fail.
    assert all(0.1 < each < 1.5 for each in root), root


def test_stamps_grow_and_are_those_of_the_wheels(
    drive: list[tuple[EstimateRecord, OdometryRecord, TruthRecord]],
) -> None:
    stamps = [record["time_ns"] for _, record, _ in drive]
    assert all(later > earlier for earlier, later in itertools.pairwise(stamps))
    offsets = {record["time_ns"] - cycle["estimate"]["t_ns"] for cycle, record, _ in drive}
    assert len(offsets) == 1


def test_an_estimate_that_is_not_newer_or_not_finite_gives_no_record(
    drive: list[tuple[EstimateRecord, OdometryRecord, TruthRecord]],
) -> None:
    recorder = OdometryRecorder(ROBOTINO.filter, ROBOTINO.ground)
    first, second = drive[100][0], drive[101][0]
    assert recorder.record(0, first) is not None
    assert recorder.record(0, first) is None
    broken: EstimateRecord = {**second, "estimate": {**second["estimate"], "yaw_rad": math.nan}}
    assert recorder.record(0, broken) is None


def test_slip_that_is_not_valid_widens_the_velocity_and_says_why(
    drive: list[tuple[EstimateRecord, OdometryRecord, TruthRecord]],
) -> None:
    pairs = [(cycle, record) for cycle, record, _ in drive if record["slip"] is not None]
    cycle, record = pairs[-1]
    assert record["slip_reason"] == ""
    recorder = OdometryRecorder(ROBOTINO.filter, ROBOTINO.ground)
    before: EstimateRecord = {
        **cycle,
        "estimate": {**cycle["estimate"], "t_ns": cycle["estimate"]["t_ns"] - 20_000_000},
    }
    before["odometry"] = {**cycle["odometry"], "x_m": cycle["odometry"]["x_m"] - 0.003}
    without: EstimateRecord = {**cycle, "slip": None}
    recorder.record(0, before)
    wide = recorder.record(0, without)
    assert wide is not None
    assert (wide["slip"], wide["slip_reason"]) == (None, NO_COMPENSATION)
    assert wide["velocity_variance"][0] > (0.3 * 0.15) ** 2
