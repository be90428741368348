"""The twin: numbers that drives show are entered into [simulation], and `tune` and `gap rover` use them."""

import json
import math
import re
import tomllib
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from drivers.errors import ConfigError
from rover_hil.config import Config, load_config
from rover_hil.config.entry import with_entry
from rover_hil.diagnose.device_numbers import delay_behind_s
from rover_hil.diagnose.forces import friction_of, ground_of_slip, pull_of
from rover_hil.diagnose.intervals import Interval
from rover_hil.diagnose.replayed_drive import replay_drive
from rover_hil.diagnose.twin_number import TwinNumber, Unknown
from rover_hil.drives.channels import Readings
from rover_hil.run.driving import run_virtual
from rover_hil.tune.scenarios import with_scenario
from sim_backends.plants.robotino.site import random_site
from sim_backends.plants.wheels.plant import WheelsPlant
from sim_backends.plants.wheels.settings import WheelsPlantSettings
from tests.rover_hil.command import Command, assert_one_sentence

pytestmark = pytest.mark.timeout(400)

EXAMPLE = Path("docs/examples/differential.toml").resolve()
TRUE = {
    "plant.wheel_friction_nm": 0.12,
    "plant.set_point_delay_s": 0.15,
    "devices.imu.gyro_bias_deg_s": 0.4,
    "devices.imu.gyro_noise_deg_s": 0.3,
    "devices.imu.gyro_scale": 1.01,
    "devices.imu.rate_delay_s": 0.06,
}
RADIUS_M, HALF_TRACK_M = 0.0615, 0.153
LAP = ((0.7, 0.0), (0.7, 0.6), (0.0, 0.6), (0.0, 0.0))
MISSIONS = (
    [[1.5, 0.0]],
    [[x_m, y_m] for x_m, y_m in LAP * 2],
    [[x_m, -y_m] for x_m, y_m in LAP * 2],
    [[1.8, 0.0]],
)
"""Corners of their paths."""
NUMBER = {"value": 0.02, "low": 0.0, "high": 0.04}
FOUND: dict[str, Any] = {
    "drives": ["first", "second"],
    "found_on": "2026-11-30",
    "numbers": {
        "radius": {**NUMBER, "moves": {"plant.wheels.0.radius_m": 0.06, "plant.wheels.1.radius_m": 0.06}},
        "delay of the wheels": {**NUMBER, "moves": {"plant.set_point_delay_s": 1.0}},
    },
}


def rover_text() -> str:
    text = EXAMPLE.read_text("utf-8")
    return text.replace("docs/examples/can", str(EXAMPLE.parent / "can"))


def with_found(found: object) -> str:
    text = with_entry(rover_text(), "simulation.plant", "set_point_delay_s", 0.02)
    return with_entry(text, "simulation", "found", found)  # type: ignore[arg-type]


def loaded(text: str) -> Config:
    Path("loaded.toml").write_text(text, "utf-8")
    return load_config("loaded.toml")


def plant_of(config: Config) -> WheelsPlantSettings:
    plant = config.require_simulation().plant
    assert isinstance(plant, WheelsPlantSettings)
    return plant


@pytest.fixture(scope="module")
def drives(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Return logs of the rover of the example whose wheels, drives and gyro are other than described."""
    folder = tmp_path_factory.mktemp("drives")
    motor = {"stall_torque_nm": 4.0, "no_load_rad_s": 20.0, "stall_current_a": 8.0}
    wheel = {"x_m": 0.0, "radius_m": RADIUS_M, "motor": motor}
    wheels = [{**wheel, "y_m": side * HALF_TRACK_M} for side in (1.0, -1.0)]
    text = with_entry(rover_text(), "simulation.plant", "wheels", wheels)
    text = with_entry(text, "simulation.devices.imu", "type", "witmotion")
    for key, value in TRUE.items():
        section, _, last = f"simulation.{key}".rpartition(".")
        text = with_entry(text, section, last, value)
    text = re.sub(r"\[mission\].*?\n\n", "", text, flags=re.DOTALL)
    paths = []
    for number, points in enumerate(MISSIONS):
        one = with_entry(text, "simulation", "seed", number)
        one += f'[mission]\ntype = "waypoints"\nheading = "along_path"\nspeed_m_s = 0.25\npoints = {points}\n'
        (folder / "rover.toml").write_text(one, "utf-8")
        paths.append(folder / f"drive{number}.mcap")
        run_virtual(load_config(str(folder / "rover.toml")), paths[-1], 60.0, None)
    return paths


def test_a_twin_of_drives_is_entered_and_used(command: Command, drives: list[Path]) -> None:
    Path("mine.toml").write_text(rover_text(), "utf-8")
    names = [str(path) for path in drives]
    options = ("--config", "mine.toml", "--enter", "--quick", "--out", "found")
    assert command("diagnose", *names, *options) == 0, command.error
    text = Path("mine.toml").read_text("utf-8")
    assert "# Everything below describes the simulated rover" in text
    found = tomllib.loads(text)["simulation"]["found"]
    assert found["drives"] == [path.stem for path in drives]
    simulation = load_config("mine.toml").require_simulation().model_dump()
    for name, key in (
        ("delay of the wheels", "plant.set_point_delay_s"),
        ("gyro bias", "devices.imu.gyro_bias_deg_s"),
        ("gyro noise", "devices.imu.gyro_noise_deg_s"),
        ("gyro scale", "devices.imu.gyro_scale"),
        ("gyro delay", "devices.imu.rate_delay_s"),
        ("friction of a wheel", "plant.wheel_friction_nm"),
    ):
        value: Any = simulation
        for part in key.split("."):
            value = value[part]
        number = found["numbers"][name]
        assert value == pytest.approx(number["value"], rel=1e-3)
        assert value == pytest.approx(TRUE[key], rel=0.06), name
    wheels = plant_of(load_config("mine.toml")).wheels
    assert [wheel.radius_m for wheel in wheels] == pytest.approx([RADIUS_M] * 2, rel=0.003)
    assert wheels[0].y_m == pytest.approx(HALF_TRACK_M, rel=0.003)
    record = json.loads(Path("found/diagnosis.json").read_text("utf-8"))
    assert record["twin"]["numbers"] == found["numbers"]
    # The twin is not judged by the drives that it is from.
    assert command("gap", "rover", "mine.toml", *names, "--out", "gap") == 2
    assert_one_sentence(command.error, "was made from these drives", "give logs of other drives")
    other = Path("other.mcap")
    other.write_bytes(drives[0].read_bytes())
    command("gap", "rover", "mine.toml", str(other), *names, "--out", "gap")
    assert "left out, because [simulation.found] was made from them: drive0, drive1" in command.error


def test_friction_of_the_motors_of_a_robotino_is_found(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    text = resources.files("rover_hil.config.shipped.configs").joinpath("robotino.toml").read_text("utf-8")
    text = re.sub(r"\[mission\].*?\n\n", "", text, flags=re.DOTALL)
    nominal = with_entry(text, "simulation.plant", "site", "floor_table")
    drives = []
    for seed, points in enumerate(([[1.5, 0.0], [0.0, 0.0]], [[1.0, 1.0]], [[-1.2, 0.3]])):
        mission = f'[mission]\ntype = "waypoints"\nspeed_m_s = 0.15\npoints = {points}\n'
        true = with_entry(nominal, "simulation.plant", "motor", {"friction_nm": 0.014})
        true = with_entry(true, "simulation", "seed", seed)
        run_virtual(loaded(true + mission), Path(f"drive{seed}.mcap"), 60.0, None)
        drives.append(replay_drive(Path(f"drive{seed}.mcap"), lambda _: None))
    plant = loaded(nominal).require_simulation().plant
    found = friction_of(drives, plant)
    assert isinstance(found, TwinNumber), found
    # The board cuts off two counts of about 66.
    assert found.interval.value == pytest.approx(64.0 / 66.0 * 0.014, rel=0.03)
    assert "with 0.051 N m/A" in found.words
    single = friction_of(drives[:1], plant)
    assert isinstance(single, Unknown)
    assert "two drives" in single.why
    elsewhere = friction_of(drives, loaded(text).require_simulation().plant)
    assert isinstance(elsewhere, Unknown)
    assert "differs by place" in elsewhere.why
    for each in drives:
        each.drive.channels._rows.pop("current2_a")
    without = friction_of(drives, plant)
    assert isinstance(without, Unknown)
    assert "no motor currents" in without.why


def test_a_configuration_without_simulation_gets_no_twin(command: Command, drives: list[Path]) -> None:
    text, _, _ = rover_text().partition("# Everything below")
    Path("mine.toml").write_text(text, "utf-8")
    options = ("--config", "mine.toml", "--enter", "--quick", "--out", "found")
    assert command("diagnose", str(drives[0]), str(drives[1]), *options) == 0, command.error
    assert "simulation" not in tomllib.loads(Path("mine.toml").read_text("utf-8"))
    assert "name with --config a configuration with [simulation]" in command.out


def test_scenarios_are_drawn_from_the_intervals(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    config = loaded(with_found(FOUND))
    plants = [plant_of(with_scenario(config, seed)) for seed in range(1, 400)]
    delays_s = np.array([each.set_point_delay_s for each in plants])
    assert delays_s.min() >= 0.0
    assert delays_s.max() <= 0.04
    assert delays_s.mean() == pytest.approx(0.02, abs=0.0015)
    assert delays_s.std() == pytest.approx(0.04 / 3.92, rel=0.1)
    radii_m = np.array([[wheel.radius_m for wheel in each.wheels] for each in plants])
    assert radii_m[:, 0] == pytest.approx(radii_m[:, 1])
    assert radii_m[:, 0].std() == pytest.approx(0.06 * 0.04 / 3.92, rel=0.1)
    assert abs(np.corrcoef(radii_m[:, 0], delays_s)[0, 1]) < 0.15
    assert all(each.site == plant_of(config).site for each in plants)


def test_scenarios_without_a_twin_are_as_before(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    config = loaded(rover_text())
    for seed in (1, 7):
        rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(0x694309E4,)))
        plant = plant_of(with_scenario(config, seed))
        assert plant == plant_of(config).model_copy(update={"site": random_site(rng)})


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [
        ("moves", {"plant.wheels.9.radius_m": 1.0}, "plant.wheels.9.radius_m"),
        ("moves", {"devices.imu.gyro_bias_deg_s": 1.0}, "devices.imu.gyro_bias_deg_s"),
        ("moves", {"plant.site.name": 1.0}, "plant.site.name"),
        ("low", 0.03, "is not between low"),
    ],
)
def test_wrong_numbers_are_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, key: str, value: object, words: str
) -> None:
    monkeypatch.chdir(tmp_path)
    number = {**FOUND["numbers"]["radius"], key: value}
    with pytest.raises(ConfigError, match=re.escape(words)):
        loaded(with_found({**FOUND, "numbers": {"radius": number}}))


def test_an_interval_beyond_the_limits_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    number = {"value": 0.02, "low": -2.0, "high": 2.0, "moves": {"plant.set_point_delay_s": 1.0}}
    config = loaded(with_found({**FOUND, "numbers": {"delay": number}}))
    with pytest.raises(ConfigError, match="drawn from the intervals"):
        [with_scenario(config, seed) for seed in range(20)]


def readings(t_s: np.ndarray, values: np.ndarray) -> Readings:
    return Readings(np.round(t_s * 1e9).astype(np.int64), values)


def setpoints() -> tuple[np.ndarray, np.ndarray]:
    t_s = np.arange(0.0, 30.0, 0.04)
    return t_s, 3.0 * np.sin(0.9 * t_s) + np.where(t_s % 7.0 < 3.0, 2.0, 0.0)


@pytest.mark.parametrize("delay_s", [0.0, 0.037, 0.31])
def test_delay_of_a_wheel(delay_s: float) -> None:
    set_s, speed = setpoints()
    reached = 0.97 * speed - 0.2 * np.sign(speed)  # a speed loop that droops, and friction
    turned = np.concatenate(([0.0], np.cumsum(reached[:-1] * np.diff(set_s))))
    t_s = np.arange(0.5, 29.5, 0.013)
    angle = 5.0 + np.interp(t_s - delay_s, set_s, turned)
    assert delay_behind_s(readings(t_s, angle), readings(set_s, speed)) == pytest.approx(delay_s, abs=1e-3)


def test_a_constant_speed_shows_no_delay() -> None:
    set_s, _ = setpoints()
    t_s = np.arange(2.0, 29.5, 0.013)
    held = readings(set_s, np.full(len(set_s), 2.0))
    assert math.isnan(delay_behind_s(readings(t_s, 2.0 * t_s), held))


def test_the_ground_loses_the_share_that_was_measured(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A simulated straight on the ground of the formula loses what went into it."""
    monkeypatch.chdir(tmp_path)
    plant = plant_of(loaded(rover_text()))
    assert pull_of(plant, 0.0) > 0.0  # of the castor
    for share in (0.02, 0.1):
        slip = {"straight": Interval(value=share, low=0.5 * share, high=1.5 * share, count=4)}
        number: Any = ground_of_slip(slip, plant)
        site = type(plant.site).model_validate({**number.sets["plant.site"], "roughness": 0.0})
        moving = WheelsPlant(plant.model_copy(update={"site": site}), np.random.default_rng(1), 0)
        moving.set_wheel_speeds((4.0, 4.0))
        places = []
        for t_s in (4, 8):
            moving.advance(t_s * 10**9)
            truth = moving.truth()
            places.append((0.06 * truth.wheel_position_rad[0], truth.x_m))
        (rolled, gone), (rolled_after, gone_after) = places
        assert 1.0 - (gone_after - gone) / (rolled_after - rolled) == pytest.approx(share, rel=0.05)
