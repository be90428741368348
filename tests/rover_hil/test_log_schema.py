"""The records of a log: their names stay when the controllers rename things, and old logs stay readable."""

import json
import math
from dataclasses import fields, replace
from pathlib import Path

import pytest
from pydantic_core import to_json

from controllers.control_loop import StepOutput
from controllers.estimation.dead_reckoning import DeadReckoned
from controllers.estimation.filter.guarded_filter import Innovation, Outcome
from controllers.estimation.filter.measurement_model import Measured
from controllers.estimation.ground.travel import GroundReport
from controllers.estimation.pose_estimate import PoseEstimate, YawSource
from controllers.estimation.wheels.contradiction import ContradictionReport
from controllers.ftrace.reading import TraceReading
from controllers.motion.crab import CrabReport, DriftSource
from controllers.motion.limits import Limit
from controllers.motion.planar import Pose
from controllers.safety import Mode
from controllers.slip.effort.compensator import SlipReport
from controllers.slip.effort.excited_slip import RoverSlip
from controllers.slip.effort.ground_knowledge import SlipSource
from controllers.slip.effort.wheel_slips import WheelSlip
from controllers.slip.scomp.compensator import ScompReport
from drivers.errors import LogError
from drivers.samples import PoseFixSample, RateSample, Sample, SentCommand, WheelCommand, WheelSample
from rover_hil.config import load_config
from rover_hil.drives.drive import read_drive
from rover_hil.recording.json_schema import topic_schema
from rover_hil.recording.reader import LogReader
from rover_hil.recording.schema import (
    ESTIMATE_SHAPE,
    SAMPLES_SHAPE,
    EstimateRecord,
    SamplesRecord,
    set_point_record,
)
from rover_hil.recording.text import estimate_text, samples_text
from rover_hil.recording.writer import LogWriter

OUTPUT = StepOutput(
    t_ns=7,
    mode=Mode.RUNNING,
    reason="",
    estimate=PoseEstimate(
        t_ns=6,
        x_m=1.0,
        y_m=2.0,
        yaw_rad=0.1 + 0.2,
        velocity_x_m_s=0.4,
        velocity_y_m_s=-0.0,
        yaw_rate_rad_s=0.6,
        gyro_bias_rad_s=0.7,
        covariance=(1.0, 0.0, 0.0, 1.0, 0.0, 1e-300),
        yaw_source=YawSource.GYRO,
    ),
    odometry=Pose(x_m=1.1, y_m=2.2, yaw_rad=0.3),
    odometry_rebases=1,
    innovations=(
        Innovation(
            measured=Measured("compass"), residual=0.1, variance=0.2, nis=0.05, outcome=Outcome.ACCEPTED
        ),
        Innovation(
            measured=Measured("late"), residual=None, variance=None, nis=None, outcome=Outcome.REJECTED
        ),
    ),
    command=WheelCommand(t_ns=7, expires_ns=9, speed_rad_s=(1.0, 2.0), steering_rad=(0.1, 0.0)),
    limit=Limit.ACCELERATION,
    cross_track_m=None,
    slip=SlipReport(
        map="linear_m",
        surface=None,
        drift_rad=0.01,
        wheels=(
            WheelSlip(
                current_a=0.5,
                paper_torque_nm=0.1,
                wheel_torque_nm=0.2,
                slip=0.3,
                valid=False,
                reason="too slow",
            ),
        ),
        rover=RoverSlip(slip=0.3, sd=0.05, source=SlipSource.EXCITATION, reason="", unsure="gyro"),
    ),
    scomp=ScompReport(
        slip=0.1,
        slip_angle_rad=0.2,
        trace=TraceReading(
            t_ns=5, detected=True, theta_rad=0.15, confidence=0.9, source="trace", theta_sd_rad=0.01
        ),
        reason="",
    ),
    contradiction=ContradictionReport(scaled=1.5, wheel=1, rolling_m=(0.0, 0.01), side_m=(0.0, 0.002)),
    steering_rad=(0.05, 0.0),
    crab=CrabReport(drift_rad=0.14, source=DriftSource.TRACE),
    ground=GroundReport(
        t_ns=4,
        velocity_x_m_s=0.1,
        velocity_y_m_s=0.0,
        slip=0.25,
        slip_sd=0.02,
        drift_rad=None,
        reason="",
        unconfirmed="scale not confirmed",
    ),
    suspicion="rover: may be stuck",
    dead_reckoned=DeadReckoned(x_m=1.5, y_m=-0.25, yaw_rad=0.5, covariance=(1e-4, 0.0, 0.0, 1e-4, 0.0, 1e-6)),
)
RECORD = (
    b'{"t_ns":7,"mode":"running","reason":"","estimate":{"t_ns":6,"x_m":1.0,"y_m":2.0,'
    b'"yaw_rad":0.30000000000000004,"velocity_x_m_s":0.4,"velocity_y_m_s":-0.0,"yaw_rate_rad_s":0.6,'
    b'"gyro_bias_rad_s":0.7,"covariance":[1.0,0.0,0.0,1.0,0.0,1e-300],"yaw_source":"gyro"},'
    b'"odometry":{"x_m":1.1,"y_m":2.2,"yaw_rad":0.3},"odometry_rebases":1,"innovations":['
    b'{"name":"compass","residual":0.1,"variance":0.2,"nis":0.05,"accepted":true},'
    b'{"name":"late","residual":null,"variance":null,"nis":null,"accepted":false}],'
    b'"command":{"t_ns":7,"expires_ns":9,"speed_rad_s":[1.0,2.0],"steering_rad":[0.1,0.0]},"limit":"acceleration",'
    b'"cross_track_m":null,"slip":{"map":"linear_m","surface":null,"drift_rad":0.01,"wheels":['
    b'{"current_a":0.5,"paper_torque_nm":0.1,"wheel_torque_nm":0.2,"slip":0.3,"valid":false,'
    b'"reason":"too slow"}],"rover":{"slip":0.3,"sd":0.05,"source":"excitation",'
    b'"reason":"","unsure":"gyro"}},"drift":{"slip":0.1,"slip_angle_rad":0.2,"trace":{"t_ns":5,"detected":true,'
    b'"theta_rad":0.15,"confidence":0.9,"source":"trace","theta_sd_rad":0.01},"reason":""},'
    b'"contradiction":{"scaled":1.5,"wheel":1,"rolling_m":[0.0,0.01],"side_m":[0.0,0.002]},'
    b'"steering_rad":[0.05,0.0],"crab":{"drift_rad":0.14,"source":"trace"},'
    b'"ground":{"t_ns":4,"velocity_x_m_s":0.1,"velocity_y_m_s":0.0,"slip":0.25,"slip_sd":0.02,'
    b'"drift_rad":null,"reason":"","unconfirmed":"scale not confirmed"},'
    b'"suspicion":"rover: may be stuck",'
    b'"dead_reckoned":{"x_m":1.5,"y_m":-0.25,"yaw_rad":0.5,"covariance":[0.0001,0.0,0.0,0.0001,0.0,1e-6]},"findings":null}'
)


def test_a_cycle_is_read_as_it_was_written() -> None:
    assert to_json(ESTIMATE_SHAPE.validate_json(RECORD)) == RECORD


def test_a_cycle_is_written_with_the_digits_of_its_sensors_and_a_checksum() -> None:
    record = json.loads(estimate_text(OUTPUT))
    older = json.loads(RECORD)
    older["estimate"]["yaw_rad"] = 0.3
    checksum = record.pop("exact")
    assert record == older
    changed = replace(OUTPUT, estimate=replace(OUTPUT.estimate, yaw_rad=0.3))
    assert json.loads(estimate_text(changed))["exact"] != checksum
    assert ESTIMATE_SHAPE.validate_json(estimate_text(OUTPUT))["exact"] == checksum


def test_numbers_that_are_not_finite_are_null_and_read_as_nan(tmp_path: Path) -> None:
    """JSON has no NaN: strict readers of other programs would refuse the record."""
    reason = "inf, nan"
    odd = replace(OUTPUT, reason=reason, odometry=Pose(x_m=math.nan, y_m=-math.inf, yaw_rad=math.inf))
    record = json.loads(estimate_text(odd))
    assert record["odometry"] == {"x_m": None, "y_m": None, "yaw_rad": None}
    assert record["reason"] == reason
    rate = RateSample(device="imu", t_ns=5, rate_z_rad_s=math.nan)
    path = tmp_path / "run.mcap"
    with LogWriter(path, 1, b"{}", {}, "real") as log:
        log.estimate(odd)
        log.samples(5, [rate])
        log.write_json("/estimate", 6, {"t_ns": "six", "odometry": {"x_m": None}})
    reader = LogReader(path)
    messages = {(message.topic, message.t_ns): message for message in reader.messages()}
    estimate = next(
        message for (topic, t_ns), message in messages.items() if topic == "/estimate" and t_ns != 6
    )
    assert b"NaN" not in estimate.data
    assert math.isnan(reader.parse(estimate, ESTIMATE_SHAPE)["odometry"]["x_m"])
    (found,) = reader.parse(messages["/samples", 5], SAMPLES_SHAPE).rates
    assert math.isnan(found.rate_z_rad_s)
    with pytest.raises(LogError, match="damaged"):
        reader.parse(messages["/estimate", 6], ESTIMATE_SHAPE)


def test_a_record_with_many_numbers_that_are_none_is_read_at_once(tmp_path: Path) -> None:
    """The validation names one mistake at a time; a log of others may hold thousands."""
    count = 1200
    path = tmp_path / "run.mcap"
    rate = {"device": "imu", "t_ns": 5, "t_device_ns": None, "rate_x_rad_s": None, "rate_y_rad_s": None}
    rates = [{**rate, "rate_z_rad_s": None if number else 0.5} for number in range(count)]
    with LogWriter(path, 1, b"{}", {}, "real") as log:
        log.write_json("/samples", 5, {"RateSample": rates})
        log.write_json("/samples", 6, {"RateSample": [*rates, "x"]})
    reader = LogReader(path)
    first, second = (message for message in reader.messages() if message.topic == "/samples")
    found = reader.parse(first, SAMPLES_SHAPE).rates
    assert (len(found), found[0].rate_z_rad_s) == (count, 0.5)
    assert all(math.isnan(each.rate_z_rad_s) for each in found[1:])
    with pytest.raises(LogError, match=rf"damaged.*RateSample\.{count}"):
        reader.parse(second, SAMPLES_SHAPE)


def test_every_topic_has_a_schema_that_simple_readers_understand() -> None:
    topics = ["/estimate", "/samples", "/command", "/truth", "/health", "/bytes", "/cycle", "/end", "/link/x"]
    for topic in [*topics, "/camera/x", "/watchdog", "/view/pose", "/view/path", "/view/log", "/other"]:
        _check_types(json.loads(topic_schema(topic).text))
    estimate = json.loads(topic_schema("/estimate").text)["properties"]
    assert set(estimate) == set(EstimateRecord.__annotations__)
    assert estimate["estimate"]["properties"]["x_m"] == {"type": "number", "description": "m"}


def _check_types(schema: dict[str, object]) -> None:
    assert schema["type"] in ("object", "array", "string", "number", "integer", "boolean")
    for inner in schema.get("properties", {}).values():  # type: ignore[attr-defined]
        _check_types(inner)
    if schema["type"] == "array":
        _check_types(schema["items"])  # type: ignore[arg-type]


def test_nothing_that_a_cycle_computes_is_left_out() -> None:
    names = {"scomp": "drift"}.get
    keys = {names(field.name, field.name) for field in fields(StepOutput)}
    assert keys | {"exact"} == set(EstimateRecord.__annotations__)


def test_a_cycle_of_an_older_log_is_read() -> None:
    older = json.loads(RECORD)
    del older["slip"], older["drift"], older["contradiction"], older["steering_rad"]
    del older["command"]["steering_rad"], older["crab"], older["suspicion"], older["dead_reckoned"]
    older["wheel_doubt"] = None  # distinguished from other suspicions for a while
    record = ESTIMATE_SHAPE.validate_python(older)
    assert "slip" not in record
    assert record["estimate"]["x_m"] == 1.0


def test_the_readers_find_the_kinds_of_samples_that_are_written() -> None:
    wheel = WheelSample(device="board", t_ns=1, wheel=0, position_rad=0.5)
    fix = PoseFixSample(
        device="overhead",
        t_ns=9,
        x_m=1.0,
        y_m=2.0,
        yaw_rad=3.0,
        position_std_m=0.01,
        yaw_std_rad=0.02,
        t_capture_ns=5,
    )
    samples: list[Sample] = [wheel, fix]
    record = SamplesRecord.model_validate_json(samples_text(samples))
    assert (record.wheels, record.fixes, record.rates) == ([wheel], [fix], [])


def test_set_points_that_were_not_delivered_are_none(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    config_json = load_config("robotino").model_dump_json(by_alias=True).encode()
    with LogWriter(path, 1, config_json, {}, "virtual") as log:
        for t_ns, delivered in ((10, True), (20, False)):
            sent = SentCommand(t_ns=t_ns, speed_rad_s=(1.0, 2.0, 3.0), delivered=delivered)
            log.write_json("/command", t_ns, set_point_record(sent))
    rows = read_drive(path).channels
    assert rows["set2_rad_s"].t_ns.tolist() == [10]
    assert rows["set2_rad_s"].value.tolist() == [2.0]
