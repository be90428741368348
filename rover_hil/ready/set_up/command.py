"""`rover-hil init`: find the devices, ask for the rest, and write a configuration that passes `check`."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from drivers.camera.settings import CameraSettings
from drivers.can_wheels.mapping_file import SHIPPED_FOLDER
from drivers.can_wheels.settings import CanWheelsSettings
from drivers.canopen_wheels.settings import CanopenWheelsSettings
from drivers.clock import SystemClock
from drivers.device_settings import DriveSettings
from drivers.driver import SteeringCodec
from drivers.errors import ConfigError, NotConnectedError
from drivers.registry import AnyDeviceSettings
from drivers.vesc.settings import VescSettings
from rover_hil.config import schema_text
from rover_hil.config.loader import SCHEMA_NAME
from rover_hil.console.ask import ask, ask_choice, ask_number, ask_yes
from rover_hil.console.error_message import readable_line
from rover_hil.console.exit_codes import EXIT_NO, EXIT_OK
from rover_hil.console.options import ForceOption
from rover_hil.console.steps import show_steps
from rover_hil.doctor.finding import SystemPaths
from rover_hil.pages.atomic_write import check_file, unfinished, write_file
from rover_hil.ready.check import examine_config
from rover_hil.ready.set_up.cameras import Views
from rover_hil.ready.set_up.config_text import Answers, config_text
from rover_hil.ready.set_up.drives import (
    canopen_nodes,
    guess_mapping,
    read_messages,
    reordered_text,
    shipped_mapping,
    vesc_nodes,
    write_mapping,
)
from rover_hil.ready.set_up.places import find_places
from rover_hil.ready.set_up.probing import (
    Found,
    busy_words,
    probe_camera,
    probe_can,
    probe_can_log,
    probe_serial,
)
from rover_hil.ready.set_up.simulated_rover import MASS_KG, RoverTable, WheelTable, simulation_table
from rover_hil.ready.set_up.turning import Turner
from rover_hil.run.drive_order import port_of
from rover_hil.run.drive_permission import permit_turning
from rover_hil.terminal import Terminal

TURN_SPEED_RAD_S = 1.0
LEAST_TURN_RAD = 0.1
LEAST_STEERING_DEG = 10.0
STEER_RAD = math.radians(LEAST_STEERING_DEG)
OUT = "OUT"
"""The argument that names the configuration, for messages."""
POSITIONS = {
    "omni3": ("at 60 deg", "at 180 deg", "at 300 deg"),
    "differential": ("left", "right"),
    "skid_steer_4": ("front left", "front right", "rear left", "rear right"),
    "steered_4": ("front left", "front right", "rear left", "rear right"),
}
"""Wheels in the order of the configuration."""
NAMES = {"frames": "camera", "rate": "imu", "heading": "compass", "position": "gnss"}
FIX_TYPES = ("nmea_gnss", "overhead_camera")
Made = dict[Path, bytes | None]
"""Files beside the configuration that were written, and what they held before."""


def init(
    out: Annotated[Path, typer.Argument(help="The configuration to write, TOML.")],
    *,
    dbc: Annotated[Path | None, typer.Option(help="DBC file of the drives on the CAN bus.")] = None,
    can: Annotated[
        Path | None,
        typer.Option(help="Log of the CAN bus while the rover drove, instead of connected devices."),
    ] = None,
    ports: Annotated[
        Path | None,
        typer.Option(help="Also look into this folder, e.g. the `ports` that `rover-hil simulate` serves."),
    ] = None,
    may_drive: Annotated[
        bool,
        typer.Option("--drive", help="Let answers that do not come from a terminal, too, turn the wheels."),
    ] = False,
    force: ForceOption = False,
) -> int:
    """Set a rover up: find its devices, ask what cannot be found, write a configuration.

    Looks at serial ports, CAN interfaces and cameras, listens to what they send, and proposes devices and
    settings. After an explicit question (wheels lifted) it turns each wheel a little, to find order and
    sign. Answers come from the standard input. Exit code 1: no drive was found, or the configuration has
    mistakes.

    Example: `rover-hil init my_rover.toml`

    Data: the devices of your rover, connected; docs/how-to/set_a_rover_up.md shows it with emulated ones.
    """
    if can is not None and (ports is not None or may_drive):
        raise ConfigError("--can reads a log, no device: leave --ports and --drive out")
    check_file(out, force=force, option=OUT)
    with unfinished(out, option=OUT):
        pass  # a folder that cannot be written to is better known before the questions
    if dbc is not None:
        if not dbc.is_file():
            raise ConfigError(f"no DBC file {dbc}: correct --dbc")
        read_messages(dbc)
    console = Terminal(stderr=True, soft_wrap=True)
    made: Made = {}
    try:
        return _set_up(out, ports, can, dbc, made, console, may_drive=may_drive, force=force)
    except BaseException:
        for path, earlier in made.items():
            if earlier is None:
                path.unlink(missing_ok=True)
            else:
                path.write_bytes(earlier)
        raise


def _set_up(
    out: Path,
    ports: Path | None,
    can: Path | None,
    dbc: Path | None,
    made: Made,
    console: Terminal,
    *,
    may_drive: bool,
    force: bool,
) -> int:
    if can is None:
        on_ports = _look(ports, console)
    else:
        on_ports = [probe_can_log(can)]
        console.print(readable_line(on_ports[0].what))
    if dbc is not None and not any("can" in each.kinds for each in on_ports):
        console.print(f"{dbc} is not used: no CAN bus was found")
    devices: dict[str, tuple[AnyDeviceSettings, str]] = {}
    drive: tuple[AnyDeviceSettings, str] | None = None
    for each in on_ports:
        if each.kinds & {"can", "wheels"}:
            recognised = _drive_of(each, dbc, out, made, console, force=force)
            if recognised is not None and drive is None:
                drive = recognised, each.what
        elif ask_yes(f"Use {each.what}, {port_of(each.settings)}?", default=True):
            name = _name_of(each)
            devices[f"{name}_{len(devices)}" if name in devices else name] = (each.settings, each.what)
    if drive is None or not isinstance(drive[0], DriveSettings):
        console.print(
            "no drive was recognised, nothing is written: switch it on, name its DBC file with --dbc, or "
            "the folder of its port with --ports; docs/how-to/set_a_rover_up.md"
            if can is None
            else f"no drive was recognised in {can}, nothing is written: name its DBC file with --dbc; "
            "docs/how-to/set_a_rover_up.md"
        )
        return EXIT_NO
    codec = drive[0].make_codec("wheels")
    limits_rad = codec.steering_limits_rad if isinstance(codec, SteeringCodec) else {}
    kinematics, rover = _rover(codec.wheel_count, limits_rad, console)
    settings: AnyDeviceSettings = drive[0]
    if can is None:
        settings = _turn_wheels(drive[0], drive[1], kinematics, made, console, may_drive=may_drive)
    else:
        console.print(
            "the log says neither interface nor bit rate: correct those of [devices.wheels], which are can0"
        )
        console.print(
            "and 500 kbit/s; check order and sign of the wheels with the wheels lifted before you drive"
        )
    seen = Views(out, made, console, force)
    gyro = next((name for name, (each, _) in devices.items() if _has(on_ports, each, "rate")), None)
    answers = _ask_rest((settings, drive[1]), rover, kinematics, devices, gyro, seen)
    _write(out, answers, console)
    return _report(out, console, has_ground_camera=seen.camera is not None)


def _ask_rest(
    drive: tuple[AnyDeviceSettings, str],
    rover: RoverTable,
    kinematics: str,
    devices: Mapping[str, tuple[AnyDeviceSettings, str]],
    gyro: str | None,
    seen: Views,
) -> Answers:
    """Ask how fast the rover is, and where its cameras look; return all answers."""
    speed = ask_number("Greatest speed of the wheels to begin with, rad/s", 0.5, 200.0, 5.0)
    radius_m = rover["wheel_radius_m"] if "wheel_radius_m" in rover else rover["wheels"][0]["radius_m"]
    speed_m_s = float(f"{max(0.01, min(0.1, 0.4 * speed * radius_m)):.2g}")
    for name, (camera, _) in devices.items():
        if isinstance(camera, CameraSettings):
            seen.ask(name, camera, speed_m_s, rover, kinematics)
    used = {name: (seen.overhead.get(name, each), what) for name, (each, what) in devices.items()}
    is_excited = seen.camera is not None and kinematics == "omni3" and gyro is not None
    mass_kg = ask_number("Mass of the rover with its load, kg", 0.5, 500.0, 12.0) if is_excited else None
    simulation = simulation_table(rover, drive[0].type, speed, mass_kg or MASS_KG)
    return Answers(
        rover=rover,
        devices=[("wheels", *drive), *((name, *each) for name, each in used.items())],
        wheels="wheels",
        gyro=gyro,
        headings=[name for name, (each, _) in used.items() if each.type == "nmea_compass"],
        fixes=[name for name, (each, _) in used.items() if each.type in FIX_TYPES],
        wheel_speed_rad_s=speed,
        moves_sideways=kinematics == "omni3",
        speed_m_s=speed_m_s,
        simulation=simulation | ({"devices": seen.simulated} if seen.simulated else {}),
        camera=seen.camera,
        ground_motion=seen.ground_motion,
        has_trace=seen.has_trace,
        mass_kg=mass_kg,
    )


def _write(out: Path, answers: Answers, console: Terminal) -> None:
    """Write the configuration and its schema, without [simulation] where a view cannot be simulated."""
    write_file(out, config_text(answers), option=OUT)
    schema = out.with_name(SCHEMA_NAME)
    if not schema.exists():
        write_file(schema, schema_text(), option=OUT)
    if "devices" in answers.simulation and (mistakes := examine_config(str(out)).mistakes):
        write_file(out, config_text(replace(answers, simulation={})), option=OUT)
        for mistake in mistakes:
            console.print(readable_line(mistake))
        console.print("[simulation] is left out: `run --virtual` is not possible")


def _look(ports: Path | None, console: Terminal) -> list[Found]:
    """Probe every port, and print what is there."""
    clock = SystemClock()
    places = find_places(SystemPaths(), ports)
    devices: list[Found] = []
    results: list[tuple[str, Found | str]] = []
    with show_steps("looking for ports") as step:
        results += [(port, probe_serial(port, clock, step)) for port in places.serial]
        results += [(name, probe_can("socketcan", name, clock, step)) for name in places.can]
        for path in places.cameras:
            results.append((path, probe_camera(path, clock, is_folder=Path(path).is_dir(), step=step)))
    if any(isinstance(result, str) for _, result in results):
        busy = busy_words(clock)
        if busy:
            console.print(busy)
    for place, result in results:
        console.print(readable_line(f"{place}: {result if isinstance(result, str) else result.what}"))
        if isinstance(result, Found):
            devices.append(result)
    if not results:
        console.print("no serial port, CAN interface or camera is connected")
    return devices


def _drive_of(
    drive: Found, dbc: Path | None, out: Path, made: Made, console: Terminal, *, force: bool
) -> AnyDeviceSettings | None:
    """Return the settings of the drives behind a port, or None where they are not known."""
    if not isinstance(drive.settings, CanWheelsSettings):
        return drive.settings
    bus = drive.settings
    shipped = shipped_mapping(drive.frames) if dbc is None else ""
    if shipped:
        console.print(f"the messages are those of the shipped mapping '{shipped}'")
        return bus.model_copy(update={"mapping": shipped})
    nodes = vesc_nodes(drive.frames)
    if nodes and dbc is None:
        console.print(f"VESC controllers {', '.join(map(str, nodes))}")
        return VescSettings.model_validate(
            {
                "type": "vesc",
                "interface": bus.interface,
                "channel": bus.channel,
                "bit_rate": bus.bit_rate,
                "wheel": [{"node": node} for node in nodes],
                "pole_pairs": int(ask_number("Pairs of magnetic poles of the motors", 1, 100, 7)),
                "gear_ratio": ask_number("Turns of the motor per turn of the wheel", 0.01, 1000, 1.0),
            }
        )
    nodes = canopen_nodes(drive.frames)
    if (
        nodes
        and dbc is None
        and ask_yes(
            f"Nodes {', '.join(map(str, nodes))} send CANopen heartbeats. Are these the drives?", default=True
        )
    ):
        return _canopen(bus, nodes)
    if dbc is None:
        answer = ask("DBC file of these messages (empty for none)")
        if not answer:
            return None
        dbc = Path(answer)
    path = dbc.with_name(f"{out.stem}_can.toml")
    check_file(path, force=force, option=OUT)
    guess = guess_mapping(dbc, drive.frames)
    console.print(f"wheels {', '.join(map(str, guess.nodes))} of {dbc}:")
    for key, value in guess.every_wheel.items():
        console.print(f"  {key}: signal {value['signal']} of {value['message']}, {value['unit']}")
    if not ask_yes("Is that right?", default=True):
        raise ConfigError(
            f"{dbc}: write the mapping by hand, docs/how-to/drive_your_own_rover.md, "
            "or rename signals and units"
        )
    if guess.needs_ticks:
        ticks = ask_number("Encoder ticks per turn of the encoder", 1, 1e8)
        guess.every_wheel["position"]["ticks_per_revolution"] = ticks
    gear = ask_number("Turns of the encoder per turn of the wheel (gear ratio)", 0.001, 1000, 1.0)
    made[path] = path.read_bytes() if path.exists() else None
    write_mapping(path, dbc, guess, drive.frames, gear_ratio=gear)
    console.print(f"mapping written: {path}")
    return bus.model_copy(update={"mapping": str(path)})


def _canopen(bus: CanWheelsSettings, nodes: Sequence[int]) -> AnyDeviceSettings:
    """Ask what CANopen drives do not say by themselves."""
    return CanopenWheelsSettings.model_validate(
        {
            "type": "canopen_wheels",
            "interface": bus.interface,
            "channel": bus.channel,
            "bit_rate": bus.bit_rate,
            "wheel": [{"node": node} for node in nodes],
            "counts_per_motor_turn": int(
                ask_number("Counts of the position per turn of the motor", 1, 1e8, 4096)
            ),
            "gear_ratio": ask_number("Turns of the motor per turn of the wheel", 0.01, 1000, 1.0),
            "rpm_limit": int(ask_number("Largest speed of the motors, rpm", 1, 100_000, 3000)),
        }
    )


def _rover(
    wheel_count: int, steering_limits_rad: Mapping[int, tuple[float, float]], console: Terminal
) -> tuple[str, RoverTable]:
    """Ask for kind and size of the rover; return the kind and the section [rover]."""
    kinds = {2: "differential", 3: "omni3", 4: "steered_4" if steering_limits_rad else "skid_steer_4"}
    if wheel_count not in kinds or len(steering_limits_rad) not in (0, 4):
        raise ConfigError(
            f"the drive has {wheel_count} wheels, {len(steering_limits_rad)} of which steer: copy "
            "docs/examples/six_wheels.toml and describe each wheel, docs/how-to/drive_your_own_rover.md"
        )
    kind = kinds[wheel_count]
    words = {
        "differential": "two driven wheels, with castors",
        "omni3": "three omnidirectional wheels",
        "skid_steer_4": "four wheels that do not steer",
        "steered_4": "four wheels that all steer",
    }
    console.print(
        f"{wheel_count} wheels: {words[kind]}; for another kind see docs/how-to/drive_your_own_rover.md"
    )
    radius_m = ask_number("Radius of the wheels, m", 0.005, 1.0, 0.04 if kind == "omni3" else None)
    if kind == "omni3":
        base_m = ask_number("Distance of the wheels from the middle of the rover, m", 0.02, 2.0, 0.125)
        return kind, {"kinematics": "omni3", "wheel_radius_m": radius_m, "base_radius_m": base_m}
    track_m = ask_number("Distance between left and right wheels, m", 0.05, 5.0)
    if kind == "steered_4":
        return kind, _steered(radius_m, track_m, steering_limits_rad)
    if kind == "skid_steer_4":
        return kind, {"kinematics": "skid_steer_4", "wheel_radius_m": radius_m, "track_m": track_m}
    wheels: list[WheelTable] = [
        {"x_m": 0.0, "y_m": side * track_m / 2, "radius_m": radius_m} for side in (1, -1)
    ]
    return kind, {"kinematics": "wheels", "wheels": wheels}


def _steered(radius_m: float, track_m: float, limits_rad: Mapping[int, tuple[float, float]]) -> RoverTable:
    """Ask for the steering; return the section [rover].

    Raises:
        ConfigError: The drives take too small angles.
    """
    base_m = ask_number("Distance between front and rear wheels, m", 0.05, 5.0)
    most_deg = min(180.0, *(math.degrees(min(-low, high)) for low, high in limits_rad.values()))
    if most_deg < LEAST_STEERING_DEG:
        raise ConfigError(
            f"the steering setpoints of the drives reach {max(0.0, most_deg):.3g} deg to one side, less "
            f"than {LEAST_STEERING_DEG:g}: are signal, sign and offset in the DBC file right? Otherwise "
            "write the mapping by hand, docs/how-to/drive_your_own_rover.md"
        )
    angle_deg = ask_number(
        "Greatest steering angle to either side, deg", LEAST_STEERING_DEG, most_deg, min(45.0, most_deg)
    )
    rate_deg_s = ask_number("Speed of the steering drives, deg/s", 1.0, 1000.0, 30.0)
    steering = {"low_deg": -angle_deg, "high_deg": angle_deg, "rate_deg_s": rate_deg_s}
    wheels: list[WheelTable] = [
        {"x_m": ahead * base_m / 2, "y_m": left * track_m / 2, "radius_m": radius_m, "steering": steering}
        for ahead in (1, -1)
        for left in (1, -1)
    ]
    return {"kinematics": "wheels", "wheels": wheels}


def _turn_wheels(
    drive: DriveSettings, what: str, kinematics: str, made: Made, console: Terminal, *, may_drive: bool
) -> AnyDeviceSettings:
    """Turn each wheel after a question; return the drive with order and signs of its wheels."""
    places = POSITIONS[kinematics]
    settings: AnyDeviceSettings = drive  # type: ignore[assignment]  # a drive of the registry
    console.print("Each wheel can now be turned a little, to find its place and its sign.")
    if permit_turning(what, drive, drive=may_drive) is None:
        console.print("no wheel was turned: check order and sign with the wheels lifted before you drive")
        return settings
    order: dict[str, tuple[int, int, int]] = {}
    try:
        with Turner(drive, SystemClock(), TURN_SPEED_RAD_S) as turner:
            for wheel in range(turner.wheel_count):
                with show_steps(f"wheel {wheel}") as step:
                    turned = turner.turn(wheel, step)
                _check_encoders(wheel, turned, console)
                untried = tuple(place for place in places if place not in order)
                place = ask_choice(
                    f"Drive {wheel} was turned. Which wheel moved", (*untried, "none"), untried[0]
                )
                if place == "none":
                    raise ConfigError(f"wheel {wheel} did not turn: switch its drive on, and run init again")
                forwards = ask_yes(
                    "Did it turn forwards (counter-clockwise for omnidirectional wheels)?", default=True
                )
                steering_sign = _steer(turner, wheel, place) if kinematics == "steered_4" else 1
                order[place] = wheel, 1 if forwards else -1, steering_sign
    except NotConnectedError as error:
        raise ConfigError(f"{error}: the wheels cannot be turned") from error
    wheels = [order[place][0] for place in places]
    signs = [order[place][1] for place in places]
    steering_signs = [order[place][2] for place in places]
    if wheels == sorted(wheels) and {*signs, *steering_signs} == {1}:
        return settings
    return _reordered(settings, wheels, signs, steering_signs, made, console)


def _steer(turner: Turner, wheel: int, place: str) -> int:
    """Steer a wheel a little to the left; return the sign of its steering."""
    with show_steps(f"wheel {wheel}") as step:
        turner.steer(wheel, STEER_RAD, step)
    left = ask_yes(
        f"Does the {place} wheel point to the left now (counter-clockwise seen from above)?", default=True
    )
    with show_steps(f"wheel {wheel}") as step:
        turner.steer(wheel, 0.0, step)
    return 1 if left else -1


def _check_encoders(wheel: int, turned: Sequence[float], console: Terminal) -> None:
    """Report what the encoders say of a wheel that was turned forwards."""
    console.print("  encoders: " + ", ".join(f"{each:+.2f} rad" for each in turned))
    others = [index for index, each in enumerate(turned) if index != wheel and abs(each) > LEAST_TURN_RAD]
    if abs(turned[wheel]) < LEAST_TURN_RAD:
        console.print(f"  attention: the encoder of wheel {wheel} did not move")
    elif turned[wheel] < 0.0:
        console.print(
            f"  attention: the encoder of wheel {wheel} counts against its motor: swap two wires of it"
        )
    if others:
        console.print(f"  attention: encoder {others[0]} moved too: motors and encoders are mixed up")


def _reordered(
    settings: AnyDeviceSettings,
    wheels: list[int],
    signs: list[int],
    steering_signs: list[int],
    made: Made,
    console: Terminal,
) -> AnyDeviceSettings:
    if isinstance(settings, VescSettings | CanopenWheelsSettings):
        entries = [
            settings.wheel[wheel].model_copy(update={"sign": sign})
            for wheel, sign in zip(wheels, signs, strict=True)
        ]
        return settings.model_copy(update={"wheel": tuple(entries)})
    if isinstance(settings, CanWheelsSettings):
        path = Path(settings.mapping)
        if not path.is_file():
            path = _own_copy(settings.mapping, made)
        path.write_text(reordered_text(path.read_text("utf-8"), wheels, signs, steering_signs), "utf-8")
        console.print(f"order and signs of the wheels entered into {path}")
        return settings.model_copy(update={"mapping": str(path)})
    raise ConfigError(
        "the board has a fixed order of its wheels: connect the motors in the order 60, 180, 300 deg, "
        "counter-clockwise positive"
    )


def _own_copy(mapping: str, made: Made) -> Path:
    """Copy a shipped mapping and its DBC file into the current folder; return the copy."""
    path = Path(f"{mapping}_own.toml")
    for source, target in ((f"{mapping}.toml", path), (f"{mapping}.dbc", Path(f"{mapping}.dbc"))):
        check_file(target, force=False, option="folder")
        made[target] = None
        write_file(target, (SHIPPED_FOLDER / source).read_text("utf-8"))
    return path


def _has(devices: Sequence[Found], settings: AnyDeviceSettings, kind: str) -> bool:
    return any(each.settings is settings and kind in each.kinds for each in devices)


def _name_of(device: Found) -> str:
    return next(name for kind, name in (*NAMES.items(), ("", "device")) if kind in device.kinds or not kind)


def _report(out: Path, console: Terminal, *, has_ground_camera: bool) -> int:
    examined = examine_config(str(out))
    mistakes = examined.mistakes
    for mistake in mistakes:
        console.print(readable_line(mistake))
    if mistakes:
        console.print(f"{out} was written, but has mistakes: correct them and run `rover-hil check {out}`")
        return EXIT_NO
    virtual = (
        "" if examined.lacks["run --virtual"] else f". Without the rover: `rover-hil run {out} --virtual`"
    )
    console.print(f"{out} is written and valid{virtual}")
    console.print(f"Next: `rover-hil doctor {out}`, then with the wheels lifted")
    console.print(f"`rover-hil run {out} --duration 5`; docs/how-to/run_on_a_rover.md")
    if has_ground_camera:
        console.print(f"On the ground: `rover-hil calibrate scale {out} --out scale.toml --enter`")
    return EXIT_OK
