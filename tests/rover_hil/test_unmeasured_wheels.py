"""Rovers whose wheels do not all have an encoder: bicycles, Ackermann cars, tricycles, and their drives."""

import math
import re
from pathlib import Path

import numpy as np
import pytest

from controllers.motion.kinematics import make_kinematics
from controllers.motion.rover_geometry import WheelsRoverSettings
from drivers.errors import ConfigError
from rover_hil.config import load_config
from rover_hil.drives.files.csv_table import read_csv
from rover_hil.run.checks import VIRTUAL_RUN_CHECKS
from tests.rover_hil.command import Command, assert_one_sentence

BASE_M, TRACK_M, RADIUS_M = 0.6, 0.4, 0.1
SPEED_M_S, TURN_RAD_S, PERIOD_S, ROWS = 0.5, 0.3, 0.02, 301
T_S = PERIOD_S * np.arange(ROWS)
STEERING = "steering = { low_deg = -60, high_deg = 60 }"


def rear(y_m: float, more: str = "") -> str:
    return f"{{ x_m = 0.0, y_m = {y_m}, radius_m = {RADIUS_M}{more} }}"


def front(y_m: float, more: str = "") -> str:
    return f"{{ x_m = {BASE_M}, y_m = {y_m}, radius_m = {RADIUS_M}, {STEERING}{more} }}"


BLIND = ", measured = false"
LIMITS = "[limits]\nwheel_speed_rad_s = 30\nwheel_acceleration_rad_s2 = 100\n"

ROVERS = {
    "bicycle": [rear(0.0), front(0.0, ", driven = false" + BLIND)],
    "Ackermann car": [
        rear(TRACK_M / 2),
        rear(-TRACK_M / 2),
        front(TRACK_M / 2, ", driven = false" + BLIND),
        front(-TRACK_M / 2, ", driven = false" + BLIND),
    ],
    "car with an encoder on one rear wheel": [
        rear(TRACK_M / 2, BLIND),
        rear(-TRACK_M / 2),
        front(TRACK_M / 2, ", driven = false" + BLIND),
        front(-TRACK_M / 2, ", driven = false" + BLIND),
    ],
    "tricycle": [
        front(0.0),
        rear(TRACK_M / 2, ", driven = false" + BLIND),
        rear(-TRACK_M / 2, ", driven = false" + BLIND),
    ],
}


def rover_of(wheels: list[str]) -> str:
    return '[rover]\nkinematics = "wheels"\nwheels = [' + ", ".join(wheels) + "]\n"


def place(wheel: str) -> tuple[float, float]:
    x, y = (float(wheel.split(f"{axis}_m = ")[1].split(",")[0]) for axis in "xy")
    return x, y


def motion_of(wheel: str) -> tuple[float, float]:
    """Return rim speed and steering angle of a wheel of a rover on the circle."""
    x, y = place(wheel)
    along, aside = SPEED_M_S - TURN_RAD_S * y, TURN_RAD_S * x
    if "steering" not in wheel:
        return along, 0.0
    return math.hypot(along, aside), math.atan2(aside, along)


def write_drive(folder: Path, wheels: list[str], quantity: str) -> str:
    """Write the table of a drive on a circle; return the sections of its wheels."""
    columns, sections = {"t": T_S}, ""
    for number, wheel in enumerate(wheels):
        rim_m_s, steering_rad = motion_of(wheel)
        sections += "[[wheel]]\n"
        if BLIND not in wheel:
            turned = rim_m_s / RADIUS_M * (T_S if quantity == "position" else np.ones(ROWS))
            columns[f"w{number}"] = turned
            unit = "rad" if quantity == "position" else "rad/s"
            sections += f'{quantity} = {{ column = "w{number}", unit = "{unit}" }}\n'
        if "steering" in wheel:
            columns[f"s{number}"] = np.full(ROWS, steering_rad)
            sections += f'steering = {{ column = "s{number}" }}\n'
    rows = zip(*(column.tolist() for column in columns.values()), strict=True)
    text = [",".join(columns), *(",".join(map(repr, row)) for row in rows)]
    (folder / "drive.csv").write_text("\n".join(text) + "\n", "utf-8")
    return sections


@pytest.mark.parametrize(
    ("name", "quantity"),
    [
        *(("bicycle", quantity) for quantity in ("position", "speed")),
        *((name, "position") for name in ROVERS if name != "bicycle"),
        *(pytest.param(name, "speed", marks=pytest.mark.nightly) for name in ROVERS if name != "bicycle"),
    ],
)
def test_a_recorded_drive_follows_its_circle(
    command: Command, tmp_path: Path, name: str, quantity: str
) -> None:
    sections = write_drive(tmp_path, ROVERS[name], quantity)
    Path("columns.toml").write_text(
        f'rate_hz = 20\ntime = {{ column = "t" }}\n{sections}{rover_of(ROVERS[name])}{LIMITS}'
    )
    table = str(tmp_path / "drive.csv")
    assert command("import", "table", table, "--columns", "columns.toml", "--out", "drive.mcap") == 0, (
        command.error
    )
    assert not re.search(r"(?m)^(finding|doubt) ", command.out)
    assert command("replay", "drive.mcap") == 0
    assert "every output identical" in command.out
    assert command("export", "drive.mcap", "--csv") == 0
    estimate = read_csv(Path("drive_csv/estimate.csv"))
    x_m, y_m, yaw_rad = (estimate.numbers(f"estimate_{key}")[-1] for key in ("x_m", "y_m", "yaw_rad"))
    turned = TURN_RAD_S * T_S[-1]
    radius_m = SPEED_M_S / TURN_RAD_S
    # A speed is integrated from its first message on, and a cycle late at the end.
    tolerance = 0.005 if quantity == "position" else 0.03
    assert yaw_rad == pytest.approx(turned, abs=tolerance)
    assert (x_m, y_m) == pytest.approx(
        (radius_m * math.sin(turned), radius_m * (1.0 - math.cos(turned))), abs=tolerance
    )
    assert command("replay", "drive.mcap", "--out", "report") == 0, command.error


@pytest.mark.parametrize("name", ROVERS)
def test_a_wheel_without_an_encoder_rolls_as_the_others_say(name: str) -> None:
    wheels = ROVERS[name]
    kinematics = make_kinematics(settings(wheels))
    speeds, steering = zip(*((rim / RADIUS_M, angle) for rim, angle in map(motion_of, wheels)), strict=True)
    blind = {number for number, wheel in enumerate(wheels) if BLIND in wheel}
    assert kinematics.unmeasured == blind
    seen = [math.nan if number in blind else speed for number, speed in enumerate(speeds)]
    known = [0.0 if number in blind else speed for number, speed in enumerate(speeds)]
    motion = kinematics.body_motion(known, steering)
    assert motion == pytest.approx((SPEED_M_S, 0.0, TURN_RAD_S), abs=1e-12)
    assert kinematics.with_unmeasured(seen, motion, steering) == pytest.approx(speeds, abs=1e-12)
    residuals = kinematics.residuals(known, steering)
    assert residuals is not None
    assert residuals.rolling_m == pytest.approx((0.0,) * len(wheels), abs=1e-12)


def settings(wheels: list[str]) -> WheelsRoverSettings:
    import tomllib

    return WheelsRoverSettings.model_validate(tomllib.loads(rover_of(wheels))["rover"])


def test_wheels_that_do_not_show_the_motion_are_refused() -> None:
    wheels = [rear(TRACK_M / 2), rear(-TRACK_M / 2, BLIND)]
    with pytest.raises(ValueError, match="encoders and steering angles determine 1"):
        settings(wheels)
    with pytest.raises(ValueError, match="no wheel is measured"):
        settings([rear(TRACK_M / 2, BLIND), rear(-TRACK_M / 2, BLIND)])


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('steering = { column = "s1" }\n', "", ("wheel 1 steers", "not measured", "[[wheel]]")),
        (", measured = false", "", ("wheel 1", "neither position nor step nor speed", "measured = false")),
        (
            "[[wheel]]\nsteering",
            '[[wheel]]\nspeed = { column = "w0", unit = "rad/s" }\nsteering',
            ("wheel 1", "is not measured by [rover]"),
        ),
    ],
)
def test_what_a_table_lacks_or_has_too_much_is_one_sentence(
    command: Command, tmp_path: Path, old: str, new: str, words: tuple[str, ...]
) -> None:
    sections = write_drive(tmp_path, ROVERS["bicycle"], "position")
    text = f'time = {{ column = "t" }}\n{sections}{rover_of(ROVERS["bicycle"])}{LIMITS}'
    assert text.count(old) == 1
    Path("columns.toml").write_text(text.replace(old, new))
    table = str(tmp_path / "drive.csv")
    assert command("import", "table", table, "--columns", "columns.toml", "--out", "drive.mcap") == 2
    assert_one_sentence(command.error, *words)
    assert not Path("drive.mcap").exists()


def test_a_path_in_place_of_the_wheels_needs_a_rover_that_does_not_steer(
    command: Command, tmp_path: Path
) -> None:
    (tmp_path / "drive.csv").write_text("t,d,a\n0,0,0\n0.1,0.1,0.1\n0.2,0.1,0.1\n")
    text = 'time = { column = "t" }\n[increments]\ndistance = { column = "d" }\nturn = { column = "a" }\n'
    Path("columns.toml").write_text(text + rover_of(ROVERS["bicycle"]) + LIMITS)
    table = str(tmp_path / "drive.csv")
    assert command("import", "table", table, "--columns", "columns.toml", "--out", "drive.mcap") == 2
    assert_one_sentence(command.error, "wheels of the rover steer")


@pytest.mark.parametrize("name", ["tricycle", "car with an encoder on one rear wheel"])
def test_wheels_of_which_nothing_is_measured_may_be_left_out(
    command: Command, tmp_path: Path, name: str
) -> None:
    sections = write_drive(tmp_path, ROVERS[name], "position")
    shorter = re.sub(r"\[\[wheel\]\]\n(?=\[|$)", "", sections)
    assert shorter.count("[[wheel]]") < sections.count("[[wheel]]")
    estimates = []
    for text in (sections, shorter):
        columns = f'rate_hz = 20\ntime = {{ column = "t" }}\n{text}{rover_of(ROVERS[name])}{LIMITS}'
        Path("columns.toml").write_text(columns, "utf-8")
        table = (str(tmp_path / "drive.csv"), "--columns", "columns.toml", "--out", "drive.mcap", "--force")
        assert command("import", "table", *table) == 0, command.error
        assert command("export", "drive.mcap", "--csv", "--force") == 0
        estimates.append(Path("drive_csv/estimate.csv").read_bytes())
    assert estimates[0] == estimates[1]


EXAMPLES = Path(__file__).parents[2] / "docs" / "examples"


@pytest.mark.parametrize("in_mapping", [True, False])
def test_a_mapping_and_a_rover_that_disagree_are_named(tmp_path: Path, *, in_mapping: bool) -> None:
    config = (EXAMPLES / "differential.toml").read_text("utf-8")
    mapping = (EXAMPLES / "can" / "differential.toml").read_text("utf-8")
    for file in (EXAMPLES / "can").glob("*.dbc"):
        (tmp_path / file.name).write_bytes(file.read_bytes())
    config = config.replace("docs/examples/can/differential.toml", str(tmp_path / "mapping.toml"))
    if in_mapping:
        mapping = mapping.replace("node = 1", "node = 1\nmeasured = false")
    (tmp_path / "mapping.toml").write_text(mapping, "utf-8")
    (tmp_path / "rover.toml").write_text(config, "utf-8")
    if not in_mapping:
        load_config(str(tmp_path / "rover.toml"), VIRTUAL_RUN_CHECKS)
        return
    with pytest.raises(ConfigError, match=r"wheel 1 has an encoder by rover\.wheels, and none by wheels"):
        load_config(str(tmp_path / "rover.toml"), VIRTUAL_RUN_CHECKS)


def write_six_wheels(folder: Path) -> Path:
    """Write the six-wheel rover without an encoder on its middle right wheel."""
    config = (EXAMPLES / "six_wheels.toml").read_text("utf-8")
    mapping = (EXAMPLES / "can" / "six_wheels.toml").read_text("utf-8")
    (folder / "six_wheels.dbc").write_bytes((EXAMPLES / "can" / "six_wheels.dbc").read_bytes())
    config = config.replace("docs/examples/can/six_wheels.toml", str(folder / "mapping.toml"))
    for text, name, mark in ((config, "rover", "rover.wheels"), (mapping, "mapping", "wheel")):
        line = f"[[{mark}]]   # middle right\n"
        assert line in text
        (folder / f"{name}.toml").write_text(text.replace(line, f"{line}measured = false\n"), "utf-8")
    return folder / "rover.toml"


def test_a_simulated_rover_takes_a_wheel_without_an_encoder(command: Command, tmp_path: Path) -> None:
    path = str(write_six_wheels(tmp_path))
    assert command("check", path) == 0, command.out
    config = load_config(path, VIRTUAL_RUN_CHECKS)
    assert config.device_roles().unmeasured_wheels == {3}
    assert len(getattr(config.require_simulation().plant, "wheels", ())) == 6


def test_gap_names_the_key_of_a_driven_wheel_without_an_encoder(command: Command, tmp_path: Path) -> None:
    path = str(write_six_wheels(tmp_path))
    assert command("gap", "rover", path, str(tmp_path), "--out", str(tmp_path / "gap")) == 2
    assert_one_sentence(command.error, "rover.wheels.3.measured is false", "encoder")
