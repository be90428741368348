"""A shaker table: mass, spring, damper."""

import numpy as np

from tests.nature.hidden_machines import forces, signals
from tests.nature.hidden_machines.machine import Input, Machine, Number, Push, Sensor, Start, Values


def rates(x: Values, u: Values, p: Values, push: Push) -> Values:
    """Shake the table."""
    force = u["force"] - p["spring"] * x["position"] - p["damping"] * x["speed"]
    return {"position": x["speed"], "speed": push("total", force) / p["mass"]}


def outputs(x: Values, u: Values, p: Values) -> Values:
    """Read laser and geophone."""
    return {"laser": x["position"], "geophone": x["speed"]}


MACHINE = Machine(
    name="table",
    step_s=0.01,
    samples=200,
    substeps=20,
    states={"position": "m", "speed": "m/s"},
    inputs=(Input("force", "N", -40.0, 40.0),),
    numbers=(
        Number("spring", "N/m", 2000.0, 0.03),
        Number("damping", "N s/m", 25.0, 0.1),
        Number("mass", "kg", 5.0, 0.02),
    ),
    sensors=(Sensor("laser", "m", 0.0003, 0.0001), Sensor("geophone", "m/s", 0.008)),
    starts=(Start("position", 0.003, "laser"), Start("speed", 0.05)),
    ports={"total": ("N", 1.0)},
    rates=rates,
    outputs=outputs,
    derivative="""
    total = port("total", u.force - p.spring * x.position - p.damping * x.speed)
    return {"position": x.speed, "speed": total / p.mass}
""",
    output='{"laser": x.position, "geophone": x.speed}',
    catalogue=(
        forces.cubic("total", "position", 1.0e6),
        forces.dry("total", "speed", 1.0, 0.004),
        forces.drag("total", "speed", 20.0),
        forces.end_stop("total", "position", 1500.0, 0.014, (0.01, 0.014, 0.018)),
        signals.offset("port", "total", 0.8),
        signals.gain("channel", "geophone", 0.05),
        signals.delay("input", "force", 0.005, 0.05),
        signals.sag("force", 0.002),
        signals.dead_zone("force", 1.0),
    ),
    outside=(
        forces.term("total", "bent_spring", lambda x: x["position"] ** 2, 10000.0, (("position",), "square")),
        forces.root_friction("total", "speed", 2.0),
        forces.term(
            "total",
            "narrowing_damper",
            lambda x: x["position"] * x["speed"],
            1000.0,
            (("position", "speed"), "product"),
        ),
        forces.term("total", "hum", lambda x: np.sin(2.0 * np.pi * 7.0 * x["time"]), 1.0),
    ),
)
