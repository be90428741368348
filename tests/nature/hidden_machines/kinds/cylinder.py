"""A hydraulic cylinder behind a servo valve."""

import numpy as np

from tests.nature.hidden_machines import forces, signals
from tests.nature.hidden_machines.machine import Input, Machine, Number, Push, Sensor, Start, Values


def rates(x: Values, u: Values, p: Values, push: Push) -> Values:
    """Push the piston by the difference of pressures, and fill its chambers."""
    flow = push("flow", p["valve_gain"] * u["valve"])
    force = push("force", p["area"] * x["pressure"] - p["damping"] * x["speed"])
    return {
        "position": x["speed"],
        "speed": force / p["mass"],
        "pressure": OIL_BAR_M * (flow - x["speed"]),
    }


OIL_BAR_M = 200.0


def outputs(x: Values, u: Values, p: Values) -> Values:
    """Read scale and manometer."""
    return {"scale": x["position"], "manometer": x["pressure"]}


MACHINE = Machine(
    name="cylinder",
    step_s=0.02,
    samples=200,
    substeps=20,
    states={"position": "m", "speed": "m/s", "pressure": "bar"},
    inputs=(Input("valve", "V", -5.0, 5.0),),
    numbers=(
        Number("valve_gain", "m/s/V", 0.04, 0.03),
        Number("area", "N/bar", 100.0, 0.02),
        Number("damping", "N s/m", 400.0, 0.1),
        Number("mass", "kg", 50.0, 0.03),
    ),
    sensors=(Sensor("scale", "m", 0.0008, 0.0005), Sensor("manometer", "bar", 0.1)),
    starts=(Start("position", 0.05, "scale"), Start("speed", 0.02), Start("pressure", 0.3, "manometer")),
    ports={"flow": ("m/s", 0.01), "force": ("N", 40.0)},
    rates=rates,
    outputs=outputs,
    derivative="""
    flow = port("flow", p.valve_gain * u.valve)
    force = port("force", p.area * x.pressure - p.damping * x.speed)
    return {"position": x.speed, "speed": force / p.mass, "pressure": 200.0 * (flow - x.speed)}
""",
    output='{"scale": x.position, "manometer": x.pressure}',
    catalogue=(
        signals.dead_zone("valve", 0.2),
        signals.offset("input", "valve", 0.1),
        signals.lag("input", "valve", 0.03, 0.2),
        signals.delay("input", "valve", 0.03, 0.2),
        signals.saturation("input", "valve", 5.0),
        forces.dry("force", "speed", 30.0, 0.002),
        forces.uneven("force", "speed", 15.0, 0.002),
        signals.offset("port", "force", 20.0),
        signals.wrong("valve_gain", 0.01),
    ),
    outside=(
        forces.root_friction("force", "speed", 100.0),
        forces.term(
            "flow",
            "turbulent_leak",
            lambda x: np.sign(x["pressure"]) * np.sqrt(np.abs(x["pressure"])),
            0.005,
            (("pressure",), "root"),
        ),
        forces.drift("flow", 0.01, 4.0),
    ),
    pairs=(
        ("valve_offset", "valve_dead_zone"),
        ("valve_lag", "valve_dead_zone"),
        ("valve_lag", "valve_saturation"),
    ),
)
