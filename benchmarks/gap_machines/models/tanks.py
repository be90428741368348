"""Two coupled tanks."""

import math
from types import SimpleNamespace

import numpy as np

from benchmarks.gap_machines.models.parts import begin, channel, constant, start_error
from rover_hil.gap import Array, Port, StateModel, effects
from sim_backends.state_model.equations import Signal

SMALL_HEAD_M = 0.0005
RIMS_M = (0.12, 0.18, 0.25, 0.35, 0.45)
WEIR_M2_S = 0.015
LIMITS_V = (3.0, 4.0, 5.0, 6.5, 8.0)


def orifice_speed_m_s(head_m: Array) -> Array:
    """Return the speed through an orifice under a head."""
    speed: Array = math.sqrt(2.0 * 9.81) * head_m / np.sqrt(np.abs(head_m) + SMALL_HEAD_M)
    return speed


def derivative(x: SimpleNamespace, u: SimpleNamespace, p: SimpleNamespace, port: Signal) -> dict[str, Array]:
    """Return the rates of both levels."""
    between = p.pipe_m2 * orifice_speed_m_s(x.level_1_m - x.level_2_m)
    into_1 = port("inflow_1", p.pump_m3_s_v * u.pump_v - between)
    into_2 = port("inflow_2", between - p.outlet_m2 * orifice_speed_m_s(x.level_2_m))
    return {"level_1_m": into_1 / p.area_1_m2, "level_2_m": into_2 / p.area_2_m2}


def start(p: SimpleNamespace, _: SimpleNamespace) -> dict[str, Array]:
    """Return the first levels."""
    return {name: np.maximum(begin(p, name), 0.0) for name in ("level_1_m", "level_2_m")}


def output(x: SimpleNamespace, _: SimpleNamespace, __: SimpleNamespace, ___: Signal) -> dict[str, Array]:
    """Return the measured levels."""
    return {"measured_level_1_m": x.level_1_m, "measured_level_2_m": x.level_2_m}


def make_model() -> StateModel:
    """Return the model with its candidate effects."""
    return StateModel(
        name="tanks",
        states={"level_1_m": "m", "level_2_m": "m"},
        inputs={"pump_v": "V"},
        channels=(
            channel("measured_level_1_m", "m", 0.001, 0.0005),
            channel("measured_level_2_m", "m", 0.001, 0.0005),
        ),
        parameters=(
            constant("area_1_m2", "m^2", 0.0154, 0.02, 0.0),
            constant("area_2_m2", "m^2", 0.0154, 0.02, 0.0),
            constant("pump_m3_s_v", "m^3/s/V", 6e-6, 0.04, 0.001),
            constant("pipe_m2", "m^2", 5e-5, 0.05, 0.003),
            constant("outlet_m2", "m^2", 3e-5, 0.05, 0.001),
        ),
        derivative=derivative,
        start=start,
        output=output,
        step_s=2.0,
        run_parameters=(start_error("level_1_m", "m", 0.002), start_error("level_2_m", "m", 0.002)),
        ports=(
            Port(name="inflow_1", unit="m^3/s", force_sd=2e-6),
            Port(name="inflow_2", unit="m^3/s", force_sd=2e-6),
        ),
        port_effects=(
            effects.overflow("inflow_1", level="level_1_m", limits=RIMS_M, weir=WEIR_M2_S),
            effects.dead_zone("pump_v", size=1.3),
            effects.saturation("pump_v", limits=LIMITS_V),
            effects.delay("pump_v", size=20.0, longest=100.0, name="input_delay"),
            effects.lag("pump_v", size=27.0, longest=150.0, name="actuator_lag"),
            effects.offset("measured_level_1_m", size=0.017, name="sensor_offset"),
            effects.gain_error("measured_level_2_m", size=0.1),
        ),
        condition_units={"start_level_1_m": "m", "start_level_2_m": "m"},
    )
