"""Heated body in a shell."""

from types import SimpleNamespace

from benchmarks.gap_machines.models.parts import begin, channel, constant, start_error
from rover_hil.gap import Array, Port, StateModel, effects
from sim_backends.state_model.equations import Signal

LIMITS_W = (18.0, 25.0, 32.0, 40.0, 50.0)


def derivative(x: SimpleNamespace, u: SimpleNamespace, p: SimpleNamespace, port: Signal) -> dict[str, Array]:
    """Return the rates of both temperatures."""
    between = p.conductance_w_k * (x.temperature_1_c - x.temperature_2_c)
    heat_1 = port("heat_1", p.heater_gain * u.heater_w - between)
    heat_2 = port("heat_2", between - p.loss_w_k * (x.temperature_2_c - u.room_c))
    return {"temperature_1_c": heat_1 / p.capacity_1_j_k, "temperature_2_c": heat_2 / p.capacity_2_j_k}


def start(p: SimpleNamespace, _: SimpleNamespace) -> dict[str, Array]:
    """Return the first temperatures."""
    return {name: begin(p, name) for name in ("temperature_1_c", "temperature_2_c")}


def output(x: SimpleNamespace, _: SimpleNamespace, __: SimpleNamespace, ___: Signal) -> dict[str, Array]:
    """Return the measured temperatures."""
    return {"measured_1_c": x.temperature_1_c, "measured_2_c": x.temperature_2_c}


def make_model() -> StateModel:
    """Return the model with its candidate effects."""
    return StateModel(
        name="thermal",
        states={"temperature_1_c": "degC", "temperature_2_c": "degC"},
        inputs={"heater_w": "W", "room_c": "degC"},
        channels=(channel("measured_1_c", "degC", 0.1, 0.05), channel("measured_2_c", "degC", 0.1, 0.05)),
        parameters=(
            constant("capacity_1_j_k", "J/K", 40.0, 0.04, 0.0),
            constant("capacity_2_j_k", "J/K", 150.0, 0.04, 0.0),
            constant("conductance_w_k", "W/K", 1.0, 0.06, 0.001),
            constant("loss_w_k", "W/K", 0.8, 0.06, 0.001),
            constant("heater_gain", "1", 1.0, 0.02, 0.001),
        ),
        derivative=derivative,
        start=start,
        output=output,
        step_s=4.0,
        run_parameters=(
            start_error("temperature_1_c", "degC", 0.3),
            start_error("temperature_2_c", "degC", 0.3),
        ),
        ports=(Port(name="heat_1", unit="W", force_sd=2.0), Port(name="heat_2", unit="W", force_sd=2.0)),
        port_effects=(
            effects.dead_zone("heater_w", size=7.0),
            effects.saturation("heater_w", limits=LIMITS_W),
            effects.supply_sag("heater_w", size=0.0027),
            effects.delay("heater_w", size=27.0, longest=150.0, name="input_delay"),
            effects.lag("measured_1_c", size=40.0, longest=250.0, name="sensor_lag"),
            effects.offset("measured_2_c", size=1.7, name="sensor_offset"),
        ),
        condition_units={"start_temperature_1_c": "degC", "start_temperature_2_c": "degC"},
    )
