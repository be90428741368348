"""A pump that drives water through a pipe into a standpipe and back."""

import numpy as np

from tests.nature.hidden_machines import forces, signals
from tests.nature.hidden_machines.machine import Input, Machine, Number, Push, Sensor, Start, Values

WEIGHT_KPA_M = 9.81


def rates(x: Values, u: Values, p: Values, push: Push) -> Values:
    """Accelerate the water in the pipe against the level in the standpipe."""
    head = u["pressure"] - p["resistance"] * x["flow"] - WEIGHT_KPA_M * x["level"]
    return {"flow": push("head", head) / p["inertia"], "level": push("inflow", x["flow"]) / p["area"]}


def outputs(x: Values, u: Values, p: Values) -> Values:
    """Read flow meter and gauge."""
    return {"flow_meter": x["flow"], "gauge": x["level"]}


MACHINE = Machine(
    name="pump",
    step_s=0.5,
    samples=180,
    substeps=20,
    states={"flow": "L/s", "level": "m"},
    inputs=(Input("pressure", "kPa", -60.0, 60.0),),
    numbers=(
        Number("resistance", "kPa s/L", 20.0, 0.05),
        Number("inertia", "kPa s^2/L", 30.0, 0.05),
        Number("area", "L/m", 40.0, 0.02),
    ),
    sensors=(Sensor("flow_meter", "L/s", 0.02), Sensor("gauge", "m", 0.004, 0.002)),
    starts=(Start("flow", 0.3, "flow_meter"), Start("level", 0.5, "gauge")),
    ports={"head": ("kPa", 2.0), "inflow": ("L/s", 0.05)},
    rates=rates,
    outputs=outputs,
    derivative="""
    head = port("head", u.pressure - p.resistance * x.flow - 9.81 * x.level)
    return {"flow": head / p.inertia, "level": port("inflow", x.flow) / p.area}
""",
    output='{"flow_meter": x.flow, "gauge": x.level}',
    catalogue=(
        forces.drag("head", "flow", 2.0),
        signals.dead_zone("pressure", 2.0),
        signals.lag("input", "pressure", 0.4, 4.0),
        signals.delay("input", "pressure", 0.4, 4.0),
        signals.offset("port", "head", 1.0),
        signals.saturation("input", "pressure", 60.0),
        forces.dry("head", "flow", 1.5, 0.02),
        signals.offset("port", "inflow", 0.02),
        signals.wrong("area", 5.0),
    ),
    outside=(
        forces.term(
            "inflow",
            "second_outlet",
            lambda x: np.maximum(x["level"] - 0.8, 0.0),
            0.1,
            (("level",), "threshold"),
            (("level",), "cube"),
        ),
        forces.term(
            "inflow",
            "leak",
            lambda x: np.sign(x["level"]) * np.sqrt(np.abs(x["level"])),
            0.03,
            (("level",), "root"),
        ),
        forces.term("head", "elastic_wall", lambda x: x["flow"] ** 3, 1.0, (("flow",), "cube")),
    ),
    pairs=(
        ("pressure_lag", "pressure_dead_zone"),
        ("pressure_lag", "pressure_saturation"),
    ),
)
