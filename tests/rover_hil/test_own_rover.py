"""Rovers that are described by a list of their wheels."""

import math
from pathlib import Path

import pytest

from controllers.control_loop import ControlLoop
from controllers.roles import DeviceRoles
from controllers.safety import Mode
from drivers import can_wheels
from drivers.errors import ConfigError
from rover_hil.config import load_config
from rover_hil.ready.imu.calibration import GyroCalibration
from rover_hil.ready.procedure import Request, run
from rover_hil.run.checks import VIRTUAL_RUN_CHECKS
from rover_hil.tune.simulated_mission import drive

EXAMPLES = Path(__file__).parents[2] / "docs" / "examples"
SIX_MAPPING = (EXAMPLES / "can" / "six_wheels.toml").read_text("utf-8")
SIX_DBC = (EXAMPLES / "can" / "six_wheels.dbc").read_text("utf-8")


@pytest.mark.parametrize("name", ["differential", "six_wheels", "mecanum"])
@pytest.mark.slow
def test_the_rover_ends_near_its_goal(name: str) -> None:
    config = load_config(str(EXAMPLES / f"{name}.toml"), VIRTUAL_RUN_CHECKS)
    assert config.mission is not None
    driven = drive(config)
    truth, estimate = driven.truth, driven.estimate
    x_m, y_m = config.mission.corners()[-1]
    assert driven.mode is Mode.FINISHED
    assert math.dist((truth.x_m[-1], truth.y_m[-1]), (x_m, y_m)) < 0.03
    assert math.dist((truth.x_m[-1], truth.y_m[-1]), (estimate.x_m[-1], estimate.y_m[-1])) < 0.02


def write_six_wheels(folder: Path, mapping_text: str, dbc: str, *edits: tuple[str, str]) -> Path:
    """Write the six-wheel rover with another mapping and DBC file, and edits of its configuration."""
    mapping = folder / "six.toml"
    mapping.write_text(mapping_text, "utf-8")
    (folder / "six_wheels.dbc").write_text(dbc, "utf-8")
    text = (EXAMPLES / "six_wheels.toml").read_text("utf-8")
    for old, new in (("docs/examples/can/six_wheels.toml", str(mapping)), *edits):
        assert old in text
        text = text.replace(old, new)
    path = folder / "rover.toml"
    path.write_text(text, "utf-8")
    return path


def test_a_mapping_without_steering_is_refused(tmp_path: Path) -> None:
    lines = [line for line in SIX_MAPPING.splitlines() if not line.startswith("steering_setpoint")]
    path = write_six_wheels(tmp_path, "\n".join(lines), SIX_DBC)
    with pytest.raises(
        ConfigError, match="wheels 0, 1, 4, 5 steer, but device 'wheels' has no steering setpoints"
    ):
        load_config(str(path), VIRTUAL_RUN_CHECKS)


def test_a_steering_set_point_that_does_not_hold_the_angles_of_the_wheel_is_refused(tmp_path: Path) -> None:
    narrow = SIX_DBC.replace("[-180|180]", "[-60|180]", 1)
    path = write_six_wheels(tmp_path, SIX_MAPPING, narrow)
    with pytest.raises(ConfigError) as caught:
        load_config(str(path), VIRTUAL_RUN_CHECKS)
    (line,) = str(caught.value).splitlines()
    assert "rover.wheels.0.steering: the wheel steers from -75 to 75 deg, " in line
    assert "'wheels' holds only -60 to 180 deg: " in line
    just = SIX_DBC.replace("[-180|180]", "[-74.95|75]")  # coarse steps
    load_config(str(write_six_wheels(tmp_path, SIX_MAPPING, just)), VIRTUAL_RUN_CHECKS)


ACKERMANN = ("low_deg = -75, high_deg = 75", "low_deg = -20, high_deg = 20")


def test_small_turns_of_a_rover_that_cannot_turn_on_the_spot_are_refused(tmp_path: Path) -> None:
    waypoints = 'type = "waypoints"\npoints = [[1.0, 0.0], [1.5, 0.5], [1.5, 1.2]]'
    path = write_six_wheels(tmp_path, SIX_MAPPING, SIX_DBC, ACKERMANN, (waypoints, 'type = "small_turns"'))
    with pytest.raises(ConfigError, match="these are turns on the spot, for which"):
        load_config(str(path), VIRTUAL_RUN_CHECKS)
    with pytest.raises(ConfigError, match="these are turns on the spot, for which"):
        ControlLoop(load_config(str(path)), DeviceRoles(wheels="wheels", required={"wheels": 0.1}))


def test_the_gyro_calibration_refuses_a_rover_with_other_wheels_before_it_moves(tmp_path: Path) -> None:
    path = write_six_wheels(tmp_path, SIX_MAPPING, SIX_DBC)
    with pytest.raises(ConfigError, match="the gyro is identified with three omnidirectional wheels"):
        run(GyroCalibration(), Request(source=str(path), virtual=True, out=tmp_path / "imu.toml"))


def test_the_simulated_rover_has_the_wheels_of_the_configuration_unless_it_has_its_own(
    tmp_path: Path,
) -> None:
    text = (EXAMPLES / "mecanum.toml").read_text("utf-8")
    plant = load_config(str(EXAMPLES / "mecanum.toml")).require_simulation().plant
    assert plant.type == "wheels"
    assert [wheel.roller_deg for wheel in plant.wheels] == [45.0, -45.0, -45.0, 45.0]
    wheel = "[[simulation.plant.wheels]]\nx_m = {}\ny_m = {}\nradius_m = 0.051\nroller_deg = {}\n"
    own = "".join(wheel.format(x, y, math.copysign(45.0, x * y)) for x in (0.2, -0.2) for y in (0.15, -0.15))
    path = tmp_path / "own.toml"
    path.write_text(f"{text}\n{own}", "utf-8")
    plant = load_config(str(path)).require_simulation().plant
    assert plant.type == "wheels"
    assert {wheel.radius_m for wheel in plant.wheels} == {0.051}


@pytest.mark.slow
def test_a_jammed_steering_stops_the_rover_for_good_after_three_attempts() -> None:
    config = load_config(str(EXAMPLES / "six_wheels.toml"), VIRTUAL_RUN_CHECKS)
    simulation = config.require_simulation()
    plant = simulation.plant
    assert plant.type == "wheels"
    jammed = plant.wheels[0].model_copy(
        update={"steering": plant.wheels[0].steering.model_copy(update={"rate_deg_s": 1e-6})}
        if plant.wheels[0].steering is not None
        else {}
    )
    broken = plant.model_copy(update={"wheels": (jammed, *plant.wheels[1:])})
    config = config.model_copy(
        update={
            "simulation": simulation.model_copy(update={"plant": broken}),
            "loop": config.loop.model_copy(update={"time_limit_s": 30.0}),
        }
    )
    assert drive(config).mode is Mode.EMERGENCY_STOP


def write_differential(folder: Path, *quantities: str) -> Path:
    """Write the two-wheeled rover with drives that report only some quantities."""
    shipped = Path(can_wheels.__file__).parent
    (folder / "generic_wheel.dbc").write_bytes((shipped / "generic_wheel.dbc").read_bytes())
    lines = (
        (shipped / "generic_wheel.toml").read_text("utf-8").split("[[wheel]]\nnode = 2", 1)[0].splitlines()
    )
    names = ("position", "speed")
    kept = [line for line in lines if not line.startswith(names) or line.startswith(quantities)]
    (folder / "mapping.toml").write_text("\n".join(kept), "utf-8")
    text = (EXAMPLES / "differential.toml").read_text("utf-8")
    path = folder / "rover.toml"
    path.write_text(
        text.replace("docs/examples/can/differential.toml", str(folder / "mapping.toml")), "utf-8"
    )
    return path


def test_a_rover_whose_wheels_report_only_speeds_drives_its_mission(tmp_path: Path) -> None:
    config = load_config(str(write_differential(tmp_path, "speed")), VIRTUAL_RUN_CHECKS)
    driven = drive(config)
    truth, estimate = driven.truth, driven.estimate
    assert driven.mode is Mode.FINISHED
    assert math.dist((truth.x_m[-1], truth.y_m[-1]), (estimate.x_m[-1], estimate.y_m[-1])) < 0.05


def test_a_rover_whose_wheels_report_neither_angle_nor_speed_is_refused(tmp_path: Path) -> None:
    path = write_differential(tmp_path, "nothing")
    with pytest.raises(ConfigError, match="the wheel has neither position nor speed: add one"):
        load_config(str(path), VIRTUAL_RUN_CHECKS)
