"""Rovers that are described by a list of their wheels."""

import math
from pathlib import Path

import pytest

from controllers.motion.mission import corner_points
from controllers.safety import Mode
from drivers.errors import ConfigError
from rover_hil.config import load_config
from rover_hil.run.checks import VIRTUAL_RUN_CHECKS
from rover_hil.tune.simulated_mission import drive

EXAMPLES = Path(__file__).parents[2] / "docs" / "examples"


@pytest.mark.parametrize("name", ["differential", "six_wheels", "mecanum"])
def test_the_rover_ends_near_its_goal(name: str) -> None:
    config = load_config(str(EXAMPLES / f"{name}.toml"), VIRTUAL_RUN_CHECKS)
    assert config.mission is not None
    driven = drive(config)
    truth, estimate = driven.truth, driven.estimate
    x_m, y_m = corner_points(config.mission)[-1]
    assert driven.mode is Mode.FINISHED
    assert math.dist((truth.x_m[-1], truth.y_m[-1]), (x_m, y_m)) < 0.03
    assert math.dist((truth.x_m[-1], truth.y_m[-1]), (estimate.x_m[-1], estimate.y_m[-1])) < 0.02


def test_a_mapping_without_steering_is_refused(tmp_path: Path) -> None:
    can = EXAMPLES / "can" / "six_wheels.toml"
    lines = [line for line in can.read_text("utf-8").splitlines() if not line.startswith("steering_setpoint")]
    mapping = tmp_path / "six.toml"
    mapping.write_text("\n".join(lines), "utf-8")
    (tmp_path / "six_wheels.dbc").write_bytes((EXAMPLES / "can" / "six_wheels.dbc").read_bytes())
    text = (EXAMPLES / "six_wheels.toml").read_text("utf-8")
    path = tmp_path / "rover.toml"
    path.write_text(text.replace("docs/examples/can/six_wheels.toml", str(mapping)), "utf-8")
    with pytest.raises(
        ConfigError, match="wheels 0, 1, 4, 5 steer, but device 'wheels' has no steering set-points"
    ):
        load_config(str(path), VIRTUAL_RUN_CHECKS)


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


def test_a_jammed_steering_stops_the_rover() -> None:
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
            "loop": config.loop.model_copy(update={"time_limit_s": 14.0}),
        }
    )
    assert drive(config).mode is Mode.SAFE_STOP
