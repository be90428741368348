"""A belt conveyor with a load that is known in each run."""

import numpy as np

from tests.nature.hidden_machines import forces, signals
from tests.nature.hidden_machines.machine import (
    Condition,
    Input,
    Machine,
    Number,
    Push,
    Sensor,
    Start,
    Values,
)


def rates(x: Values, u: Values, p: Values, push: Push) -> Values:
    """Accelerate belt and load."""
    force = push("drive", u["force"] - p["resistance"] * x["speed"])
    return {"travel": x["speed"], "speed": force / (p["belt"] + p["load"])}


def outputs(x: Values, u: Values, p: Values) -> Values:
    """Read roller and tachometer."""
    return {"roller": x["travel"], "tachometer": x["speed"]}


MACHINE = Machine(
    name="conveyor",
    step_s=0.1,
    samples=150,
    substeps=20,
    states={"travel": "m", "speed": "m/s"},
    inputs=(Input("force", "N", -120.0, 120.0),),
    numbers=(Number("resistance", "N s/m", 40.0, 0.08), Number("belt", "kg", 80.0, 0.04)),
    sensors=(Sensor("roller", "m", 0.004, 0.002), Sensor("tachometer", "m/s", 0.02)),
    starts=(Start("travel", 0.002, "roller"), Start("speed", 0.2)),
    ports={"drive": ("N", 5.0)},
    rates=rates,
    outputs=outputs,
    derivative="""
    force = port("drive", u.force - p.resistance * x.speed)
    return {"travel": x.speed, "speed": force / (p.belt + p.load)}
""",
    output='{"roller": x.travel, "tachometer": x.speed}',
    catalogue=(
        forces.dry("drive", "speed", 4.0, 0.015),
        forces.uneven("drive", "speed", 2.0, 0.015),
        forces.stribeck("drive", "speed", 6.0, 0.015, 0.3),
        forces.drag("drive", "speed", 3.0),
        forces.cogging("drive", "travel", 8.0, 1.5, 0.4),
        signals.offset("port", "drive", 3.0),
        signals.delay("input", "force", 0.1, 0.8),
        signals.gain("channel", "tachometer", 0.05),
        signals.dead_zone("force", 4.0),
    ),
    outside=(
        forces.root_friction("drive", "speed", 4.0),
        forces.term("drive", "flexing", lambda x: x["speed"] ** 3, 2.0, (("speed",), "cube")),
        forces.drift("drive", 4.0, 15.0),
        forces.term("drive", "shake", lambda x: np.sin(2.6 * x["time"]), 6.0),
    ),
    conditions=(Condition("load", "kg", 0.0, 60.0),),
)
