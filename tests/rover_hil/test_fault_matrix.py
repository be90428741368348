"""A part of the fault matrix of `benchmarks.safety.faults`, and what it is made of."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest

from benchmarks.safety.faults.cases import Case, Duty, all_cases
from benchmarks.safety.faults.injection import Scaled, Window
from benchmarks.safety.faults.measures import Moment, Row, Story, add_truth, check_replay, judge, read_story
from benchmarks.safety.faults.process_cases import process_cases
from benchmarks.safety.faults.runs import rover_config, run_case
from benchmarks.safety.faults.wires import (
    Change,
    CompassSentences,
    GyroFrames,
    PositionSentences,
    Reading,
    RobotinoReplies,
    RobotinoRequests,
    WheelSetPoints,
    WheelStates,
    Wire,
)
from drivers.can_wheels.mapping_file import load_mapping
from drivers.can_wheels.messages import MessageWriter
from drivers.nmea import encode_sentence
from drivers.robotino_board.codec import BoardReply, BoardRequest, build_reply, build_request, parse_reply
from drivers.witmotion.codec import encode_angle, encode_rate
from rover_hil.config import load_config
from sim_backends.world.line import NEVER_NS

WATCHED_S = 1.5
QUICK = [
    "robotino/board/unplug",
    "robotino/board/garbage",
    "robotino/board/wrong values",
    "robotino/board/one wheel jammed",
    "robotino/imu/freeze",
    "robotino/imu/stall",
    "robotino/imu/old stamps",
    "robotino/process/paused 1 s",
    "el-dorado/wheels/freeze",
    "el-dorado/wheels/duplicated",
    "el-dorado/compass/unplug",
    "el-dorado/imu/slow (1 in 10)",
]
REPLAYED = ("robotino/board/garbage", "el-dorado/compass/unplug")
CASES = {case.title: case for case in (*all_cases(), *process_cases())}


@pytest.mark.parametrize("title", QUICK)
def test_a_fault_stops_the_rover_and_the_estimate_stays_honest(title: str, tmp_path: Path) -> None:
    case, path = CASES[title], tmp_path / "run.mcap"
    _, window = run_case(case, path, WATCHED_S)
    story = read_story(path, case.device)
    add_truth(story)
    row = judge(case, story, rover_config(case), window.begin_ns)
    if title in REPLAYED:
        check_replay(row, path)
        assert row.replays is True
    assert row.verdict == "ok", row


def test_every_case_has_a_title_of_its_own_and_every_argument_is_given() -> None:
    every = [*all_cases(), *process_cases()]
    assert len({case.title for case in every}) == len(every)
    assert all(bool(case.why) == (case.duty is Duty.PHYSICS) for case in every)
    assert {case.device for case in every if case.rover == "el-dorado"} >= set(
        load_config("el-dorado").roles.names()
    )


def wheel_state(*_: object) -> bytes:
    bus = load_mapping("generic_wheel")
    writer = MessageWriter(bus.message("Wheel2_State"), bus.protection("Wheel2_State"))
    writer.write({})
    return writer.write({"Position": -1234, "Speed": -2500, "Current": 77})


def set_point(*_: object) -> bytes:
    bus = load_mapping("generic_wheel")
    writer = MessageWriter(bus.message("Wheel3_Setpoint"), bus.protection("Wheel3_Setpoint"))
    writer.write({})
    return writer.write({"Speed": -1500})


PAYLOADS: list[tuple[Wire, bytes, list[float]]] = [
    (
        RobotinoReplies(),
        build_reply(BoardReply((-5, 0, 70_000), (-9, 0, 255), (4, 8, 12), 800, 40, True, 77, "EA05")),
        [-5, 0, 70_000, -9, 0, 255],
    ),
    (
        RobotinoRequests(),
        build_request(BoardRequest((-9, 0, 255), (True, True, True), (255, 255, 0))),
        [-9, 0, 255],
    ),
    (WheelStates(), wheel_state(), [-1234, -2500]),
    (WheelSetPoints(), set_point(), [-1500]),
    (GyroFrames(), encode_angle(0.1, 0.2, 0.3) + encode_rate(0.0, -1.0, 2.0), [0, -939, 1877]),
    (CompassSentences(), encode_sentence("HCHDG,238.4,,,,"), [238.4]),
]


@pytest.mark.parametrize(("wire", "payload", "values"), PAYLOADS)
def test_a_wire_is_opened_and_closed_without_a_trace(wire: Wire, payload: bytes, values: list[float]) -> None:
    seen: list[float] = []

    def look(t_ns: int, readings: Sequence[Reading]) -> Sequence[float]:
        seen.extend(reading.value for reading in readings)
        return [reading.value for reading in readings]

    assert wire.change(0, payload, look) == payload
    assert seen == values


@pytest.mark.parametrize(("wire", "payload", "values"), PAYLOADS)
def test_changed_numbers_are_what_the_next_reader_sees(
    wire: Wire, payload: bytes, values: list[float]
) -> None:
    seen: list[float] = []

    def look(t_ns: int, readings: Sequence[Reading]) -> Sequence[float]:
        seen.extend(reading.value for reading in readings)
        return [reading.value for reading in readings]

    wire.change(0, wire.change(0, payload, lambda _, readings: [r.value + 3 for r in readings]), look)
    assert seen == [min(value + 3, 255) if value == 255 else value + 3 for value in values]


def test_a_position_is_moved_by_metres() -> None:
    """A minute of latitude is 1853 m on this ball, one of longitude at 48 degrees 1240 m."""
    sentence = encode_sentence("GNGGA,120000.00,4800.0000000,N,01130.0000000,E,4,12,0.8,500.0,M,47.0,M,,")
    rest = encode_sentence("GNGST,120000.00,,,,,0.014,0.014,0.028")
    wire = PositionSentences()
    assert (
        wire.change(0, sentence + rest, lambda _, found: [reading.value for reading in found])
        == sentence + rest
    )
    moved = wire.change(0, sentence + rest, lambda _, found: [found[0].value + 1.0, found[1].value - 2.0])
    fields = moved.split(b",")
    assert (float(fields[2]) - 4800.0) * 1853.3 == pytest.approx(1.0, rel=1e-3)
    assert (float(fields[4]) - 1130.0) * 1240.1 == pytest.approx(-2.0, rel=1e-3)
    assert moved.endswith(rest)
    assert wire.change(0, rest, lambda _, found: []) == rest


def test_a_reversed_total_goes_on_from_the_begin_of_the_fault() -> None:
    change: Change = Scaled(-1.0, (0,))
    frames = [
        build_reply(BoardReply((t, t, t), (2, 2, 2), (0, 0, 0), 0, 0, False, 0, "EA05")) for t in (5, 9)
    ]
    before, after = (parse_reply(RobotinoReplies().change(0, frame, change)) for frame in frames)
    assert before.ticks == (5, 5, 5)
    assert after.ticks == (1, 9, 9)
    assert after.speed_steps == (-2, 2, 2)


def test_a_fault_waits_for_the_first_motion() -> None:
    window = Window(3.0, 1.0)
    assert not window.holds(NEVER_NS - 1)
    window.begin_ns = 10
    assert [window.holds(t_ns) for t_ns in (9, 10, window.end_ns - 1, window.end_ns)] == [
        False,
        True,
        True,
        False,
    ]


def moment(t_s: float, mode: str = "running", x_m: float = 0.0, reason: str = "") -> Moment:
    return Moment(
        t_ns=round(t_s * 1e9),
        sent_ns=round(t_s * 1e9),
        mode=mode,
        reason=reason,
        estimate=(x_m, 0.0, 0.0),
        covariance=(1e-4, 0.0, 0.0, 1e-4, 0.0, 1e-4),
        odometry=(0.0, 0.0, 0.0),
        is_zero=mode != "running",
    )


def judged(title: str, moments: list[Moment], change: Callable[[Story], None] = lambda _: None) -> Row:
    case: Case = CASES[title]
    cycles_ns = [m.t_ns for m in moments]
    story = Story(moments=moments, end="time over", raw_ns=[t_ns for t_ns in cycles_ns if t_ns <= 10**9])
    story.sample_ns = [(t_ns, t_ns) for t_ns in story.raw_ns]
    change(story)
    return judge(case, story, load_config(case.rover), 10**9 + 1)


def test_the_bars_are_judged() -> None:
    times_s = np.arange(0.0, 3.0, 0.02)
    fast = [moment(t, "safe_stop" if t > 1.16 else "running") for t in times_s]
    assert judged("robotino/board/freeze", fast).verdict == "ok"
    slow = [moment(t, "safe_stop" if t > 1.5 else "running") for t in times_s]
    assert "zero setpoints after" in judged("robotino/board/freeze", slow).verdict
    never = [moment(t) for t in times_s]
    assert "not stopped" in judged("robotino/board/freeze", never).verdict
    assert "not noticed" in judged("robotino/board/all reversed", never).verdict
    named = [moment(t, "safe_stop" if t > 2 else "running", reason="wheel 0: reversed") for t in times_s]
    assert judged("robotino/board/all reversed", named).verdict == "ok"
    assert "not named" in judged("robotino/imu/reversed", named).verdict


def test_a_wrong_estimate_after_a_stop_is_seen() -> None:
    moments = [
        moment(t, "safe_stop" if 1.16 < t < 2 else "running", x_m=0.05 if t > 1 else 0.0)
        for t in np.arange(0.0, 3.0, 0.02)
    ]
    assert "drives again with NEES 25" in judged("robotino/board/freeze", moments).verdict


def test_what_a_fault_did_before_it_was_noticed_is_no_wrong_estimate_after_a_stop() -> None:
    moments = [
        moment(t, "safe_stop" if t > 1.16 else "running", x_m=0.05 if t > 1 else 0.0)
        for t in np.arange(0.0, 3.0, 0.02)
    ]
    assert judged("robotino/board/freeze", moments).verdict == "ok"


def test_an_invented_sample_is_seen() -> None:
    moments = [moment(t, "safe_stop" if t > 1.16 else "running") for t in np.arange(0.0, 3.0, 0.02)]

    def invent(story: Story) -> None:
        story.sample_ns.append((5 * 10**8, 5 * 10**8 + 1))

    assert "1 invented" in judged("robotino/board/freeze", moments, invent).verdict
