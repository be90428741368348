"""The supply voltage that simulated devices report can fall."""

import pytest

from drivers.clock import nanoseconds
from rover_hil.config import Config, load_config
from sim_backends.build import build_world


@pytest.mark.parametrize("name", ["robotino", "el-dorado", "docs/examples/differential.toml"])
def test_the_reported_voltage_falls_from_the_start(name: str) -> None:
    table = load_config(name).model_dump(by_alias=True)
    table["simulation"]["plant"]["battery_fall_v_s"] = 2.0
    config = Config.model_validate(table)
    simulation = config.require_simulation()
    plant = build_world(config.devices, simulation, 0).plant
    first_v = plant.truth().battery_v
    plant.advance(nanoseconds(1.5))
    assert plant.truth().battery_v == pytest.approx(first_v - 3.0, abs=0.2)
    plant.advance(nanoseconds(20.0))
    assert plant.truth().battery_v == 0.0
