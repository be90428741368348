"""A driven rover wheel that pulls a carriage through sand."""

import numpy as np

from tests.nature.hidden_machines import forces, signals
from tests.nature.hidden_machines.machine import Input, Machine, Number, Push, Sensor, Start, Values


def rates(x: Values, u: Values, p: Values, push: Push) -> Values:
    """Shear the sand by the slip velocity of the rim."""
    traction = push("traction", p["shear"] * (p["radius"] * x["wheel"] - x["carriage"]))
    return {
        "travel": x["carriage"],
        "wheel": push("axle", u["torque"] - p["radius"] * traction) / p["inertia"],
        "carriage": push("pull", traction - p["bulldozing"] * x["carriage"]) / p["mass"],
    }


def outputs(x: Values, u: Values, p: Values) -> Values:
    """Read encoder rate and laser."""
    return {"tachometer": x["wheel"], "laser": x["travel"]}


MACHINE = Machine(
    name="sand_wheel",
    step_s=0.1,
    samples=160,
    substeps=25,
    states={"travel": "m", "wheel": "rad/s", "carriage": "m/s"},
    inputs=(Input("torque", "N m", -3.0, 3.0),),
    numbers=(
        Number("shear", "N s/m", 120.0, 0.08),
        Number("radius", "m", 0.1, 0.01),
        Number("bulldozing", "N s/m", 60.0, 0.08),
        Number("inertia", "kg m^2", 0.4, 0.04),
        Number("mass", "kg", 20.0, 0.02),
    ),
    sensors=(Sensor("tachometer", "rad/s", 0.05), Sensor("laser", "m", 0.004, 0.002)),
    starts=(Start("travel", 0.1, "laser"), Start("wheel", 0.3, "tachometer"), Start("carriage", 0.05)),
    ports={"traction": ("N", 2.0), "axle": ("N m", 0.1), "pull": ("N", 2.0)},
    rates=rates,
    outputs=outputs,
    derivative="""
    traction = port("traction", p.shear * (p.radius * x.wheel - x.carriage))
    axle = port("axle", u.torque - p.radius * traction)
    pull = port("pull", traction - p.bulldozing * x.carriage)
    return {"travel": x.carriage, "wheel": axle / p.inertia, "carriage": pull / p.mass}
""",
    output='{"tachometer": x.wheel, "laser": x.travel}',
    catalogue=(
        forces.dry("pull", "carriage", 1.5, 0.004),
        signals.offset("port", "pull", 1.0),
        forces.drag("pull", "carriage", 15.0),
        signals.saturation("port", "traction", 30.0),
        forces.dry("axle", "wheel", 0.1, 0.06),
        signals.dead_zone("torque", 0.1),
        signals.sag("torque", 0.03),
        signals.lag("input", "torque", 0.1, 1.0),
        signals.gain("channel", "tachometer", 0.05),
    ),
    outside=(
        forces.root_friction("pull", "carriage", 2.0),
        forces.term("pull", "side_walls", lambda x: x["carriage"] ** 3, 60.0, (("carriage",), "cube")),
        forces.term(
            "pull",
            "sinking_spin",
            lambda x: x["wheel"] * np.abs(x["wheel"]),
            0.1,
            (("wheel",), "signed_square"),
        ),
    ),
    pairs=(("torque_lag", "torque_dead_zone"),),
)
