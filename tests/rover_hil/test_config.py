"""Configurations: the shipped ones load; every mistake is one sentence with file, key and fix."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from drivers.camera.settings import CameraSettings
from drivers.errors import ConfigError
from rover_hil.config import Config, load_config, shipped_configs
from sim_backends.rear_scene.emulated_scene import make_rig
from sim_backends.rear_scene.settings import CameraEmulatorSettings

SHIPPED = Path(__file__).parents[2] / "rover_hil" / "config" / "shipped" / "configs"


@pytest.fixture
def edit(tmp_path: Path) -> Callable[[str, str], Path]:
    """Return a function that writes the robotino configuration with one text replaced."""

    def write(old: str, new: str) -> Path:
        text = (SHIPPED / "robotino.toml").read_text()
        assert old in text
        path = tmp_path / "edited.toml"
        path.write_text(text.replace(old, new, 1))
        return path

    return write


@pytest.mark.parametrize("name", ["robotino", "el-dorado", "robotino-camera", "el-dorado-camera"])
def test_shipped_configurations_load_and_survive_a_round_trip(name: str) -> None:
    assert name in shipped_configs()
    config = load_config(name)
    assert Config.model_validate_json(config.model_dump_json(by_alias=True)) == config


def test_the_robotino_with_a_camera_is_the_shipped_one_beside_it() -> None:
    plain, seeing = load_config("robotino"), load_config("robotino-camera")
    for section in ("rover", "loop", "mission", "slip", "filter", "safety", "limits"):
        assert getattr(seeing, section) == getattr(plain, section)
    assert {name: seeing.devices[name] for name in plain.devices} == plain.devices
    assert seeing.require_simulation().plant == plain.require_simulation().plant


@pytest.mark.parametrize(
    ("config", "rig"), [("robotino-camera", "robotino"), ("el-dorado-camera", "el-dorado")]
)
def test_the_shipped_rig_is_that_of_the_simulated_camera(config: str, rig: str) -> None:
    loaded = load_config(config)
    camera, scene = loaded.devices["camera"], loaded.require_simulation().devices["camera"]
    assert isinstance(camera, CameraSettings)
    assert isinstance(scene, CameraEmulatorSettings)
    simulated = make_rig(scene, camera.width, camera.height, camera.frame_rate_hz)
    shipped = json.loads((SHIPPED.parent / "rigs" / f"{rig}.json").read_text())
    assert shipped["image"] == {
        "width": simulated.width,
        "height": simulated.height,
        "fps": simulated.fps,
        "format": "bgr8",
    }
    assert np.array(shipped["camera_matrix"]) == pytest.approx(simulated.camera_matrix)
    assert shipped["dist_coeffs"]["values"] == pytest.approx(simulated.distortion)
    assert np.array(shipped["R_vehicle_camera"]) == pytest.approx(simulated.vehicle_from_camera, abs=1e-8)
    assert shipped["t_vehicle_camera"] == pytest.approx(simulated.camera_m)
    assert (shipped["wheel"] is not None) == simulated.leaves_traces


def test_the_old_name_of_the_scomp_section_is_accepted_with_a_note(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = (SHIPPED / "el-dorado.toml").read_text()
    path = tmp_path / "old.toml"
    path.write_text(text.replace("[scomp]", "[trace_slip]"))
    assert load_config(str(path)) == load_config("el-dorado")
    assert capsys.readouterr().err.splitlines() == [
        "[trace_slip] is now called [scomp]: rename it, the next version knows the new name only"
    ]


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (
            "wheel_radius_m = 0.040",
            "wheel_radius_mm = 40",
            "rover.wheel_radius_mm: unknown key; did you mean wheel_radius_m?",
        ),
        (
            "wheel_radius_m = 0.040",
            "wheel_radius_m = 40",
            "rover.wheel_radius_m: input should be less than or equal to 1, got 40",
        ),
        ("wheel_radius_m = 0.040", "", "rover.wheel_radius_m: this key is missing"),
        (
            "wheel_radius_m = 0.040",
            'wheel_radius_m = "big"',
            "rover.wheel_radius_m: input should be a valid number",
        ),
        (
            "wheel_radius_m = 0.040",
            "wheel_radius_m = nan",
            "rover.wheel_radius_m: input should be a finite number",
        ),
        ('kinematics = "omni3"', 'kinematics = "omni4"', "rover"),
        ('port = "ports/board"', 'prot = "ports/board"', "devices.board"),
        ('type = "robotino_board"', 'type = "robotino"', "devices.board"),
        ('wheels = "board"', 'wheels = "bord"', "roles.wheels: [devices] has no 'bord': name one of board"),
        (
            'wheels = "board"',
            'wheels = "imu"',
            "roles.wheels: device 'imu' turns no wheels: name one of board",
        ),
        (
            'schema = "rover-hil-config/1"',
            'schema = "rover-hil-config/2"',
            "schema: input should be 'rover-hil-config/1'",
        ),
        ("[devices.imu]", '[devices."a/imu"]', "a device cannot be called 'a/imu', use letters"),
        ("[devices.imu]", '[devices.""]', "a device cannot be called ''"),
        ("[devices.imu]", '[devices.".."]', "a device cannot be called '..'"),
        ("rate_hz = 50", "rate_hz = 0", "loop.rate_hz: input should be greater than or equal to 1"),
        ("length_m = 0.9", "length_m = 900", "mission.length_m: input should be less than or equal to 100"),
        ("[mission]", "[mission", "is not valid TOML"),
    ],
)
def test_mistakes_are_named(edit: Callable[[str, str], Path], old: str, new: str, words: str) -> None:
    path = edit(old, new)
    with pytest.raises(ConfigError) as caught:
        load_config(str(path))
    sentence = str(caught.value)
    assert sentence.startswith(str(path))
    assert words in sentence
    follows_from_it = f"{path}: roles.gyro: [devices] has no 'imu': name one of board"
    assert [line for line in sentence.splitlines() if line != follows_from_it] == sentence.splitlines()[:1]


def test_unknown_name_lists_the_shipped_ones() -> None:
    with pytest.raises(
        ConfigError,
        match="one of el-dorado, el-dorado-camera, el-dorado-crab, robotino, robotino-camera",
    ):
        load_config("robotinho")


def test_folder_and_binary_are_said_so(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="is a folder"):
        load_config(str(tmp_path))
    path = tmp_path / "binary.toml"
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ConfigError, match="cannot read configuration"):
        load_config(str(path))


def test_the_rear_camera_is_required_only_where_the_configuration_says_so() -> None:
    config = load_config("el-dorado")
    required = config.roles.model_copy(update={"require_camera": True})
    assert config.roles.camera is not None
    assert config.roles.camera not in config.device_roles().required
    changed = config.model_copy(update={"roles": required})
    assert config.roles.camera in changed.device_roles().required
