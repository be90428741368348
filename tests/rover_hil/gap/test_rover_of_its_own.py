"""`gap rover` by what logs and files of columns know of their rover: no second configuration."""

import gzip
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from benchmarks.gap.drive_logs import write_log
from controllers.motion.kinematics import make_kinematics
from controllers.motion.rover_geometry import OmniRoverSettings, WheelsRoverSettings
from drivers.errors import ConfigError, LogError
from rover_hil.config import load_config
from rover_hil.drives.formats.table.columns import read_columns, rover_of
from rover_hil.drives.formats.table.to_log import write_table_as_log
from rover_hil.drives.presets import columns_file
from rover_hil.gap.command.rover import rover_subject
from rover_hil.gap.data.described_wheels import wheels_of
from sim_backends.models.interface import Run
from sim_backends.plants.wheels.settings import WheelsPlantSettings
from sim_backends.wheels_model.model import WheelsModel
from tests.nature.differential_drive import Recorded, TrueDifferential, record
from tests.rover_hil.command import Command

ROOT = Path(__file__).parents[3]
DIFFERENTIAL = "docs/examples/differential.toml"
MOST_LINES = 20
COLUMNS = """time = { column = "t" }
[[wheel]]
position = { column = "left", unit = "rad" }
[[wheel]]
position = { column = "right", unit = "rad" }
[imu]
yaw_rate = { column = "gyro" }
[truth]
x = { column = "x" }
y = { column = "y" }
yaw = { column = "yaw" }
[limits]
wheel_speed_rad_s = 60
wheel_acceleration_rad_s2 = 500
[rover]
kinematics = "wheels"
wheels = [{ x_m = 0.0, y_m = 0.15, radius_m = 0.06 }, { x_m = 0.0, y_m = -0.15, radius_m = 0.06 }]
"""
NAMES = ("t", "left", "right", "gyro", "x", "y", "yaw")


@pytest.fixture
def in_the_project(monkeypatch: pytest.MonkeyPatch) -> None:
    """Run from where the example finds its files."""
    monkeypatch.chdir(ROOT)


def drives(count: int, rover: TrueDifferential | None = None) -> list[Recorded]:
    rng = np.random.default_rng(0)
    return [record(rover or TrueDifferential(), rng) for _ in range(count)]


def write_table(path: Path, drive: Recorded) -> Path:
    table = np.column_stack((drive.t_s, drive.wheels_rad, drive.gyro_rad_s, drive.pose))
    lines = [",".join(NAMES), *(",".join(map(repr, row)) for row in table.tolist())]
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(gzip.compress("\n".join(lines).encode()))
    return path


def runs_of(source: str, *data: Path) -> list[Run]:
    subject = rover_subject(source, data)
    return subject.read(subject.make())


def assert_equal(runs: list[Run], others: list[Run]) -> None:
    assert len(runs) == len(others) > 0
    for run, other in zip(runs, others, strict=True):
        for series, same in ((run.inputs, other.inputs), (run.measured, other.measured)):
            assert series.keys() == same.keys()
            for name, values in series.items():
                np.testing.assert_array_equal(values, same[name])


def assert_same_prediction(model: WheelsModel, other: WheelsModel, runs: list[Run]) -> None:
    for table, same in zip(model.predict(runs, {}, {}), other.predict(runs, {}, {}), strict=True):
        for name, values in table.items():
            np.testing.assert_array_equal(values, same[name])


@pytest.mark.usefixtures("in_the_project")
def test_a_log_knows_the_rover_that_its_configuration_describes(tmp_path: Path) -> None:
    config = load_config(DIFFERENTIAL)
    for number, drive in enumerate(drives(2)):
        write_log(tmp_path / "runs" / f"{number}" / "run.mcap", config, drive)
    alone = rover_subject(str(tmp_path / "runs"), ())
    configured = rover_subject(DIFFERENTIAL, [tmp_path / "runs"])
    assert not alone.warnings
    model, other = alone.make(), configured.make()
    runs = alone.read(model)
    assert_equal(runs, configured.read(other))
    assert isinstance(model, WheelsModel)
    assert isinstance(other, WheelsModel)
    assert_same_prediction(model, other, runs)


@pytest.mark.usefixtures("in_the_project")
def test_the_wheels_of_a_simulated_log_are_those_the_rover_believed_in(tmp_path: Path) -> None:
    config = load_config(DIFFERENTIAL)
    simulation = config.require_simulation()
    plant = simulation.plant
    assert isinstance(plant, WheelsPlantSettings)
    left, right = plant.wheels
    wrong = plant.model_copy(
        update={"wheels": (left.model_copy(update={"radius_m": 0.07}), right), "wheel_radius_error": 0.1}
    )
    driven = config.model_copy(update={"simulation": simulation.model_copy(update={"plant": wrong})})
    write_log(tmp_path / "runs" / "run.mcap", driven, drives(1)[0])
    subject = rover_subject(str(tmp_path / "runs" / "run.mcap"), ())
    model = subject.make()
    assert isinstance(model, WheelsModel)
    assert_same_prediction(model, WheelsModel(plant), subject.read(model))


def test_tables_are_read_as_the_importer_reads_them(tmp_path: Path) -> None:
    columns_path = tmp_path / "columns.toml"
    columns_path.write_text(COLUMNS, "utf-8")
    tables = [
        write_table(tmp_path / f"{number}" / "run.csv.gz", drive) for number, drive in enumerate(drives(2))
    ]
    columns = read_columns(columns_path)
    for number, table in enumerate(tables):
        log = tmp_path / "logs" / f"{number}" / "run.mcap"
        log.parent.mkdir(parents=True)
        for _ in write_table_as_log(table, columns, rover_of(columns, columns_path), log):
            pass
    by_logs = runs_of(str(tmp_path / "logs"))
    assert_equal(runs_of(str(columns_path), *tables), by_logs)
    assert [run.name for run in by_logs] == [run.name for run in runs_of(str(columns_path), *tables)]
    # Logs are accepted beside the file of columns, too.
    assert_equal(runs_of(str(columns_path), tmp_path / "logs"), by_logs)


def test_what_the_model_assumes_is_a_warning_of_the_verdict(
    command: Command, tmp_path: Path, unrendered: None
) -> None:
    Path("columns.toml").write_text(COLUMNS, "utf-8")
    tables = [write_table(tmp_path / f"{number}.csv.gz", one) for number, one in enumerate(drives(1))]
    arguments = ("columns.toml", *map(str, tables), "--out", "gap", "--json")
    code = command("gap", "rover", *arguments)
    verdict = json.loads(command.out)
    assert any("the model assumes the same load on each wheel" in one for one in verdict["warnings"]), (
        code,
        verdict,
    )


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (
            lambda text: text.replace("[[wheel]]\nposition = { column = \"left\", unit = \"rad\" }\n", "")
            .replace("[[wheel]]\nposition", "[increments]\nturn = { column = \"gyro\" }\ndistance")
            .replace('column = "right", unit = "rad"', 'column = "right"')
            .replace('[imu]\nyaw_rate = { column = "gyro" }\n', ""),
            "[increments] holds no angles of the wheels",
        ),
        (
            lambda text: text[: text.index("[rover]")]
            + '[rover]\nkinematics = "skid_steer_4"\nwheel_radius_m = 0.06\ntrack_m = 0.3\n',
            "does not give the place of each wheel",
        ),
    ],
)  # fmt: skip
def test_a_rover_without_measured_places_and_wheels_is_refused(
    tmp_path: Path, change: Callable[[str], str], words: str
) -> None:
    columns = tmp_path / "columns.toml"
    columns.write_text(change(COLUMNS), "utf-8")
    with pytest.raises(ConfigError) as error:
        rover_subject(str(columns), [tmp_path / "drive.csv"])
    assert words in str(error.value)


def test_a_log_with_computed_wheels_is_refused(tmp_path: Path) -> None:
    columns_path = tmp_path / "columns.toml"
    text = COLUMNS.replace('[[wheel]]\nposition = { column = "left", unit = "rad" }\n', "")
    text = text.replace('[[wheel]]\nposition = { column = "right", unit = "rad" }', "[increments]")
    text = text.replace("[increments]", '[increments]\ndistance = { column = "d" }\nturn = { column = "w" }')
    columns_path.write_text(text.replace('[imu]\nyaw_rate = { column = "gyro" }\n', ""), "utf-8")
    table = tmp_path / "drive.csv"
    rows = [f"{0.02 * row},0.004,0.001,{0.004 * row},0,{0.001 * row}" for row in range(500)]
    table.write_text("t,d,w,x,y,yaw\n" + "\n".join(rows), "utf-8")
    columns = read_columns(columns_path)
    log = tmp_path / "drive.mcap"
    for _ in write_table_as_log(table, columns, rover_of(columns, columns_path), log):
        pass
    with pytest.raises(LogError) as error:
        runs_of(str(log))
    assert "imported from a path" in str(error.value)


@pytest.mark.usefixtures("in_the_project")
def test_logs_of_two_rovers_are_refused(tmp_path: Path) -> None:
    config = load_config(DIFFERENTIAL)
    rover = config.rover
    assert isinstance(rover, WheelsRoverSettings)
    wider = tuple(wheel.model_copy(update={"y_m": 1.1 * wheel.y_m}) for wheel in rover.wheels)
    other = config.model_copy(update={"rover": rover.model_copy(update={"wheels": wider})})
    first, second = drives(2)
    write_log(tmp_path / "runs" / "a" / "run.mcap", config, first)
    write_log(tmp_path / "runs" / "b" / "run.mcap", other, second)
    with pytest.raises(ConfigError) as error:
        runs_of(str(tmp_path / "runs"))
    assert "another [rover]" in str(error.value)


def test_three_omnidirectional_wheels_as_a_list_move_alike() -> None:
    omni = OmniRoverSettings(
        kinematics="omni3", wheel_radius_m=0.04, base_radius_m=0.135, wheel_angles_deg=(70.0, 185.0, 300.0)
    )
    wheels = wheels_of(omni)
    assert wheels is not None
    listed = make_kinematics(WheelsRoverSettings(kinematics="wheels", wheels=wheels))
    for motion in ((0.3, 0.0, 0.0), (0.0, 0.2, 0.0), (0.1, -0.2, 0.7)):
        assert listed.wheel_speeds(*motion) == pytest.approx(make_kinematics(omni).wheel_speeds(*motion))


@pytest.mark.parametrize("robot", ["diff", "omni3", "tricyc"])
def test_a_measured_robot_needs_one_file_of_twenty_lines(shared_data: Path, robot: str) -> None:
    columns = f"optiodom_{robot}"
    text = columns_file(Path(columns)).read_text("utf-8")
    assert len([line for line in text.splitlines() if line and not line.startswith("#")]) <= MOST_LINES
    folder = shared_data / "vehicles" / "optiodom" / robot / "circular"
    tables = sorted(folder.glob("*/*_run-01.csv.gz"))[:1]
    runs = runs_of(columns, *tables)
    assert len(runs) > 1  # one drive is cut into stretches
    model = rover_subject(columns, tables).make()
    (table,) = model.predict(runs[:1], {}, {})
    # The nominal wheels are nearly right, which a wrong order or sign is not.
    assert root_mean_square(runs[0], table, "forward_m_s", "left_m_s") < 0.25
    assert root_mean_square(runs[0], table, "turn_rad_s") < 0.25


def root_mean_square(run: Run, table: dict[str, np.ndarray], *channels: str) -> float:
    """Return the error of a prediction over the size of what was measured."""
    errors = [table[one] - run.measured[one] for one in channels]
    size = [run.measured[one] for one in channels]
    return float(np.sqrt(np.nanmean(np.square(errors)) / np.nanmean(np.square(size))))


@pytest.mark.slow
def test_a_measured_differential_robot_has_no_gap(
    command: Command, shared_data: Path, unrendered: None
) -> None:
    folder = shared_data / "vehicles" / "optiodom" / "diff" / "circular"
    tables = map(str, sorted(folder.glob("*/*_run-0?.csv.gz")))
    assert command("gap", "rover", "optiodom_diff", *tables, "--out", "gap") == 0, command.error
    assert json.loads(Path("gap/verdict.json").read_text("utf-8"))["verdict"] == "NO_GAP"
