"""A balanced elevator with a load that is known in each run."""

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
    """Accelerate cabin, counterweight and load."""
    force = push("net", u["force"] - p["resistance"] * x["speed"])
    return {"height": x["speed"], "speed": force / (p["mass"] + p["load"])}


def outputs(x: Values, u: Values, p: Values) -> Values:
    """Read tape and tachometer."""
    return {"tape": x["height"], "tachometer": x["speed"]}


MACHINE = Machine(
    name="elevator",
    step_s=0.1,
    samples=200,
    substeps=12,
    states={"height": "m", "speed": "m/s"},
    inputs=(Input("force", "N", -600.0, 600.0),),
    numbers=(Number("mass", "kg", 1200.0, 0.03), Number("resistance", "N s/m", 220.0, 0.08)),
    sensors=(Sensor("tape", "m", 0.006, 0.002), Sensor("tachometer", "m/s", 0.02)),
    starts=(Start("height", 4.0, "tape"), Start("speed", 0.1)),
    ports={"net": ("N", 30.0)},
    rates=rates,
    outputs=outputs,
    derivative="""
    force = port("net", u.force - p.resistance * x.speed)
    return {"height": x.speed, "speed": force / (p.mass + p.load)}
""",
    output='{"tape": x.height, "tachometer": x.speed}',
    catalogue=(
        forces.dry("net", "speed", 30.0, 0.02),
        forces.uneven("net", "speed", 20.0, 0.02),
        forces.stribeck("net", "speed", 40.0, 0.02, 0.4),
        forces.cogging("net", "height", 40.0, 2.5, 1.1),
        signals.offset("port", "net", 20.0),
        forces.drag("net", "speed", 20.0),
        signals.gain("channel", "tachometer", 0.05),
        signals.lag("input", "force", 0.15, 1.5),
        signals.wrong("mass", 200.0),
    ),
    outside=(
        forces.term("net", "rope_weight", lambda x: x["height"], 5.0, (("height",), "linear")),
        forces.root_friction("net", "speed", 30.0),
        forces.term(
            "net", "sagging_rails", lambda x: x["height"] * x["speed"], 5.0, (("height", "speed"), "product")
        ),
    ),
    conditions=(Condition("load", "kg", 0.0, 400.0),),
)
