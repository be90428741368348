"""`rover-hil init` sets up a simulated rover that it knows nothing of, from answers on the standard input."""

import io
import math
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Self

import numpy as np
import pytest
from numpy.typing import NDArray
from pydantic import TypeAdapter

from controllers.ground_motion.rig import RigFile
from controllers.motion.rover_geometry import WheelsRoverSettings
from drivers.can.frame import CanFrame, unpack_can_frame
from drivers.can_wheels.mapping_file import SHIPPED_FOLDER, load_mapping
from drivers.can_wheels.settings import CanWheelsSettings
from drivers.canopen_wheels.settings import CanopenWheelsSettings
from drivers.clock import SystemClock, VirtualClock, nanoseconds
from drivers.errors import ConfigError
from drivers.link import Received
from drivers.nmea import encode_sentence
from drivers.registry import AnyDeviceSettings
from drivers.serial_link import SerialLink
from rover_hil.config import load_config
from rover_hil.console.ask import ask_choice
from rover_hil.doctor.finding import SystemPaths
from rover_hil.drives.drive import read_drive
from rover_hil.ready.set_up import command as init
from rover_hil.ready.set_up import probing, turning
from rover_hil.ready.set_up.cameras import ground_motion
from rover_hil.ready.set_up.command import POSITIONS
from rover_hil.ready.set_up.config_text import Answers, config_text
from rover_hil.ready.set_up.drives import (
    canopen_nodes,
    guess_mapping,
    reordered_text,
    shipped_mapping,
    vesc_nodes,
    write_mapping,
)
from rover_hil.ready.set_up.places import find_places
from rover_hil.ready.set_up.probing import max_age_s
from rover_hil.ready.set_up.simulated_rover import RoverTable, simulation_table
from rover_hil.recording.reader import LogReader
from rover_hil.recording.schema import ESTIMATE, ESTIMATE_SHAPE, EstimateRecord
from rover_hil.terminal import Terminal
from sim_backends.build import build_world
from tests.rover_hil.command import PROGRAM, Command, assert_one_sentence

EXAMPLES = Path(__file__).parents[2] / "docs" / "examples"
START_LIMIT_S = 60.0
ANSWERS = ("yes", "8192", "1", "yes", "0.06", "0.3", "yes", "right", "no", "left", "yes", "6")
"""The user calls wheel 0 the right one, turning backwards: as if the cables were swapped."""


@pytest.fixture
def ports(tmp_path: Path) -> Iterator[Path]:
    """Serve the differential rover, and give the folder of its ports."""
    text = (EXAMPLES / "differential.toml").read_text("utf-8")
    mapping = EXAMPLES / "can" / "differential.toml"
    (tmp_path / "sim.toml").write_text(
        text.replace("docs/examples/can/differential.toml", str(mapping)), "utf-8"
    )
    process = subprocess.Popen(
        [*PROGRAM, "simulate", "sim.toml"],
        cwd=tmp_path, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    try:
        clock = SystemClock()
        end_ns = clock.now_ns() + nanoseconds(START_LIMIT_S)
        while not os.path.lexists(tmp_path / "ports" / "imu") and clock.now_ns() < end_ns:
            clock.sleep_until(clock.now_ns() + nanoseconds(0.05))
        imu = str(tmp_path / "ports" / "imu")
        while not probing._listen_raw(SerialLink(imu, 115_200, clock, 0.0), clock, 0.2):
            assert clock.now_ns() < end_ns  # the simulator compiles before it sends
        yield tmp_path / "ports"
    finally:
        process.terminate()
        process.wait(START_LIMIT_S)


@pytest.fixture
def answers(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Give the list of answers to fill, and make the waits short."""
    lines: list[str] = []

    class Answers:
        def readline(self) -> str:
            return f"{lines.pop(0)}\n" if lines else ""

        def isatty(self) -> bool:
            return False

    monkeypatch.setattr(sys, "stdin", Answers())
    monkeypatch.setattr(turning, "TURN_S", 0.5)
    monkeypatch.setattr(turning, "REST_S", 0.2)
    return lines


@pytest.mark.slow
def test_a_rover_with_its_own_dbc_file_gets_a_valid_configuration(
    command: Command, ports: Path, answers: list[str], tmp_path: Path
) -> None:
    shutil.copy(EXAMPLES / "can" / "differential.dbc", tmp_path / "mine.dbc")
    answers += ANSWERS
    assert command("init", "rover.toml", "--dbc", "mine.dbc", "--ports", "ports", "--drive") == 0, (
        command.error
    )
    assert answers == []
    assert "rover.toml is written and valid" in command.error
    config = load_config("rover.toml")
    assert {name: device.type for name, device in config.devices.items()} == {
        "wheels": "can_wheels",
        "imu": "witmotion",
    }
    assert config.roles.gyro == "imu"
    assert config.rover.wheel_radius_m == 0.06
    assert config.safety.check_manoeuvre
    wheels = load_mapping("rover_can.toml").mapping.wheel
    assert [(wheel.node, wheel.sign) for wheel in wheels] == [(1, 1), (0, -1)]
    assert wheels[0].position is not None
    assert wheels[0].position.ticks_per_revolution == 8192
    assert command("check", "rover.toml") == 0
    # Nothing is overwritten, and what fails leaves nothing behind.
    assert command("init", "rover.toml", "--ports", "ports") == 2
    assert_one_sentence(command.error, "rover.toml exists", "--force")
    answers += ANSWERS[:3]
    assert command("init", "other.toml", "--dbc", "mine.dbc", "--ports", "ports") == 2
    assert "got no answer" in command.error
    assert not list(tmp_path.glob("other*"))


def test_without_a_drive_nothing_is_written(
    command: Command, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(
        "rover_hil.ready.set_up.command.SystemPaths", lambda: SystemPaths(tmp_path, tmp_path, tmp_path)
    )
    assert command("init", "rover.toml") == 1
    assert "no drive was recognised" in command.error
    assert list(tmp_path.iterdir()) == []
    assert command("init", "rover.toml", "--dbc", "none.dbc") == 2
    assert_one_sentence(command.error, "no DBC file none.dbc")


def test_a_file_that_is_no_dbc_file_is_refused_and_one_without_a_bus_is_not_used(
    command: Command, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(
        "rover_hil.ready.set_up.command.SystemPaths", lambda: SystemPaths(tmp_path, tmp_path, tmp_path)
    )
    for text in ("hello\n", ""):
        (tmp_path / "mine.dbc").write_text(text)
        assert command("init", "rover.toml", "--dbc", "mine.dbc") == 2
        assert_one_sentence(command.error, "cannot read DBC file mine.dbc", "give another")
    shutil.copy(EXAMPLES / "can" / "differential.dbc", tmp_path / "mine.dbc")
    assert command("init", "rover.toml", "--dbc", "mine.dbc") == 1
    assert "mine.dbc is not used: no CAN bus was found" in command.error


def test_where_the_configuration_cannot_be_written_nothing_is_asked(
    command: Command, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr("rover_hil.ready.set_up.command._look", None)
    (tmp_path / "taken.toml").write_text("mine")
    for out, words in (
        ("taken.toml", "choose another OUT"),
        ("none/rover.toml", "choose another OUT"),
        (".", "name a file with OUT"),
        ("/proc/rover.toml", "cannot write /proc/rover.toml"),
    ):
        assert command("init", out) == 2
        assert_one_sentence(command.error, words)
        assert "--out" not in command.error


def test_a_wheel_may_be_named_by_its_number(
    monkeypatch: pytest.MonkeyPatch, answers: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys.stdin, "isatty", lambda: True)
    answers += ["6", "60", "none"]
    choices = (*POSITIONS["omni3"], "none")
    assert ask_choice("Which wheel moved", choices, choices[1]) == "at 60 deg"
    assert ask_choice("Which wheel moved", choices, choices[1]) == "none"
    asked = capsys.readouterr().err
    assert asked.startswith("Which wheel moved: at 60 deg, at 180 deg, at 300 deg, none? [at 180 deg]: ")
    assert "'6' is none of them" in asked


def wheel_frames(name: str) -> list[CanFrame]:
    """Return what the drives of a configuration send in a third of a second."""
    config = load_config(name)
    wheels = {"wheels": config.devices["wheels"]}
    simulation = config.require_simulation().model_copy(update={"devices": {}, "faults": ()})
    world = build_world(wheels, simulation, 0)
    world.advance(nanoseconds(0.3))
    payloads = world.byte_devices["wheels"].to_host.take(nanoseconds(0.3))
    return [frame for each in payloads if (frame := unpack_can_frame(each.payload)) is not None]


def test_counter_and_checksum_of_a_dbc_file_are_found(tmp_path: Path) -> None:
    frames = wheel_frames("el-dorado")
    assert shipped_mapping(frames) == "generic_wheel"
    dbc = tmp_path / "mine.dbc"
    shutil.copy(SHIPPED_FOLDER / "generic_wheel.dbc", dbc)
    guess = guess_mapping(dbc, frames)
    assert guess.nodes == [0, 1, 2, 3]
    assert guess.needs_ticks
    guess.every_wheel["position"]["ticks_per_revolution"] = 4096
    path = tmp_path / "mine.toml"
    write_mapping(path, dbc, guess, frames, gear_ratio=1.0)
    found, shipped = load_mapping(str(path)).mapping, load_mapping("generic_wheel").mapping
    for wheel, expected in zip(found.wheel, shipped.wheel, strict=True):
        assert (wheel.position, wheel.speed, wheel.current) == (
            expected.position,
            expected.speed,
            expected.current,
        )
        assert wheel.setpoint == expected.setpoint
    assert found.protection[0].algorithm == "crc8_j1850"
    assert found.protection[0].counter == "Counter"


@pytest.mark.parametrize(
    ("places", "name"),
    [
        (("FL", "FR", "RL", "RR"), "MCU_{}_Feedback"),
        (("front_left", "front_right", "rear_left", "rear_right"), "{}_state"),
        (("FrontLeft", "FrontRight", "RearLeft", "RearRight"), "Wheel{}State"),
    ],
)
def test_drives_that_are_called_by_their_places_are_found_in_their_order(
    tmp_path: Path, places: tuple[str, ...], name: str
) -> None:
    """Messages stand in another order in the file; the wheels come from the front left on."""
    frames = wheel_frames("el-dorado")
    text = (SHIPPED_FOLDER / "generic_wheel.dbc").read_text("utf-8")
    for number, place in enumerate(places):
        text = text.replace(f"Wheel{number}_State", name.format(place))
        text = text.replace(f"Wheel{number}_Setpoint", name.format(place) + "_Setpoint")
    (tmp_path / "mine.dbc").write_text(text, "utf-8")
    guess = guess_mapping(tmp_path / "mine.dbc", frames)
    assert guess.nodes == list(places)
    guess.every_wheel["position"]["ticks_per_revolution"] = 4096
    write_mapping(tmp_path / "mine.toml", tmp_path / "mine.dbc", guess, frames, gear_ratio=1.0)
    wheels = load_mapping(str(tmp_path / "mine.toml")).mapping.wheel
    assert [wheel.position.message for wheel in wheels if wheel.position] == [name.format(p) for p in places]


def test_a_dbc_file_without_drives_is_refused(tmp_path: Path) -> None:
    (tmp_path / "mine.dbc").write_text(
        'VERSION ""\n\nBU_: A\n\nBO_ 5 Lamp: 1 A\n SG_ On : 0|1@1+ (1,0) [0|1] "" A\n'
    )
    with pytest.raises(ConfigError, match="no messages with a position or speed"):
        guess_mapping(tmp_path / "mine.dbc", wheel_frames("el-dorado"))
    (tmp_path / "mine.dbc").write_text("\0")
    with pytest.raises(ConfigError, match=r"cannot read DBC file|no messages"):
        guess_mapping(tmp_path / "mine.dbc", [])


def test_vesc_controllers_are_found_by_their_status_messages() -> None:
    frames = [CanFrame(kind << 8 | node, bytes(8), is_extended=True) for node in (3, 7) for kind in (9, 27)]
    assert vesc_nodes([*frames, CanFrame(9 << 8 | 5, bytes(8), is_extended=True)]) == [3, 7]
    assert shipped_mapping(frames) == ""


def test_wheels_of_a_mapping_are_reordered_and_the_rest_stays() -> None:
    text = (SHIPPED_FOLDER / "generic_wheel.toml").read_text("utf-8")
    found = reordered_text(text, [2, 0, 3, 1], [1, -1, 1, 1])
    assert [line for line in found.splitlines() if line.startswith(("node", "sign ="))] == [
        "node = 2", "node = 0", "sign = -1", "node = 3", "node = 1",
    ]  # fmt: skip
    assert found.count("[[protection]]") == text.count("[[protection]]") == 1
    assert reordered_text(found, [0, 1, 2, 3], [1, 1, 1, 1]).count("sign = -1") == 1
    assert reordered_text(found, [0, 1, 2, 3], [1, -1, 1, 1]).count("sign =") == 0
    steered = reordered_text(found, [0, 1, 2, 3], [1, -1, 1, 1], [1, 1, -1, 1])
    assert steered.count("sign =") == steered.count("steering_sign = -1") == 1


def test_steering_drives_of_a_dbc_file_are_found(tmp_path: Path) -> None:
    frames = wheel_frames("el-dorado-crab")
    dbc = tmp_path / "mine.dbc"
    shutil.copy(SHIPPED_FOLDER / "steered_wheel.dbc", dbc)
    guess = guess_mapping(dbc, frames)
    assert guess.nodes == [0, 1, 2, 3]
    guess.every_wheel["position"]["ticks_per_revolution"] = 4096
    path = tmp_path / "mine.toml"
    write_mapping(path, dbc, guess, frames, gear_ratio=1.0)
    found, shipped = load_mapping(str(path)).mapping, load_mapping("steered_wheel").mapping
    for wheel, expected in zip(found.wheel, shipped.wheel, strict=True):
        assert wheel.position == expected.position
        assert wheel.setpoint == expected.setpoint
        assert wheel.steering == expected.steering
        assert wheel.steering_setpoint == expected.steering_setpoint


def test_a_steering_angle_beside_the_position_of_a_wheel_is_not_taken_for_it(tmp_path: Path) -> None:
    text = """VERSION ""
BU_: Host Drive
"""
    for node in range(2):
        text += f"""BO_ {272 + node} Wheel{node}_Status: 6 Drive
 SG_ SteerAngle : 0|16@1- (0.01,0) [-180|180] "deg" Host
 SG_ Position : 16|32@1- (0.001,0) [-1000000|1000000] "rad" Host
BO_ {288 + node} Wheel{node}_Setpoint: 6 Host
 SG_ SteerSpeed : 0|16@1- (0.001,0) [-32|32] "rad/s" Drive
 SG_ Speed : 16|16@1- (0.001,0) [-32|32] "rad/s" Drive
 SG_ Angle : 32|16@1- (0.01,0) [-180|180] "deg" Drive
"""
    dbc = tmp_path / "mine.dbc"
    dbc.write_text(text, "utf-8")
    found = guess_mapping(dbc, [CanFrame(272 + node, bytes(6), False) for node in range(2)]).every_wheel
    signals = {key: value["signal"] for key, value in found.items()}
    assert signals == {
        "position": "Position", "setpoint": "Speed", "steering": "SteerAngle", "steering_setpoint": "Angle"
    }  # fmt: skip


def test_a_mapping_of_an_earlier_configuration_is_kept_where_the_command_ends_early(
    command: Command, answers: list[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    config = load_config("el-dorado-crab")
    found = probing.Found(
        settings=config.devices["wheels"],
        what="CAN bus",
        kinds=frozenset({"can"}),
        rate_hz=100.0,
        frames=tuple(wheel_frames("el-dorado-crab")),
    )
    monkeypatch.setattr(init, "_look", lambda *_: [found])
    shutil.copy(SHIPPED_FOLDER / "steered_wheel.dbc", tmp_path / "mine.dbc")
    mapping = tmp_path / "rover_can.toml"
    mapping.write_text("mine", "utf-8")
    assert command("init", "rover.toml", "--dbc", "mine.dbc") == 2
    assert_one_sentence(command.error, "rover_can.toml exists", "--force")  # before any question
    answers += ["yes", "4096", "1"]
    assert command("init", "rover.toml", "--dbc", "mine.dbc", "--force") == 2
    assert "got no answer" in command.error
    assert mapping.read_text("utf-8") == "mine"


@pytest.mark.parametrize("measured", ["position", "speed"])
@pytest.mark.parametrize(
    ("state", "command"), [("SteerAngle", "SteerTarget"), ("Angle", "Angle"), ("steeringPos", "SteerRef")]
)
def test_a_steering_angle_in_the_message_of_the_wheel_is_not_its_position(
    tmp_path: Path, measured: str, state: str, command: str
) -> None:
    """As in docs/examples/can/six_wheels.dbc; the angle comes first in its message."""
    signals = {
        "position": ' SG_ EncoderPos : 16|32@1- (1,0) [0|0] "ticks" Host\n',
        "speed": ' SG_ Speed : 16|16@1- (0.1,0) [0|0] "rpm" Host\n',
    }
    (tmp_path / "mine.dbc").write_text(
        'VERSION ""\n\nBU_: Host Motor\n'
        + "".join(
            f"\nBO_ {800 + node} Motor{node}_Command: 4 Host\n"
            f' SG_ {command} : 16|16@1- (0.01,0) [0|0] "deg" Motor\n'
            f' SG_ Speed : 0|16@1- (0.01,0) [0|0] "rpm" Motor\n'
            f"\nBO_ {816 + node} Motor{node}_Status: 8 Motor\n"
            f' SG_ {state} : 0|16@1- (0.01,0) [0|0] "deg" Host\n{signals[measured]}'
            for node in range(1, 5)
        )
    )
    guess = guess_mapping(tmp_path / "mine.dbc", [CanFrame(816 + node, bytes(8)) for node in range(1, 5)])
    assert guess.nodes == [1, 2, 3, 4]
    assert {key: value["signal"] for key, value in guess.every_wheel.items()} == {
        measured: "EncoderPos" if measured == "position" else "Speed",
        "setpoint": "Speed",
        "steering": state,
        "steering_setpoint": command,
    }


def test_a_rover_with_four_steered_wheels_is_described(
    answers: list[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """The third drive steers the wrong way."""
    monkeypatch.chdir(tmp_path)
    steered: list[tuple[int, float]] = []

    class Turner:
        wheel_count = 4

        def __init__(self, *arguments: object) -> None: ...

        def __enter__(self) -> Self:
            return self

        def __exit__(self, *error: object) -> None: ...

        def turn(self, wheel: int, step: object) -> list[float]:
            return [1.0 if each == wheel else 0.0 for each in range(4)]

        def steer(self, wheel: int, angle_rad: float, step: object) -> None:
            steered.append((wheel, angle_rad))

    monkeypatch.setattr(init, "Turner", Turner)
    Path("mine.toml").write_text((SHIPPED_FOLDER / "steered_wheel.toml").read_text("utf-8"), "utf-8")
    shutil.copy(SHIPPED_FOLDER / "steered_wheel.dbc", ".")
    bus = CanWheelsSettings(interface="socketcan", channel="can0", mapping="mine.toml")
    console = Terminal(file=io.StringIO())
    limits_rad = dict.fromkeys(range(4), (-1.5, 1.2))
    answers += ["0.092", "0.44", "0.6", "60", "17"]
    kind, rover = init._rover(4, limits_rad, console)
    assert answers == []
    found = WheelsRoverSettings.model_validate(rover)
    assert kind == "steered_4"
    assert [(wheel.x_m, wheel.y_m) for wheel in found.wheels] == [
        (0.3, 0.22), (0.3, -0.22), (-0.3, 0.22), (-0.3, -0.22),
    ]  # fmt: skip
    assert found.wheels[0].steering is not None
    assert found.wheels[0].steering.high_deg == 60.0
    answers += ["yes"]
    for place, points_left in (
        ("front left", "yes"),
        ("front right", "yes"),
        ("rear left", "no"),
        ("rear right", "yes"),
    ):
        answers += [place, "yes", points_left]
    init._turn_wheels(bus, "drives", kind, {}, console, may_drive=True)
    assert answers == []
    assert steered == [(wheel, angle) for wheel in range(4) for angle in (init.STEER_RAD, 0.0)]
    signs = [wheel.steering_sign for wheel in load_mapping("mine.toml").mapping.wheel]
    assert signs == [1, 1, -1, 1]
    with pytest.raises(ConfigError, match="4 wheels, 2 of which steer"):
        init._rover(4, dict.fromkeys((0, 1), (-1.0, 1.0)), console)


def test_steering_drives_that_take_angles_of_one_sign_only_are_named(answers: list[str]) -> None:
    """As of a DBC file with an unsigned signal, whose offset was forgotten."""
    answers += ["0.092", "0.44", "0.6"]
    with pytest.raises(ConfigError, match=r"reach 0 deg to one side, less than 10: .*DBC"):
        init._rover(4, dict.fromkeys(range(4), (0.0, 6.2)), Terminal(file=io.StringIO()))


@pytest.mark.parametrize(
    ("payload", "expected"), [(encode_sentence("HCHDM,12.0,M"), "nmea_compass"), (b"?#", "")]
)
def test_a_talker_is_known_by_what_it_says(payload: bytes, expected: str) -> None:
    arrivals = [Received(1 + index, payload) for index in range(8)]
    found = probing._talker("/dev/ttyUSB0", 4800, arrivals, 0.8)
    assert (found.settings.type if found else "") == expected


def test_a_port_is_listed_once_under_the_name_that_stays(tmp_path: Path) -> None:
    (tmp_path / "serial" / "by-id").mkdir(parents=True)
    (tmp_path / "ttyUSB0").touch()
    (tmp_path / "ttyUSB1").touch()
    (tmp_path / "serial" / "by-id" / "usb-imu").symlink_to(tmp_path / "ttyUSB0")
    (tmp_path / "class" / "net" / "can0").mkdir(parents=True)
    (tmp_path / "class" / "net" / "can0" / "type").write_text("280\n")
    places = find_places(SystemPaths(tmp_path, tmp_path, tmp_path), None)
    assert places.serial == [str(tmp_path / "serial" / "by-id" / "usb-imu"), str(tmp_path / "ttyUSB1")]
    assert places.can == ["can0"]
    assert places.cameras == []


def test_every_kind_of_rover_has_names_for_its_wheels() -> None:
    assert {kind: len(names) for kind, names in POSITIONS.items()} == {
        "differential": 2,
        "omni3": 3,
        "skid_steer_4": 4,
        "steered_4": 4,
    }
    assert max_age_s(50.0) == 0.15
    assert max_age_s(10.0) == 0.25


def test_canopen_nodes_are_those_with_heartbeats() -> None:
    frames = [
        CanFrame(0x701, b"\x7f"), CanFrame(0x703, b"\x05"), CanFrame(0x703, b"\x05"),
        CanFrame(0x702, b"\x05\x00"), CanFrame(0x704, b"\x11"), CanFrame(0x700, b"\x05"),
        CanFrame(0x705, b"\x05", is_extended=True), CanFrame(0x181, b"\x00" * 8),
    ]  # fmt: skip
    assert canopen_nodes(frames) == [1, 3]


def test_canopen_drives_are_proposed_and_put_in_order(answers: list[str]) -> None:
    bus = CanWheelsSettings(interface="socketcan", channel="can0", mapping="generic_wheel")
    frames = tuple(CanFrame(0x700 + node, b"\x05") for node in (1, 2))
    found = probing.Found(settings=bus, what="", kinds=frozenset({"can"}), rate_hz=1.0, frames=frames)
    answers += ["yes", "2000", "30", "4000"]
    console = Terminal(file=io.StringIO())
    drive = init._drive_of(found, None, Path("rover.toml"), {}, console, force=False)
    assert isinstance(drive, CanopenWheelsSettings)
    assert [wheel.node for wheel in drive.wheel] == [1, 2]
    assert (drive.counts_per_motor_turn, drive.gear_ratio, drive.rpm_limit) == (2000, 30.0, 4000)
    turned = init._reordered(drive, [1, 0], [-1, 1], [1, 1], {}, console)
    assert isinstance(turned, CanopenWheelsSettings)
    assert [(wheel.node, wheel.sign) for wheel in turned.wheel] == [(2, -1), (1, 1)]


class SlowClock(VirtualClock):
    """A clock of a loaded machine: every wait takes four times as long."""

    def sleep_until(self, t_ns: int) -> None:
        super().sleep_until(t_ns + 3 * max(0, t_ns - self.now_ns()))


@pytest.mark.parametrize(
    ("clock", "load", "words"),
    [
        (VirtualClock(), 0.5, ""),
        (SlowClock(), 0.5, "a wait of 10 ms took 40 ms"),
        (VirtualClock(), 23.0, "23 programs want its 2 processors"),
    ],
)
def test_a_busy_machine_is_measured(
    monkeypatch: pytest.MonkeyPatch, clock: VirtualClock, load: float, words: str
) -> None:
    monkeypatch.setattr(os, "getloadavg", lambda: (load, 0.0, 0.0))
    monkeypatch.setattr(os, "cpu_count", lambda: 2)
    told = probing.busy_words(clock)
    assert bool(told) is bool(words)
    assert words in told


@pytest.mark.parametrize("words", ["", "this machine is too busy: 23 programs"])
def test_nothing_found_on_a_busy_machine_says_so(
    command: Command, monkeypatch: pytest.MonkeyPatch, words: str
) -> None:
    places = SimpleNamespace(serial=["/dev/ttyUSB7"], can=[], cameras=[])
    monkeypatch.setattr("rover_hil.ready.set_up.command.find_places", lambda system, ports: places)
    monkeypatch.setattr("rover_hil.ready.set_up.command.probe_serial", lambda port, clock, step: "silent")
    monkeypatch.setattr("rover_hil.ready.set_up.command.busy_words", lambda clock: words)
    assert command("init", "rover.toml") == 1
    assert ("too busy" in command.error) is bool(words)
    assert "/dev/ttyUSB7: silent" in command.error


@pytest.fixture
def drive_log(command: Command, tmp_path: Path) -> Path:
    """Return the CAN log of a simulated drive, setpoints of the host included, beside its DBC file."""
    for name in ("differential.toml", "can"):
        source = EXAMPLES / name
        if source.is_dir():
            shutil.copytree(source, tmp_path / "docs" / "examples" / name)
        else:
            shutil.copy(source, tmp_path)
    shutil.copy(EXAMPLES / "can" / "differential.dbc", tmp_path / "own.dbc")
    assert command("run", "differential.toml", "--virtual", "--duration", "4", "--out", "drive") == 0
    assert command("export", "drive/run.mcap", "--can", "--out", "drive.log") == 0, command.error
    return tmp_path / "drive.log"


def test_a_can_log_becomes_a_configuration_that_drives_in_the_simulator(
    command: Command, answers: list[str], drive_log: Path
) -> None:
    answers += ["yes", "8192", "1", "0.06", "0.3", "6"]
    assert command("init", "rover.toml", "--can", drive_log.name, "--dbc", "own.dbc") == 0, command.error
    assert answers == []
    assert "the log says neither interface nor bit rate" in command.error
    wheels = load_mapping("rover_can.toml").mapping.wheel
    assert [wheel.setpoint.message for wheel in wheels if wheel.setpoint] == [
        "Wheel0_Setpoint",
        "Wheel1_Setpoint",
    ]
    assert command("run", "rover.toml", "--virtual", "--out", "virtual") == 0, command.error
    assert "mission finished" in command.out + command.error


def test_a_can_log_that_is_none_and_options_of_devices_are_refused(command: Command, tmp_path: Path) -> None:
    assert command("init", "rover.toml", "--can", "none.log") == 2
    assert_one_sentence(command.error, "none.log")
    assert command("init", "rover.toml", "--can", "none.log", "--drive") == 2
    assert_one_sentence(command.error, "--can reads a log, no device: leave --ports and --drive out")
    assert list(tmp_path.iterdir()) == []


STEERING = {"low_deg": -45.0, "high_deg": 45.0, "rate_deg_s": 30.0}
ROVERS: dict[str, RoverTable] = {
    "omni3": {"kinematics": "omni3", "wheel_radius_m": 0.04, "base_radius_m": 0.125},
    "skid_steer_4": {"kinematics": "skid_steer_4", "wheel_radius_m": 0.1, "track_m": 0.5},
    "steered_4": {
        "kinematics": "wheels",
        "wheels": [
            {"x_m": x_m, "y_m": y_m, "radius_m": 0.1, "steering": STEERING}
            for x_m in (0.3, -0.3)
            for y_m in (0.25, -0.25)
        ],
    },
}


@pytest.mark.parametrize("kind", ROVERS)
def test_every_kind_of_rover_gets_a_simulation_that_drives_straight(
    command: Command, kind: str, tmp_path: Path
) -> None:
    rover = ROVERS[kind]
    count = 3 if kind == "omni3" else 4
    drives = {"type": "canopen_wheels", "interface": "virtual", "channel": "bus",
              "wheel": [{"node": node} for node in range(1, count + 1)],
              "counts_per_motor_turn": 4096, "gear_ratio": 50.0}  # fmt: skip
    mapping = {"type": "can_wheels", "interface": "virtual", "channel": "bus", "mapping": "steered_wheel"}
    wheels = TypeAdapter(AnyDeviceSettings).validate_python(mapping if kind == "steered_4" else drives)
    text = config_text(
        Answers(
            rover=rover,
            devices=[("wheels", wheels, "drives")],
            wheels="wheels",
            gyro=None,
            headings=[],
            fixes=[],
            wheel_speed_rad_s=5.0,
            moves_sideways=kind == "omni3",
            speed_m_s=0.1,
            simulation=simulation_table(rover, wheels.type, 5.0),
        )
    )
    (tmp_path / "rover.toml").write_text(text, "utf-8")
    assert command("run", "rover.toml", "--virtual", "--out", "virtual") == 0, command.error
    true = read_drive(Path("virtual/run.mcap")).true_poses()
    assert true.x_m[-1] - true.x_m[0] == pytest.approx(0.5, abs=0.05)
    assert abs(true.y_m[-1] - true.y_m[0]) < 0.05


def found(kind: str, **settings: object) -> probing.Found:
    device = TypeAdapter(AnyDeviceSettings).validate_python(settings)
    return probing.Found(settings=device, what=kind, kinds=frozenset({kind}), rate_hz=50.0)


BOARD = found("wheels", type="robotino_board", port="ports/board", max_age_s=0.15)
GYRO = found("rate", type="witmotion", port="ports/imu", max_age_s=0.15)
CAMERA = found(
    "frames", type="camera", source="live_folder", path="ports/camera", width=640, height=480,
    frame_rate_hz=10, max_age_s=0.5,
)  # fmt: skip
FOUR_WHEELS = found(
    "wheels", type="canopen_wheels", interface="virtual", channel="bus", max_age_s=0.15,
    wheel=[{"node": node} for node in range(1, 5)], counts_per_motor_turn=4096, gear_ratio=50.0,
)  # fmt: skip
TO_THE_CAMERA = ("yes", "yes", "0.04", "0.125", "no", "5")
"""Use gyro and camera; the Robotino; no wheel is turned; the speed."""
OVERHEAD = (*TO_THE_CAMERA, "overhead", "2.5", "2.4", "7", "0.12", "0.2")
TRACE = ("yes", "yes", "0.1", "0.5", "no", "5", "trace", "0.6", "0.5", "60", "-0.32", "60", "no", "0.1")


@pytest.fixture
def on_ports(monkeypatch: pytest.MonkeyPatch) -> list[probing.Found]:
    """Give the list of devices that are found."""
    devices = [BOARD, GYRO, CAMERA]
    monkeypatch.setattr(init, "_look", lambda *_: devices)
    return devices


def estimates() -> list[EstimateRecord]:
    """Return the cycles of the run."""
    messages = LogReader(Path("virtual/run.mcap")).messages()
    return [ESTIMATE_SHAPE.validate_json(each.data) for each in messages if each.topic == ESTIMATE]


def middle_of_the_view(rig: RigFile) -> NDArray[np.float64]:
    """Return where the ray through the middle of the picture meets the ground."""
    (columns, _, right), (_, rows, down), _ = rig.camera_matrix
    assert (columns, right, down) == (rows, (rig.image.width - 1) / 2, (rig.image.height - 1) / 2)
    ray = np.array(rig.R_vehicle_camera) @ (0.0, 0.0, 1.0)
    lens = np.array(rig.t_vehicle_camera)
    return np.asarray(lens - ray * (lens[2] / ray[2]), np.float64)


@pytest.mark.parametrize(
    ("looks", "away", "upside_down"),
    [("back", (-1, 0), "no"), ("ahead", (1, 0), "yes"), ("left", (0, 1), "no"), ("right", (0, -1), "no")],
)
@pytest.mark.usefixtures("on_ports")
def test_a_ground_camera_gets_a_rig_by_rulers(
    command: Command, answers: list[str], looks: str, away: tuple[int, int], upside_down: str
) -> None:
    answers += [*TO_THE_CAMERA, "ground", looks, "0.5", "60", "-0.3", "0.1", "60", upside_down, "12.6"]
    assert command("init", "rover.toml") == 0, command.error
    assert answers == []
    assert "calibration by rulers written: rover_rig.json" in command.error
    assert "`rover-hil calibrate scale rover.toml --out scale.toml --enter`" in command.error
    config = load_config("rover.toml")
    assert config.roles.camera == "camera"
    ground, slip = config.ground_motion, config.slip
    assert ground is not None
    assert ground.greatest_age_s == 0.5
    reach_m = 0.5 / math.tan(math.radians(60.0))
    expected = (-0.3 + away[0] * reach_m, 0.1 + away[1] * reach_m, 0.0)
    assert middle_of_the_view(ground.rig) == pytest.approx(expected, abs=1e-6)
    rotation = np.array(ground.rig.R_vehicle_camera)
    assert np.linalg.det(rotation) == pytest.approx(1.0)
    assert rotation[2, 0] == 0.0  # level
    assert (rotation[2, 1] > 0.0) == (upside_down == "yes")
    half_view = math.atan(ground.rig.image.width / 2 / ground.rig.camera_matrix[0][0])
    assert 2.0 * math.degrees(half_view) == pytest.approx(60.0)
    assert slip is not None
    assert (slip.use, slip.excite_beside_ground, slip.excitation.mass_kg) == ("yaw_probe", False, 12.6)
    assert config.safety.check_manoeuvre  # its rotation shows a wrong height or yaw of the camera
    assert command("check", "rover.toml") == 0
    assert "warning: camera: its rig has no lens distortion, like one by rulers" in command.out
    assert "run `rover-hil calibrate scale CONFIG --enter --out FILE`" in command.out
    assert "  run --virtual: yes\n" in command.out
    assert "  slip: ground motion by camera" in command.out
    assert "then yaw excitation (on the real rover after commissioning)" in command.out


@pytest.mark.slow
@pytest.mark.parametrize(
    "given",
    [
        pytest.param(
            (*TO_THE_CAMERA, "ground", "back", "0.5", "65", "-0.2", "0", "60", "no", "12.6"),
            marks=pytest.mark.nightly,
            id="back",
        ),
        pytest.param(
            (*TO_THE_CAMERA, "ground", "left", "0.5", "65", "0", "0.2", "60", "yes", "12.6"), id="left"
        ),
        pytest.param(TRACE, marks=pytest.mark.nightly, id="trace"),
    ],
)
def test_the_simulated_ground_camera_measures_the_slip(
    command: Command, answers: list[str], on_ports: list[probing.Found], given: tuple[str, ...]
) -> None:
    """The rig that is written, and the simulated camera, share no code."""
    on_ports[0] = FOUR_WHEELS if given is TRACE else BOARD
    answers += given
    assert command("init", "rover.toml") == 0, command.error
    assert command("run", "rover.toml", "--virtual", "--out", "virtual") == 0, command.error
    reports = [report for row in estimates() if (report := row.get("ground")) is not None]
    assert sum(not report["reason"] for report in reports) > 0.6 * len(reports)
    slips = [report["slip"] for report in reports if report["slip"] is not None]
    assert abs(float(np.median(slips))) < 0.04


@pytest.mark.slow
@pytest.mark.usefixtures("on_ports")
def test_the_simulated_overhead_camera_measures_the_pose(command: Command, answers: list[str]) -> None:
    answers += OVERHEAD
    assert command("init", "rover.toml") == 0, command.error
    assert command("run", "rover.toml", "--virtual", "--out", "virtual") == 0, command.error
    estimate = estimates()[-1]["estimate"]
    true = read_drive(Path("virtual/run.mcap")).true_poses()
    assert (estimate["x_m"], estimate["y_m"]) == pytest.approx((true.x_m[-1], true.y_m[-1]), abs=0.01)


def test_the_time_without_a_valid_pair_fits_the_frame_rate() -> None:
    ages_s = [ground_motion("rig.json", rate_hz)["greatest_age_s"] for rate_hz in (10.0, 5.0, 2.0)]
    assert ages_s == [0.5, 0.5, 1.25]


def test_a_view_that_cannot_be_simulated_is_written_without_simulation(
    command: Command, answers: list[str], on_ports: list[probing.Found]
) -> None:
    answers += [*TO_THE_CAMERA, "ground", "ahead", "0.8", "40", "0.2", "0", "70", "no", "12.6"]
    assert command("init", "rover.toml") == 0, command.error
    assert "simulated camera views ground more than 1.3 m from its wheel" in command.error
    assert "[simulation] is left out: `run --virtual` is not possible" in command.error
    assert "--virtual`\n" not in command.error.replace("left out: `run --virtual`", "")
    assert load_config("rover.toml").simulation is None


@pytest.mark.usefixtures("on_ports")
def test_a_camera_that_looks_elsewhere_measures_nothing(command: Command, answers: list[str]) -> None:
    answers += [*TO_THE_CAMERA, ""]
    assert command("init", "rover.toml") == 0, command.error
    config = load_config("rover.toml")
    assert "camera" in config.devices
    assert (config.roles.camera, config.ground_motion, config.slip) == (None, None, None)


@pytest.mark.usefixtures("on_ports")
def test_an_overhead_camera_gives_pose_fixes(command: Command, answers: list[str]) -> None:
    answers += OVERHEAD
    assert command("init", "rover.toml") == 0, command.error
    assert answers == []
    config = load_config("rover.toml")
    assert config.roles.fixes == ("camera",)
    assert config.devices["camera"].type == "overhead_camera"
    assert command("check", "rover.toml") == 0
    assert "  run --virtual: yes\n" in command.out


def test_the_trace_of_a_wheel_is_used_by_ground_motion_and_scomp(
    command: Command, answers: list[str], on_ports: list[probing.Found]
) -> None:
    on_ports[0] = FOUR_WHEELS
    answers += TRACE
    assert command("init", "rover.toml") == 0, command.error
    assert answers == []
    config = load_config("rover.toml")
    assert config.scomp is not None
    assert config.ground_motion is not None
    rig = config.ground_motion.rig
    assert config.scomp.rig == rig
    assert rig.wheel is not None
    assert rig.wheel.contact_point == (-0.3, 0.25, 0.0)
    assert rig.geometry().lead_m == pytest.approx((0.6, 0.0))
    assert command("check", "rover.toml") == 0
    assert "  run --virtual: yes\n" in command.out
    assert "then slip law with the wheel trace by camera" in command.out


@pytest.mark.usefixtures("on_ports")
def test_a_wrong_answer_about_the_camera_is_asked_again_at_a_terminal(
    command: Command, monkeypatch: pytest.MonkeyPatch, answers: list[str], tmp_path: Path
) -> None:
    wrong = [*TO_THE_CAMERA, "ground", "back", "50"]
    answers += wrong
    assert command("init", "rover.toml") == 2
    assert "50 is outside 0.1 .. 3" in command.error
    answers[:] = [*wrong[:-1], "0.5", "60", "-0.3", "0.1", "60", "no", "heavy"]
    assert command("init", "rover.toml") == 2
    assert "rover_rig.json" in command.error
    assert list(tmp_path.glob("rover*")) == []  # nor the rig
    monkeypatch.setattr(sys.stdin, "isatty", lambda: True)
    answers[:] = [*wrong, "0.5", "60", "-0.3", "0.1", "sixty", "60", "no", "12.6"]
    assert command("init", "rover.toml") == 0, command.error
    assert "'sixty' is not a number" in command.error
    assert answers == []
