"""Coil, resistor and capacitor on an amplifier."""

from types import SimpleNamespace

from benchmarks.gap_machines.models.parts import begin, channel, constant, start_error
from rover_hil.gap import Array, Port, StateModel, effects
from sim_backends.state_model.equations import Signal

SLOW_A = 1e-3
LIMITS_V = (2.5, 3.5, 4.5, 6.0, 8.0)


def derivative(x: SimpleNamespace, u: SimpleNamespace, p: SimpleNamespace, port: Signal) -> dict[str, Array]:
    """Return the rates of current and capacitor voltage."""
    voltage = port(
        "coil_voltage", p.amplifier_gain * u.voltage_v - p.resistance_ohm * x.current_a - x.capacitor_v
    )
    current = port("capacitor_current", x.current_a)
    return {"current_a": voltage / p.inductance_h, "capacitor_v": current / p.capacitance_f}


def start(p: SimpleNamespace, _: SimpleNamespace) -> dict[str, Array]:
    """Return the first current and capacitor voltage."""
    return {name: begin(p, name) for name in ("current_a", "capacitor_v")}


def output(x: SimpleNamespace, _: SimpleNamespace, __: SimpleNamespace, ___: Signal) -> dict[str, Array]:
    """Return the measured current and voltage."""
    return {"measured_current_a": x.current_a, "measured_capacitor_v": x.capacitor_v}


def make_model() -> StateModel:
    """Return the model with its candidate effects."""
    return StateModel(
        name="circuit",
        states={"current_a": "A", "capacitor_v": "V"},
        inputs={"voltage_v": "V"},
        channels=(
            channel("measured_current_a", "A", 0.001, 0.0005),
            channel("measured_capacitor_v", "V", 0.05, 0.02),
        ),
        parameters=(
            constant("inductance_h", "H", 0.1, 0.04, 0.0005),
            constant("resistance_ohm", "ohm", 30.0, 0.05, 0.004),
            constant("capacitance_f", "F", 1e-5, 0.04, 0.0005),
            constant("amplifier_gain", "1", 1.0, 0.02, 0.001),
        ),
        derivative=derivative,
        start=start,
        output=output,
        step_s=0.0002,
        run_parameters=(start_error("capacitor_v", "V", 0.05),),
        ports=(
            Port(name="coil_voltage", unit="V", force_sd=0.3),
            Port(name="capacitor_current", unit="A", force_sd=0.003),
        ),
        port_effects=(
            effects.coulomb_friction(
                "coil_voltage", velocity="current_a", size=1.0, slow=SLOW_A, name="contact_drop"
            ),
            effects.dead_zone("voltage_v", size=1.0),
            effects.saturation("voltage_v", limits=LIMITS_V),
            effects.supply_sag("voltage_v", size=0.013),
            effects.delay("voltage_v", size=0.0002, longest=0.001, name="input_delay"),
            effects.lag("voltage_v", size=0.0003, longest=0.002, name="actuator_lag"),
            effects.offset("measured_current_a", size=0.013, name="sensor_offset"),
        ),
        condition_units={"start_current_a": "A", "start_capacitor_v": "V"},
    )
