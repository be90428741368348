"""A rover of a list of wheels against its logs: the effect in the truth is named, and no other."""

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import pytest

from benchmarks.gap.drive_logs import Poses, write_log
from benchmarks.gap.tricycle import write_config, write_drive
from rover_hil.config import load_config
from rover_hil.gap.data.rover_logs import read_rover_runs
from sim_backends.models.interface import Array, Run
from sim_backends.plants.wheels.plant import WheelsPlant
from sim_backends.plants.wheels.settings import WheelsPlantSettings
from sim_backends.wheels_model.model import WheelsModel
from tests.cases import first_often
from tests.nature.differential_drive import TrueDifferential, record
from tests.rover_hil.command import Command, assert_one_sentence

ROOT = Path(__file__).parents[3]
DIFFERENTIAL = "docs/examples/differential.toml"
LOGS = 6


@pytest.fixture(autouse=True)
def _in_the_project(monkeypatch: pytest.MonkeyPatch, command: Command) -> None:
    """Run from where the example finds its files."""
    monkeypatch.chdir(ROOT)


def write_logs(folder: Path, rover: TrueDifferential, poses: Poses = "truth", count: int = LOGS) -> Path:
    rng, config = np.random.default_rng(0), load_config(DIFFERENTIAL)
    for number in range(count):
        write_log(folder / f"{number}" / "run.mcap", config, record(rover, rng), poses)
    return folder


Analyse: TypeAlias = Callable[[TrueDifferential, Poses], dict[str, Any]]


@pytest.fixture
def analyse(command: Command, tmp_path: Path, unrendered: None) -> Analyse:
    """Return a function that writes logs of a rover and returns the verdict on them."""

    def run(rover: TrueDifferential, poses: Poses) -> dict[str, Any]:
        runs, out = write_logs(tmp_path / "runs", rover, poses), tmp_path / "gap"
        assert command("gap", "rover", DIFFERENTIAL, str(runs), "--out", str(out)) == 0
        verdict: dict[str, Any] = json.loads((out / "verdict.json").read_text("utf-8"))
        return verdict

    return run


@pytest.mark.slow
def test_no_gap_where_there_is_none(analyse: Analyse) -> None:
    assert analyse(TrueDifferential(), "truth")["verdict"] == "NO_GAP"


@pytest.mark.parametrize(
    ("rover", "poses", "name", "size", "channel"),
    first_often(
        [
            (TrueDifferential(track_m=0.33), "fixes", "base_radius", 0.1, "turn_rad_s"),
            (TrueDifferential(left_larger=0.03), "truth", "uneven_wheel", 0.03, "turn_rad_s"),
            (TrueDifferential(gyro_gain=1.05), "truth", "gyro_scale", 0.05, "gyro_rad_s"),
        ]
    ),
)
@pytest.mark.slow
def test_the_effect_is_named_with_its_size_and_the_gap_shrinks(
    analyse: Analyse, rover: TrueDifferential, poses: Poses, name: str, size: float, channel: str
) -> None:
    verdict = analyse(rover, poses)
    assert verdict["verdict"] in ("NAMED", "PARTLY_NAMED")
    (effect,) = verdict["effects"]
    assert effect["name"] == name
    assert next(iter(effect["parameters"].values()))["value"] == pytest.approx(size, rel=0.1)
    gap = verdict["gap"][channel]
    assert gap["after"] < 0.3 * gap["before"]


def test_logs_without_a_pose_are_refused_in_one_sentence(command: Command, tmp_path: Path) -> None:
    runs = write_logs(tmp_path / "runs", TrueDifferential(), "none", count=1)
    assert command("gap", "rover", DIFFERENTIAL, str(runs), "--out", str(tmp_path / "gap")) == 1
    assert "holds no true pose, neither on /truth nor as pose fixes" in command.out
    assert not (tmp_path / "gap").exists() or not list((tmp_path / "gap").iterdir())


def test_several_logs_may_be_given_one_by_one(command: Command, tmp_path: Path) -> None:
    runs = write_logs(tmp_path / "runs", TrueDifferential(), count=2)
    logs = sorted(map(str, runs.rglob("*.mcap")))
    assert command("gap", "rover", DIFFERENTIAL, *logs, "--out", str(tmp_path / "gap")) == 1
    assert "2 runs are too few" in command.out


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--config", "robotino", "runs"), "type = 'wheels'"),
        (("--config", DIFFERENTIAL, "runs", "--cut", "5"), "leave out --config"),
        (("side-slope",), "gap needs a model and one file or folder"),
    ],
)
def test_what_does_not_fit_is_refused(
    command: Command, tmp_path: Path, arguments: tuple[str, ...], message: str
) -> None:
    (tmp_path / "runs").mkdir()
    given = [str(tmp_path / "runs") if one == "runs" else one for one in arguments]
    assert command("gap", *given, "--out", str(tmp_path / "gap")) == 2
    assert message in command.error
    assert_one_sentence(command.error)


@pytest.mark.parametrize("name", ["differential", "six_wheels", "mecanum"])
def test_the_balance_of_forces_is_the_steady_state_of_the_simulated_rover(name: str) -> None:
    settings = load_config(f"docs/examples/{name}.toml").require_simulation().plant
    assert isinstance(settings, WheelsPlantSettings)
    site = settings.site.model_copy(update={"floor": "gray", "roughness": 0.0, "patches": ()})
    settings = settings.model_copy(update={"site": site, "wheel_friction_nm": 0.0})
    plant, model = WheelsPlant(settings, np.random.default_rng(0), 0), WheelsModel(settings)
    speeds = [1.5 + 0.4 * (wheel % 2) for wheel in range(model.wheel_count)]
    plant.set_wheel_speeds(speeds)
    plant.advance(8_000_000_000)
    truth = plant.truth()
    inputs = {
        f"wheel_{wheel}_rad_s": truth.wheel_speed_rad_s[wheel - 1] for wheel in range(1, len(speeds) + 1)
    }
    if model.steers:
        inputs |= {f"steering_{wheel}_rad": 0.0 for wheel in range(1, len(speeds) + 1)}
    series = {key: np.full(40, value) for key, value in inputs.items()}
    turning = truth.yaw_rate_rad_s * truth.velocity_x_m_s
    run = Run(
        name="steady",
        conditions={"speed_m_s": 0.1},
        inputs={"t_s": np.linspace(0.0, 7.8, 40), "heading_rad": np.zeros(40), **series},
    )
    found = {key: float(values[20]) for key, values in model.predict([run], {}, {})[0].items()}
    # The model leaves the centrifugal force out: a share of the weight, over the stiffness of the contact.
    sideways = 0.02 + abs(turning) / 9.81
    assert found["forward_m_s"] == pytest.approx(truth.velocity_x_m_s, abs=0.002)
    assert found["turn_rad_s"] == pytest.approx(truth.yaw_rate_rad_s, abs=0.01)
    assert found["left_m_s"] == pytest.approx(truth.velocity_y_m_s, abs=sideways * abs(truth.velocity_x_m_s))


def tricycle_run(
    rng: np.random.Generator, steering_rad: float, offset_rad: float, ratio: float = 1.0
) -> Array:
    """Return a drive of a tricycle in arcs: time, pose, ticks of the front wheel, its measured steering."""
    t_s = 0.05 * np.arange(400)
    speed_m_s = 0.15 + 0.1 * np.sin(0.5 * t_s + rng.uniform(0.0, 6.0))
    true_rad = steering_rad * np.sin(0.3 * t_s) + offset_rad
    turn = speed_m_s * np.sin(true_rad) / 0.15 * 0.05
    yaw = np.concatenate(([0.0], np.cumsum(turn[1:])))
    way_m = speed_m_s * np.cos(true_rad) * 0.05
    steps = np.stack((way_m * np.cos(yaw - turn / 2.0), way_m * np.sin(yaw - turn / 2.0)), axis=1)
    place_m = np.concatenate((np.zeros((1, 2)), np.cumsum(steps[1:], axis=0)))
    place_m = place_m + 0.0003 * rng.standard_normal(place_m.shape)
    ticks = speed_m_s * 0.05 / 0.0325 * 1600.0 / math.tau
    measured = yaw + 0.0005 * rng.standard_normal(yaw.size)
    return np.column_stack((t_s, place_m, measured, ticks, (true_rad - offset_rad) / ratio))


@pytest.mark.parametrize(("offset_rad", "answer"), [(0.0, "NO_GAP"), (-0.03, "NAMED")])
@pytest.mark.slow
def test_wheels_without_motor_and_sensor_roll_freely(
    command: Command, tmp_path: Path, unrendered: None, offset_rad: float, answer: str
) -> None:
    """A tricycle: the front wheel is driven, steered and measured; the rear ones only carry."""
    rng = np.random.default_rng(7)
    config = tmp_path / "tricycle.toml"
    rover = write_config(config)
    for number in range(LOGS):
        run = tricycle_run(rng, float(rng.uniform(-0.6, 0.6)), offset_rad)
        write_drive(tmp_path / "runs" / f"{number}" / "run.mcap", rover, run)
    out = tmp_path / "gap"
    assert command("gap", "rover", str(config), str(tmp_path / "runs"), "--out", str(out)) == 0
    verdict = json.loads((out / "verdict.json").read_text("utf-8"))
    assert verdict["verdict"] == answer, verdict["sentence"]
    assert [one["name"] for one in verdict["effects"]] == (["steering_offset"] if offset_rad else [])
    if offset_rad:
        low, high = verdict["effects"][0]["parameters"]["angle_deg"]["ci95"]
        assert low < math.degrees(offset_rad) < high
    radius = next(one for one in verdict["base_parameters"] if one["name"] == "radius_error")
    assert radius["ci95"][0] < 0.0 < radius["ci95"][1]
    assert not any(one["name"].startswith("wheel_") for one in verdict["base_parameters"])


def test_freely_rolling_wheels_only_hold_their_axle(tmp_path: Path) -> None:
    settings = write_config(tmp_path / "tricycle.toml").require_simulation().plant
    assert isinstance(settings, WheelsPlantSettings)
    series = {"wheel_1_rad_s": 5.0, "steering_1_rad": 0.4, "steering_2_rad": 0.0, "steering_3_rad": 0.0}
    inputs = {key: np.full(40, value) for key, value in series.items()}
    run = Run(
        name="steady",
        conditions={"speed_m_s": 0.1},
        inputs={"t_s": np.linspace(0.0, 7.8, 40), "heading_rad": np.zeros(40), **inputs},
    )
    found = WheelsModel(settings).predict([run], {}, {})[0]
    assert found["forward_m_s"][20] == pytest.approx(0.0325 * 5.0 * math.cos(0.4), rel=0.01)
    assert found["turn_rad_s"][20] == pytest.approx(0.0325 * 5.0 * math.sin(0.4) / 0.15, rel=0.01)
    assert found["left_m_s"][20] == pytest.approx(0.0, abs=0.001)


def test_measured_stretches_are_longer_where_the_rover_goes_farther(tmp_path: Path) -> None:
    write_logs(tmp_path / "runs", TrueDifferential(slip=-0.03), count=4)
    settings = load_config(DIFFERENTIAL).require_simulation().plant
    assert isinstance(settings, WheelsPlantSettings)
    model = WheelsModel(settings)
    runs = read_rover_runs(model, [tmp_path / "runs"])
    tables = model.predict(runs, {}, {})
    for channel in ("stretch_forward_m", "stretch_turn_rad"):
        measured = np.concatenate([run.measured[channel] for run in runs])
        predicted = np.concatenate([table[channel] for table in tables])
        good = np.isfinite(measured)
        assert np.isfinite(predicted[good]).all()
        share = float(measured[good] @ predicted[good] / (predicted[good] @ predicted[good]))
        assert share == pytest.approx(1.03, abs=0.008), channel


def test_wheels_that_hold_no_turn_give_no_prediction_and_no_error() -> None:
    """Wheels that all stand at one point resist no turn."""
    settings = load_config("docs/examples/six_wheels.toml").require_simulation().plant
    assert isinstance(settings, WheelsPlantSettings)
    model = WheelsModel(settings)
    series = {f"wheel_{wheel}_rad_s": 5.0 for wheel in model.driven}
    series |= {f"steering_{wheel}_rad": 0.0 for wheel in range(1, model.wheel_count + 1)}
    inputs = {key: np.full(40, value) for key, value in series.items()}
    inputs |= {"t_s": np.linspace(0.0, 7.8, 40), "heading_rad": np.zeros(40)}
    run = Run(name="sliding", conditions={"speed_m_s": 0.1}, inputs=inputs)
    found = model.predict([run], {"base_error": -1.0}, {})[0]
    assert np.isnan(found["forward_m_s"]).all()
