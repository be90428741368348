"""A bridge crane: a trolley that its load does not slow down, and the swing of the load."""

import numpy as np

from tests.nature.hidden_machines import forces, signals
from tests.nature.hidden_machines.machine import Input, Machine, Number, Push, Sensor, Start, Values

GRAVITY = 9.81


def rates(x: Values, u: Values, p: Values, push: Push) -> Values:
    """Drive the trolley and swing the load about its rope."""
    pull = push("push", u["force"] - p["resistance"] * x["speed"]) / p["mass"]
    swing = -(GRAVITY * np.sin(x["angle"]) + pull * np.cos(x["angle"])) / p["rope"]
    return {
        "position": x["speed"],
        "speed": pull,
        "angle": x["turn"],
        "turn": push("swing", swing - p["air"] * x["turn"]),
    }


def outputs(x: Values, u: Values, p: Values) -> Values:
    """Read scale and angle."""
    return {"scale": x["position"], "inclination": x["angle"]}


MACHINE = Machine(
    name="crane",
    step_s=0.1,
    samples=180,
    substeps=25,
    states={"position": "m", "speed": "m/s", "angle": "rad", "turn": "rad/s"},
    inputs=(Input("force", "N", -400.0, 400.0),),
    numbers=(
        Number("mass", "kg", 500.0, 0.03),
        Number("resistance", "N s/m", 250.0, 0.08),
        Number("rope", "m", 4.0, 0.02),
        Number("air", "1/s", 0.05, 0.15),
    ),
    sensors=(Sensor("scale", "m", 0.004, 0.002), Sensor("inclination", "rad", 0.003)),
    starts=(Start("position", 1.0, "scale"), Start("speed", 0.1), Start("angle", 0.1), Start("turn", 0.1)),
    ports={"push": ("N", 20.0), "swing": ("rad/s^2", 0.02)},
    rates=rates,
    outputs=outputs,
    derivative="""
    pull = port("push", u.force - p.resistance * x.speed) / p.mass
    swing = -(9.81 * np.sin(x.angle) + pull * np.cos(x.angle)) / p.rope - p.air * x.turn
    return {"position": x.speed, "speed": pull, "angle": x.turn, "turn": port("swing", swing)}
""",
    output='{"scale": x.position, "inclination": x.angle}',
    catalogue=(
        forces.dry("push", "speed", 15.0, 0.01),
        forces.uneven("push", "speed", 10.0, 0.01),
        forces.drag("push", "speed", 20.0),
        forces.drag("swing", "turn", 0.3),
        signals.offset("channel", "inclination", 0.005),
        signals.offset("port", "push", 10.0),
        signals.dead_zone("force", 15.0),
        signals.lag("input", "force", 0.1, 1.0),
        signals.wrong("rope", 0.5),
    ),
    outside=(
        forces.root_friction("push", "speed", 15.0),
        forces.term("swing", "stiff_rope", lambda x: x["angle"] ** 2, 0.3, (("angle",), "square")),
        forces.term("swing", "gusts", lambda x: np.sin(1.1 * x["time"]), 0.02),
    ),
    pairs=(("force_lag", "force_dead_zone"),),
)
