"""`--model`: what an analysis found becomes part of the simulated rover and of traverses."""

import json
import sys
from collections.abc import Callable, Mapping
from pathlib import Path

import pytest

from drivers.errors import ConfigError
from rover_hil.app.app import main
from rover_hil.config import load_config
from rover_hil.drive.extended_simulation import extend_simulation
from rover_hil.gap.output.model_file import ModelFile, Number, Provenance, model_file_text
from rover_hil.recording.data_files import restore_config
from rover_hil.recording.reader import LogReader
from sim_backends.models.interface import Model
from sim_backends.models.robotino_drive.model import make_model as make_drive
from sim_backends.models.robotino_motor.model import make_model as make_motor
from sim_backends.models.side_slope.model import make_model as make_side_slope
from sim_backends.plants.robotino.settings import RobotinoPlantSettings

Effects = Mapping[str, Mapping[str, float]]
BASES: Mapping[str, Callable[[], Model]] = {
    "robotino-motor": make_motor,
    "robotino-drive": make_drive,
    "side-slope": make_side_slope,
}
FAILURE: Effects = {"slope_failure": {"gain": 1.0, "onset": 5.0}}


def model_toml(folder: Path, base: str, effects: Effects) -> Path:
    """Write a model file with effects, units taken from the model."""
    model: Model = BASES[base]()
    units = {card.name: {item.name: item.unit for item in card.parameters} for card in model.effects}
    numbers = {
        name: {
            key: Number(value=value, unit=units[name][key], sd=0.1 * abs(value)) for key, value in one.items()
        }
        for name, one in effects.items()
    }
    source = Provenance(date="2026-01-01", verdict="NAMED", data_sha256="d", plan_sha256="p", seed=0)
    path = folder / "model.toml"
    path.write_text(model_file_text(ModelFile(base=base, provenance=source, parameters={}, effects=numbers)))
    return path


def plant_with(folder: Path, base: str, effects: Effects) -> RobotinoPlantSettings:
    simulation, _ = extend_simulation(load_config("robotino"), model_toml(folder, base, effects))
    assert isinstance(simulation.plant, RobotinoPlantSettings)
    return simulation.plant


def call(monkeypatch: pytest.MonkeyPatch, *arguments: str) -> int:
    monkeypatch.setattr(sys, "argv", ["rover-hil", *arguments])
    with pytest.raises(SystemExit) as caught:
        main()
    return caught.value.code if isinstance(caught.value.code, int) else 0


def test_friction_and_delay_go_into_the_plant_and_nothing_else(tmp_path: Path) -> None:
    effects = {
        "coulomb_friction": {"torque": 0.012},
        "viscous_friction": {"per_speed": 3e-5},
        "loop_delay": {"time": 0.2},
    }
    before = RobotinoPlantSettings()
    plant = plant_with(tmp_path, "robotino-motor", effects)
    assert plant.motor.friction_nm == 0.012
    assert plant.motor.viscous_nm_s == 3e-5
    assert plant.speed_loop.set_point_delay_s == 0.2
    assert plant.motor.resistance_ohm == before.motor.resistance_ohm
    assert plant.speed_loop.gain == before.speed_loop.gain


def test_a_changed_constant_is_added_to_that_of_the_model(tmp_path: Path) -> None:
    effects = {
        "winding_resistance": {"change": 1.0},
        "back_emf": {"change": 0.002},
        "load_inertia": {"change": 1e-6},
        "loop_stiffness": {"change": 0.05},
    }
    plant = plant_with(tmp_path, "robotino-motor", effects)
    assert plant.motor.resistance_ohm == pytest.approx(6.6)
    assert plant.motor.speed_constant_v_s_per_rad == pytest.approx(0.0528)
    assert plant.motor.torque_constant_nm_per_a == pytest.approx(0.0528)
    assert plant.motor.inertia_kg_m2 == pytest.approx(8.1e-6)
    # 0.4 V s/rad, 2.827 rad/s per tick, 26 V over 255 counts of the bridge.
    assert plant.speed_loop.gain == pytest.approx(0.4 * 2.8274 / (26.0 / 255.0), rel=1e-4)


def test_wheels_are_changed_beside_what_the_controller_believes(tmp_path: Path) -> None:
    effects = {"wheel_radius": {"error": -0.1}, "base_radius": {"error": 0.04}}
    plant = plant_with(tmp_path, "robotino-drive", effects)
    assert plant.wheel_radius_m == pytest.approx(0.036)
    assert plant.wheel_offset_m == pytest.approx(0.13)


@pytest.mark.parametrize(
    ("base", "effects", "words"),
    [
        ("robotino-drive", {"camera_scale": {"error": 0.1}}, "no camera_scale"),
        ("robotino-motor", {"winding_heat": {"per_watt": 5.0, "time": 60.0}}, "no winding_heat"),
        ("side-slope", FAILURE, "side-slope cannot be simulated"),
    ],
)
def test_what_the_plant_cannot_have_is_refused(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    base: str,
    effects: Effects,
    words: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    path = str(model_toml(tmp_path, base, effects))
    assert call(monkeypatch, "simulate", "robotino", "--duration", "0.1", "--model", path) == 2
    assert words in capsys.readouterr().err
    assert call(monkeypatch, "run", "robotino", "--virtual", "--out", "a", "--model", path) == 2
    assert not (tmp_path / "a").exists()


def test_another_rover_has_no_robotino_effects(tmp_path: Path) -> None:
    path = model_toml(tmp_path, "robotino-motor", {"coulomb_friction": {"torque": 0.012}})
    with pytest.raises(ConfigError, match="simulated Robotino"):
        extend_simulation(load_config("el-dorado"), path)


@pytest.mark.usefixtures("unrendered")
def test_a_virtual_run_has_the_effects_in_its_log(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    path = str(model_toml(tmp_path, "robotino-motor", {"coulomb_friction": {"torque": 0.012}}))
    assert call(monkeypatch, "run", "robotino", "--out", "a", "--model", path) == 2
    assert "--virtual" in capsys.readouterr().err
    arguments = ("run", "robotino", "--virtual", "--duration", "4", "--out", "a", "--model", path)
    assert call(monkeypatch, *arguments) == 0
    assert "motor.friction_nm: 0.0081 -> 0.012" in capsys.readouterr().err
    with restore_config(LogReader(tmp_path / "a" / "run.mcap")) as config:
        assert config.simulation is not None
        plant = config.simulation.plant
    assert isinstance(plant, RobotinoPlantSettings)
    assert plant.motor.friction_nm == 0.012
    # Its log can be asked; one short drive is too little.
    assert call(monkeypatch, "gap", "robotino-drive", "a", "--out", "g") == 1
    assert "1 runs are too few" in capsys.readouterr().out


def test_the_served_rover_says_what_was_changed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    path = str(model_toml(tmp_path, "robotino-drive", {"wheel_radius": {"error": 0.05}}))
    assert call(monkeypatch, "simulate", "robotino", "--duration", "0.1", "--model", path) == 0
    assert "wheel_radius_m: 0.04 -> 0.042" in capsys.readouterr().out


def traverses(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], *arguments: str
) -> list[dict[str, float | None]]:
    code = call(monkeypatch, "terrain", "traverse", "--roll-deg", "0,10", "--json", *arguments)
    out, err = capsys.readouterr()
    assert code == 0, err
    rows: list[dict[str, float | None]] = json.loads(out)
    return rows


def test_a_traverse_has_the_soil_that_fails(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    without = traverses(monkeypatch, capsys, "--model", str(model_toml(tmp_path, "side-slope", {})))
    paper = traverses(monkeypatch, capsys)
    failing = traverses(monkeypatch, capsys, "--model", str(model_toml(tmp_path, "side-slope", FAILURE)))
    for bare, known, more in zip(without, paper, failing, strict=True):
        # The model sees the path's mean from standstill on, a few percent short of its steady state.
        assert bare["slip_angle_deg"] == pytest.approx(known["slip_angle_deg"], rel=0.05)
        assert bare["sinkage_downhill_m"] == pytest.approx(known["sinkage_downhill_m"], rel=1e-3)
        assert bare["slip_angle_deg"] is not None
        assert more["slip_angle_deg"] is not None
        assert more["slip_angle_deg"] < bare["slip_angle_deg"] - 3.0
        assert more["boundary"] is None


@pytest.mark.parametrize(
    ("base", "effects", "options", "words"),
    [
        ("side-slope", FAILURE, ("--soil", "hit_lss1"), "leave out"),
        ("robotino-drive", {"wheel_radius": {"error": 0.05}}, (), "side-slope"),
    ],
)
def test_a_model_of_something_else_is_refused(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    base: str,
    effects: Effects,
    options: tuple[str, ...],
    words: str,
) -> None:
    path = str(model_toml(tmp_path, base, effects))
    assert call(monkeypatch, "terrain", "traverse", "--model", path, *options) == 2
    assert words in capsys.readouterr().err
