"""DBC files, mappings and frames with which users of other programs had trouble."""

import math
import struct
from collections.abc import Sequence
from pathlib import Path

import pytest

from drivers.can_wheels.codec import CanWheelsCodec
from drivers.can_wheels.mapping_file import load_mapping
from drivers.driver import Rejection
from drivers.errors import ConfigError
from drivers.samples import FaultSample, PowerSample, Sample, WheelSample
from tests.drivers.can_wheels_frames import decode, frame, reasons, wheel_samples
from tests.drivers.candump import feed

TURN = 2 * math.pi
HEAD = 'VERSION ""\nBU_: A\n'
WHEELS = """BO_ 256 W0: 8 A
 SG_ Pos : 0|32@1- (1,0) [0|0] "" A
 SG_ Speed : 32|16@1- (0.01,0) [0|0] "" A

BO_ 257 W1: 8 A
 SG_ Pos : 0|32@1- (1,0) [0|0] "" A
 SG_ Speed : 32|16@1- (0.01,0) [0|0] "" A

"""
TICKS = 'position = { message = "W{node}", signal = "Pos", unit = "ticks", ticks_per_revolution = 4096 }\n'
TWO = "[[wheel]]\nnode = 0\n[[wheel]]\nnode = 1\n"
ONE = "[[wheel]]\nnode = 0\n"


def write(folder: Path, dbc: str, every_wheel: str, rest: str = TWO) -> str:
    (folder / "own.dbc").write_text(HEAD + dbc, "utf-8")
    path = folder / "own.toml"
    path.write_text(f'dbc = "own.dbc"\n[every_wheel]\n{every_wheel}{rest}', "utf-8")
    return str(path)


def make(folder: Path, dbc: str, every_wheel: str, rest: str = TWO) -> CanWheelsCodec:
    return CanWheelsCodec("wheels", load_mapping(write(folder, dbc, every_wheel, rest)))


def last_positions(results: Sequence[tuple[float, Sample | Rejection]]) -> dict[int, float | None]:
    return {each.wheel: each.position_rad for _, each in results if isinstance(each, WheelSample)}


# Mistakes in messages that the mapping does not name


@pytest.mark.parametrize("name", ["same_name_twice", "flag_in_code", "multiplexed"])
def test_reported_file_gives_the_turns_of_both_wheels(shared_data: Path, name: str) -> None:
    folder = shared_data / "field_reports" / "can"
    log = folder / ("multiplexed.log" if name == "multiplexed" else "two_turns.log")
    results = feed(
        CanWheelsCodec("wheels", load_mapping(str(folder / f"{name}.toml"))), log.read_text("utf-8")
    )
    assert not [each for _, each in results if isinstance(each, Rejection)]
    assert last_positions(results) == pytest.approx({0: TURN, 1: 2 * TURN}, abs=1e-9)


OTHER = 'BO_ 400 X: 8 A\n SG_ A : {0} (1,0) [0|0] "" A\n SG_ {1} : {2} (1,0) [0|0] "" A\n'


@pytest.mark.parametrize(
    "other",
    [
        OTHER.format("7|16@0+", "B", "3|4@0+"),  # overlap, most significant byte first
        OTHER.format("0|16@1+", "A", "16|8@1+"),  # one name twice
        OTHER.format("0|16@1+", "B", "60|8@1+"),  # beyond the message
        OTHER.format("0|16@1+", "B m3", "16|8@1+"),  # multiplexed without a multiplexer
        OTHER.format("0|16@1+", "B", "16|8@1+") * 2,  # one message twice
        OTHER.format("0|16@1+", "B", "16|8@1+").replace("(1,0)", "(0,0)"),
        OTHER.format("0|16@1+", "B", "16|8@1+").replace("400 X", "256 Y"),  # the identifier of a wheel
        OTHER.format("0|16@1+", "B", "16|8@1+").replace("X: 8", "X: 64"),
    ],
)
def test_mistakes_in_messages_of_others_change_nothing(tmp_path: Path, other: str) -> None:
    codec = make(tmp_path, WHEELS + other, TICKS)
    (sample,) = wheel_samples(decode(codec, frame(0x101, struct.pack("<iI", 4096, 0))))
    assert sample.wheel == 1
    assert sample.position_rad == pytest.approx(TURN)


@pytest.mark.parametrize("unused", ["Speed : 32|16@1-", "Flag : 50|1@1+", "Code : 48|8@1+"])
def test_mistakes_in_signals_of_a_wheel_that_nobody_uses_change_nothing(tmp_path: Path, unused: str) -> None:
    dbc = WHEELS.replace(
        "BO_ 257", f' SG_ {unused} (1,0) [0|0] "" A\n SG_ {unused} (0,0) [0|0] "" A\n\nBO_ 257', 1
    )
    (sample,) = wheel_samples(decode(make(tmp_path, dbc, TICKS), frame(0x100, struct.pack("<iI", 4096, 0))))
    assert sample.position_rad == pytest.approx(TURN)


SPEED = 'speed = { message = "W{node}", signal = "Speed", unit = "rad/s" }\n'
SET = 'setpoint = { message = "C", signal = "S{node}", unit = "rad/s" }\n'
COMMAND = """BO_ 300 C: 8 A
 SG_ S0 : 0|16@1- (0.01,0) [0|0] "" A
 SG_ S1 : 16|16@1- (0.01,0) [0|0] "" A
"""


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("(1,0)", "(0,0)", "every_wheel.position: signal 'Pos' of message 'W0' has factor 0 and offset 0"),
        ("(1,0)", "(1e999,0)", "every_wheel.position: signal 'Pos' of message 'W0' has factor inf"),
        ("Speed : 32", "Speed : 31", "signals 'Pos' and 'Speed' of message 'W0' overlap"),
        ("Speed : 32|16@1-", "Pos : 32|16@1-", "every_wheel.position: message 'W0' has 2 signals 'Pos'"),
        ("Speed : 32", "Speed : 56", "every_wheel.speed: signal 'Speed' of message 'W0' lies outside"),
        ("W1", "W0", "every_wheel.position: the DBC file has 2 messages 'W0'"),
        ("BO_ 257", "BO_ 256", "messages 'W0' and 'W1' have one identifier"),
        ("W0: 8", "W0: 16", "message 'W0' is 16 bytes long"),
        ("S1 : 16", "S1 : 15", "signals 'S0' and 'S1' of message 'C' overlap"),
        (
            "S0 : 0|16@1-",
            'M M : 40|8@1+ (1,0) [0|0] "" A\n SG_ S0 m0 : 0|16@1-',
            "message 'C' is multiplexed; such messages are read, but never sent",
        ),
    ],
)
def test_mistake_in_what_the_mapping_names_is_one_sentence_with_its_cause(
    tmp_path: Path, old: str, new: str, told: str
) -> None:
    whole = WHEELS + COMMAND
    assert old in whole
    path = write(tmp_path, whole.replace(old, new, 1 if "W" not in old else -1), TICKS + SPEED + SET)
    with pytest.raises(ConfigError) as caught:
        load_mapping(path)
    assert told in str(caught.value)
    assert all(line.startswith(path) for line in str(caught.value).splitlines())


# Multiplexed messages

PAGES = """BO_ 512 M: 8 A
 SG_ Page M : 7|8@0+ (1,0) [0|0] "" A
 SG_ Pos0 m0 : 15|32@0- (1,0) [0|0] "" A
 SG_ Speed0 m1 : 15|16@0- (0.01,0) [0|0] "" A
 SG_ Pos1 m2 : 15|32@0- (1,0) [0|0] "" A
 SG_ Speed1 m3 : 15|16@0- (0.01,0) [0|0] "" A
 SG_ Error : 63|8@0+ (1,0) [0|0] "" A
"""
PAGED = """position = { message = "M", signal = "Pos{node}", unit = "ticks", ticks_per_revolution = 4096 }
speed = { message = "M", signal = "Speed{node}", unit = "rad/s" }
"""


def test_pages_of_a_message_bring_what_they_hold(tmp_path: Path) -> None:
    codec = make(tmp_path, PAGES, PAGED, TWO + '[[fault]]\nmessage = "M"\nsignal = "Error"\n')
    held = [decode(codec, frame(0x200, struct.pack(">BiHB", page, 4096, 0, 0))) for page in range(5)]
    assert [
        [(each.wheel, each.position_rad, each.speed_rad_s) for each in wheel_samples(told)] for told in held
    ] == [
        [(0, pytest.approx(TURN), None)],
        [(0, None, pytest.approx(0.0))],
        [(1, pytest.approx(TURN), None)],
        [(1, None, pytest.approx(0.0))],
        [],
    ]
    (fault,) = decode(codec, frame(0x200, struct.pack(">BiHB", 9, 0, 0, 5)))
    assert isinstance(fault, FaultSample)
    assert (fault.wheel, fault.code) == (None, 5)


NESTED = """BO_ 512 M: 8 A
 SG_ Kind M : 0|4@1+ (1,0) [0|0] "" A
 SG_ Which m1M : 4|4@1+ (1,0) [0|0] "" A
 SG_ Pos0 m0 : 8|32@1- (1,0) [0|0] "" A
 SG_ Pos1 m1 : 8|32@1- (1,0) [0|0] "" A
 SG_ Text m0 : 4|60@1+ (1,0) [0|0] "" A
SG_MUL_VAL_ 512 Which Kind 1-1;
SG_MUL_VAL_ 512 Pos0 Which 0-0, 4-6;
SG_MUL_VAL_ 512 Pos1 Which 1-1;
SG_MUL_VAL_ 512 Text Kind 0-0;
"""


@pytest.mark.parametrize(
    ("first_byte", "wheel"),
    [(0x01, 0), (0x51, 0), (0x11, 1), (0x21, None), (0x00, None), (0x10, None), (0x12, None)],
)
def test_a_multiplexer_may_lie_behind_another(tmp_path: Path, first_byte: int, wheel: int | None) -> None:
    codec = make(tmp_path, NESTED, PAGED.splitlines()[0] + "\n")
    told = decode(codec, frame(0x200, struct.pack("<BiHB", first_byte, -4096, 0, 0)))
    assert [each.wheel for each in wheel_samples(told)] == ([] if wheel is None else [wheel])
    assert reasons(told) == []


def test_limits_and_turns_hold_for_each_page_of_its_own(tmp_path: Path) -> None:
    codec = make(
        tmp_path, PAGES.replace("Pos1 m2 : 15|32@0- (1,0) [0|0]", "Pos1 m2 : 15|16@0+ (1,0) [0|9999]"), PAGED
    )
    for counts, page in ((60_000, 0), (9_999, 2), (60_100, 0)):
        data = struct.pack(">Bi", 0, counts) if page == 0 else struct.pack(">BH2x", page, counts)
        assert reasons(decode(codec, frame(0x200, data + bytes(3)))) == []
    assert reasons(decode(codec, frame(0x200, struct.pack(">BH5x", 2, 10_000)))) == ["out_of_range"]


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("SG_MUL_VAL_ 512 Pos0 Which 0-0, 4-6;\nSG_MUL_VAL_ 512 Pos1 Which 1-1;\n", ""),
        ("SG_MUL_VAL_ 512 Pos1 Which", "SG_MUL_VAL_ 512 Pos1 Who"),
        ("SG_MUL_VAL_ 512 Text Kind", "SG_MUL_VAL_ 512 Kind Which 0-3;\nSG_MUL_VAL_ 512 Text Kind"),
    ],
)
def test_multiplexers_of_which_the_file_does_not_say_what_they_choose_are_refused(
    tmp_path: Path, old: str, new: str
) -> None:
    assert old in NESTED
    dbc = NESTED.replace(old, new)
    with pytest.raises(
        ConfigError, match=r"every_wheel\.position: the DBC file does not say which multiplexer"
    ):
        load_mapping(write(tmp_path, dbc, PAGED.splitlines()[0] + "\n"))


@pytest.mark.parametrize("key", ["counter", "checksum"])
def test_protection_in_some_pages_only_is_refused(tmp_path: Path, key: str) -> None:
    algorithm = 'algorithm = "xor8"\n' if key == "checksum" else ""
    rest = f'{TWO}[[protection]]\nmessages = ["M"]\n{key} = "Low"\n{algorithm}'
    dbc = PAGES + ' SG_ Low m0 : 55|8@0+ (1,0) [0|0] "" A\n'
    with pytest.raises(ConfigError, match="'Low' of message 'M' is multiplexed"):
        load_mapping(write(tmp_path, dbc, PAGED, rest))


# Drives that leave operation

STATE = """BO_ 256 W0: 8 A
 SG_ Pos : 0|32@1- (1,0) [0|0] "" A
 SG_ Mode : 32|8@1+ (1,0) [0|0] "" A

VAL_ 256 Mode 2 "ready" 3 "run" 7 "brake" ;
"""
STATED = TICKS + 'state = { message = "W{node}", signal = "Mode", operating = [3, 7] }\n'


def modes(
    codec: CanWheelsCodec, states: Sequence[tuple[float, int]], *, commanded: bool = True
) -> list[tuple[float, int]]:
    """Return time and code of the faults of a drive that reports states at times."""
    text = "\n".join(f"({time:.6f}) can0 100#00000000{state:02X}000000" for time, state in states)
    results = feed(codec, text, lambda t_ns: codec.encode_speeds([1.0]) if commanded else None)
    return [(time, each.code) for time, each in results if isinstance(each, FaultSample)]


@pytest.mark.parametrize("bus", ["odrive_0_5", "odrive_0_6"])
def test_reported_odrive_that_left_closed_loop_is_a_fault(shared_data: Path, bus: str) -> None:
    text = (shared_data / "field_reports" / "can" / "odrive_left_closed_loop.log").read_text("utf-8")
    codec = CanWheelsCodec("wheels", load_mapping(bus))
    told = feed(codec, text, lambda t_ns: codec.encode_speeds((1.0,) * 4))
    faults = [(time, each.wheel, each.text) for time, each in told if isinstance(each, FaultSample)]
    source = "Axis0_Heartbeat.Axis_State: the drive does not obey setpoints, its state is idle"
    assert faults == [(1.0, 0, source)]
    silent = feed(CanWheelsCodec("wheels", load_mapping(bus)), text)
    assert not [each for _, each in silent if isinstance(each, FaultSample)]


def test_a_drive_of_ones_own_that_stops_obeying_is_a_fault_until_it_obeys(tmp_path: Path) -> None:
    codec = make(tmp_path, STATE, STATED, ONE)
    assert modes(codec, [(0.0, 2), (0.1, 3), (0.2, 7), (0.3, 2), (0.4, 2), (0.5, 0), (0.6, 3)]) == [
        (0.3, 2),
        (0.5, 1),
        (0.6, 0),
    ]


def test_a_drive_that_never_obeys_is_a_fault_after_a_second(tmp_path: Path) -> None:
    codec = make(tmp_path, STATE, STATED, ONE)
    assert modes(codec, [(0.0, 2), (0.9, 2), (1.0, 2), (1.1, 3)]) == [(1.0, 2), (1.1, 0)]


def test_a_drive_may_rest_before_the_first_set_point_and_after_the_stop(tmp_path: Path) -> None:
    codec = make(tmp_path, STATE, STATED, ONE)
    assert modes(codec, [(0.0, 3), (0.1, 2), (5.0, 2)], commanded=False) == []
    assert modes(codec, [(6.0, 3)]) == []
    codec.encode_stop()
    assert modes(codec, [(7.0, 2), (9.0, 2)], commanded=False) == []
    assert modes(codec, [(10.0, 3), (10.1, 2)]) == [(10.1, 2)]
    codec.reset()
    assert modes(codec, [(11.0, 2)], commanded=False) == [(11.0, 0)]


def test_values_of_a_state_must_fit_into_its_signal(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"every_wheel\.state: signal 'Mode' cannot hold 300"):
        load_mapping(write(tmp_path, STATE, STATED.replace("[3, 7]", "[300]"), ONE))


# Negative values in signals that the DBC file calls unsigned

UNSIGNED = """BO_ 256 W0: 8 A
 SG_ Pos : 0|32@1- (1,0) [0|0] "" A
 SG_ Speed : 32|16@1+ (0.01,0) [0|0] "" A
 SG_ Current : 48|16@1+ (0.1,0) [0|0] "" A
"""
CURRENT = 'current = { message = "W{node}", signal = "Current", unit = "A" }\n'


def unsigned(codec: CanWheelsCodec, index: int, speed: int, current: int) -> list[Sample | Rejection]:
    data = struct.pack("<ihh", 0, speed, current)
    return decode(codec, frame(0x100, data), index * 10_000_000)


@pytest.mark.parametrize("currents", [[-1], [5, -1], [0, -300, -301]])
def test_no_current_of_6553_a_is_read(tmp_path: Path, currents: list[int]) -> None:
    codec = make(tmp_path, UNSIGNED, TICKS + CURRENT, ONE)
    for index, current in enumerate(currents):
        told = unsigned(codec, index, 0, current)
        (sample,) = wheel_samples(told)
        assert sample.position_rad == 0.0
        assert sample.current_a == (None if current < 0 else pytest.approx(current / 10))
        assert reasons(told) == (["negative_as_unsigned"] if current < 0 else [])


def test_a_speed_that_crosses_zero_is_not_read_as_the_largest(tmp_path: Path) -> None:
    codec = make(
        tmp_path, UNSIGNED, 'speed = { message = "W{node}", signal = "Speed", unit = "rad/s" }\n', ONE
    )
    speeds = [
        unsigned(codec, index, speed, 0) for index, speed in enumerate((20, 10, 0, -10, -20, -10, 0, 10))
    ]
    assert [[each.speed_rad_s for each in wheel_samples(told)] for told in speeds] == [
        [pytest.approx(0.2)], [pytest.approx(0.1)], [0.0], [], [], [], [0.0], [pytest.approx(0.1)],
    ]  # fmt: skip


def test_a_large_value_that_was_come_to_in_steps_is_believed(tmp_path: Path) -> None:
    codec = make(tmp_path, UNSIGNED, TICKS + CURRENT, ONE)
    for index, current in enumerate((0, 20_000, 40_000, 65_535, 50_000, 10)):
        told = unsigned(codec, index, 0, (current + 2**15) % 2**16 - 2**15)
        assert [each.current_a for each in wheel_samples(told)] == [pytest.approx(current / 10)]


def test_a_battery_that_is_charged_has_no_current_of_6553_a(tmp_path: Path) -> None:
    power = """[power]
voltage = { message = "W0", signal = "Speed", unit = "V" }
current = { message = "W0", signal = "Current", unit = "A" }
"""
    codec = make(tmp_path, UNSIGNED, TICKS, ONE + power)
    told = unsigned(codec, 0, 2400, -1)
    assert reasons(told) == ["negative_as_unsigned"]
    (supply,) = [each for each in told if isinstance(each, PowerSample)]
    assert supply.voltage_v == pytest.approx(24.0)
    assert supply.current_a is None


# Registers of positions

ANGLE = """BO_ 256 W0: 8 A
 SG_ Angle : 0|16@1+ (1,0) [0|0] "" A
 SG_ Turns : 16|8@1- (1,0) [0|0] "" A
"""
WITH_TURNS = """[every_wheel.position]
message = "W0"
signal = "Angle"
unit = "ticks"
ticks_per_revolution = 65536
turns = "Turns"
"""


def angles(
    codec: CanWheelsCodec, turns: Sequence[float], period_s: float = 0.01
) -> list[tuple[float | None, list[str]]]:
    """Return position in turns and rejections for a wheel at some turns of its encoder."""
    results = []
    for index, turn in enumerate(turns):
        data = struct.pack("<Hb5x", round(turn % 1 * 65536) % 65536, (math.floor(turn) + 128) % 256 - 128)
        told = decode(codec, frame(0x100, data), round(index * period_s * 1e9))
        position_rad = next((each.position_rad for each in wheel_samples(told)), None)
        results.append((None if position_rad is None else position_rad / TURN, reasons(told)))
    return results


def test_a_count_of_turns_beside_an_angle_is_read(tmp_path: Path) -> None:
    codec = make(tmp_path, ANGLE, WITH_TURNS, ONE)
    turns = [0.0, 0.8, 1.6, -2.25, 60.5, 123.75, 128.5, 100.0, 50.0, -10.0, -70.0, -128.75]
    told = angles(codec, turns, 1.0)
    assert [turned for turned, _ in told] == pytest.approx(turns, abs=1e-4)
    assert not any(rejected for _, rejected in told)


def test_without_the_count_steps_that_may_hide_turns_are_told(tmp_path: Path) -> None:
    codec = make(tmp_path, ANGLE, WITH_TURNS.replace('turns = "Turns"', ""), ONE)
    assert angles(codec, [0.0, 0.1, 0.3, 0.6]) == [
        (0.0, []),
        (pytest.approx(0.1, abs=1e-4), []),
        (pytest.approx(0.3, abs=1e-4), []),
        (pytest.approx(0.6, abs=1e-4), ["position_ambiguous"]),
    ]


@pytest.mark.parametrize(
    "turns", [[0.0, 1.0], [0.0, 2.0], [0.1, 1.05, 2.0, 2.95], [0.4, -0.6], [0.9, 2.95, 5.0]]
)
def test_turns_that_an_angle_alone_does_not_show_are_told(tmp_path: Path, turns: list[float]) -> None:
    codec = make(tmp_path, ANGLE, WITH_TURNS.replace('turns = "Turns"', ""), ONE)
    assert ["position_ambiguous"] in [rejected for _, rejected in angles(codec, turns)]


@pytest.mark.parametrize("late", [0, 1])
def test_a_count_of_turns_that_agrees_with_the_angle_is_not_told(tmp_path: Path, late: int) -> None:
    codec = make(tmp_path, ANGLE, WITH_TURNS.replace('turns = "Turns"', ""), ONE)
    turns = [index / 16 for index in range(80)] + [5.0 - index / 16 for index in range(160)]
    for index, turn in enumerate(turns):
        counted = math.floor(turns[max(0, index - late)])
        data = struct.pack("<Hb5x", round(turn % 1 * 65536) % 65536, counted)
        assert reasons(decode(codec, frame(0x100, data), index * 10_000_000)) == []


def test_a_signal_with_such_a_name_that_never_changes_counts_nothing(tmp_path: Path) -> None:
    dbc = ANGLE.replace("Turns : 16|8@1- (1,0) [0|0]", "Turns : 16|8@1- (1,0) [3|4]")
    codec = make(tmp_path, dbc, WITH_TURNS.replace('turns = "Turns"', ""), ONE)
    for index in range(100):
        data = struct.pack("<H6x", 3000 * index % 65536)
        assert reasons(decode(codec, frame(0x100, data), index * 10_000_000)) == []


@pytest.mark.parametrize(
    ("dbc", "every_wheel", "told"),
    [
        (ANGLE, WITH_TURNS.replace('"Turns"', '"Turn"'), "did you mean 'Turns'"),
        (
            ANGLE,
            WITH_TURNS + "wrap = 70000\n",
            "wrap = 70000 is more than signal 'Angle'",
        ),
        (
            ANGLE.replace("16@1+", "32@1-").replace("16|8", "32|8") + "SIG_VALTYPE_ 256 Angle : 1;\n",
            WITH_TURNS,
            "turns: give also",
        ),
        (
            ANGLE.replace("Turns :", "Turns m1 :") + ' SG_ M M : 32|8@1+ (1,0) [0|0] "" A\n',
            WITH_TURNS,
            "'Turns' is never in one frame with 'Angle'",
        ),
    ],
)
def test_a_count_of_turns_that_does_not_fit_is_refused(
    tmp_path: Path, dbc: str, every_wheel: str, told: str
) -> None:
    with pytest.raises(ConfigError, match=r"every_wheel\.position") as caught:
        load_mapping(write(tmp_path, dbc, every_wheel, ONE))
    assert told in str(caught.value)


def steps(codec: CanWheelsCodec, counts: Sequence[int]) -> list[tuple[float | None, list[str]]]:
    results: list[tuple[float | None, list[str]]] = []
    for index, count in enumerate(counts):
        told = decode(codec, frame(0x100, struct.pack("<Hb5x", count, 0)), index * 10_000_000)
        position_rad = next((each.position_rad for each in wheel_samples(told)), None)
        results.append((None if position_rad is None else round(position_rad / TURN * 4096), reasons(told)))
    return results


UNWRAPPED = TICKS.replace("Pos", "Angle")
WRAPPED = UNWRAPPED.replace(" }", ", wrap = 4096 }")
JUMP = ["implausible_jump"]


def test_a_counter_above_its_declared_wrap_is_told_and_does_not_jump(tmp_path: Path) -> None:
    codec = make(tmp_path, ANGLE, WRAPPED, ONE)
    assert steps(codec, [100, 0, 65_436, 65_336, 65_236]) == [
        (100, []), (0, []), (None, JUMP), (-100, []), (-200, []),
    ]  # fmt: skip
    codec = make(tmp_path, ANGLE, WRAPPED, ONE)
    told = steps(codec, [0, 1000, 2000, 3000, 4000, 5000, 6000])
    assert told == [(0, []), (1000, []), (2000, []), (3000, []), (4000, []), (None, JUMP), (5000, [])]


def test_a_counter_that_begins_anew_at_each_revolution_is_told_where_nobody_said_so(tmp_path: Path) -> None:
    codec = make(tmp_path, ANGLE, UNWRAPPED, ONE)
    told = steps(codec, [3600, 3800, 4000, 104, 304, 504])
    assert told == [(3600, []), (3800, []), (4000, []), (None, JUMP), (4200, []), (4400, [])]


def test_a_wheel_that_really_turns_by_a_revolution_is_read(tmp_path: Path) -> None:
    codec = make(tmp_path, ANGLE, UNWRAPPED, ONE)
    for count in (0, 3000, 6000, 9000, 12_000):
        assert steps(codec, [count])[0][0] == count


def test_a_wheel_that_starts_between_two_slow_messages_is_read(tmp_path: Path) -> None:
    codec = make(tmp_path, ANGLE, UNWRAPPED, ONE)
    for index, count in enumerate((0, 0, 3000)):
        told = decode(codec, frame(0x100, struct.pack("<Hb5x", count, 0)), index * 1_000_000_000)
        assert [each.position_rad for each in wheel_samples(told)] == [pytest.approx(count / 4096 * TURN)]


def test_a_position_faster_than_any_wheel_is_told(tmp_path: Path) -> None:
    codec = make(tmp_path, WHEELS, TICKS)
    for index, (count, seen) in enumerate([(0, 0.0), (2_163_000, None), (2_163_100, 100 / 4096 * TURN)]):
        told = decode(codec, frame(0x100, struct.pack("<iI", count, 0)), index * 10_000_000)
        assert [each.position_rad for each in wheel_samples(told)] == (
            [] if seen is None else [pytest.approx(seen)]
        )


# Speeds that contradict positions


def drive(
    codec: CanWheelsCodec, true_rad_s: Sequence[float], factor: float, period_s: float = 0.01
) -> list[str]:
    position, found = 0.0, []
    for index, speed in enumerate(true_rad_s):
        position += speed * period_s
        data = struct.pack("<ihH", round(position / TURN * 4096), round(100 * factor * speed), 0)
        found += reasons(decode(codec, frame(0x100, data), round(index * period_s * 1e9)))
    return found


@pytest.mark.parametrize("factor", [0.0, -1.0, 9.549, 0.1047])
def test_a_speed_that_cannot_have_turned_the_wheel_is_told(tmp_path: Path, factor: float) -> None:
    found = drive(make(tmp_path, WHEELS, TICKS + SPEED), [8.0] * 60, factor)
    assert set(found) == {"speed_contradicts_position"}
    assert len(found) == 2


@pytest.mark.parametrize("period_s", [0.005, 0.05, 0.1, 0.25])
def test_a_speed_of_zero_is_told_at_any_rate(tmp_path: Path, period_s: float) -> None:
    speeds = [8.0] * int(2.0 / period_s)
    told = drive(make(tmp_path, WHEELS, TICKS + SPEED), speeds, 0.0, period_s)
    assert set(told) == {"speed_contradicts_position"}


@pytest.mark.parametrize("period_s", [0.005, 0.01, 0.05, 0.1])
def test_a_true_speed_is_not_told(tmp_path: Path, period_s: float) -> None:
    speeds = [10.0 * math.sin(6.0 * index * period_s) for index in range(int(5 / period_s))]
    assert drive(make(tmp_path, WHEELS, TICKS + SPEED), speeds, 1.0, period_s) == []


def test_messages_that_waited_are_not_compared(tmp_path: Path) -> None:
    codec = make(tmp_path, WHEELS, TICKS + SPEED)
    arrival_s = [index * 0.01 for index in range(100)]
    arrival_s[40:90] = [0.9] * 50
    for index, time_s in enumerate(arrival_s):
        data = struct.pack("<ihH", round(8.0 * index * 0.01 / TURN * 4096), 800, 0)
        assert reasons(decode(codec, frame(0x100, data), round(time_s * 1e9))) == []
