"""A heating element inside a body: two masses, two thermometers. Temperatures are above that of the room."""

import numpy as np

from tests.nature.hidden_machines import forces, signals
from tests.nature.hidden_machines.machine import Array, Input, Machine, Number, Push, Sensor, Start, Values

STEFAN = 5.67e-8
ROOM_K = 293.0


def rates(x: Values, u: Values, p: Values, push: Push) -> Values:
    """Balance the heat of element and body."""
    passed = p["coupling"] * (x["element"] - x["body"])
    return {
        "element": (u["power"] - passed) / p["element_capacity"],
        "body": push("body_heat", passed - p["loss"] * x["body"]) / p["body_capacity"],
    }


def outputs(x: Values, u: Values, p: Values) -> Values:
    """Read both thermometers."""
    return {"element_probe": x["element"], "body_probe": x["body"]}


def radiated(x: Values) -> Array:
    """Return the heat that a square metre of the body radiates to the room, W."""
    return STEFAN * ((x["body"] + ROOM_K) ** 4 - ROOM_K**4)


MACHINE = Machine(
    name="heater",
    step_s=10.0,
    samples=150,
    substeps=20,
    states={"element": "K", "body": "K"},
    inputs=(Input("power", "W", 0.0, 200.0),),
    numbers=(
        Number("coupling", "W/K", 4.0, 0.05),
        Number("element_capacity", "J/K", 120.0, 0.05),
        Number("body_capacity", "J/K", 600.0, 0.03),
        Number("loss", "W/K", 1.2, 0.05),
    ),
    sensors=(Sensor("element_probe", "K", 0.5), Sensor("body_probe", "K", 0.15, 0.1)),
    starts=(Start("element", 20.0, "element_probe"), Start("body", 15.0, "body_probe")),
    ports={"body_heat": ("W", 5.0)},
    rates=rates,
    outputs=outputs,
    derivative="""
    passed = p.coupling * (x.element - x.body)
    heat = port("body_heat", passed - p.loss * x.body)
    return {"element": (u.power - passed) / p.element_capacity, "body": heat / p.body_capacity}
""",
    output='{"element_probe": x.element, "body_probe": x.body}',
    catalogue=(
        signals.offset("port", "body_heat", 3.0),
        signals.sag("power", 0.0004),
        signals.saturation("input", "power", 200.0),
        signals.delay("input", "power", 15.0, 80.0),
        signals.lag("input", "power", 15.0, 80.0),
        signals.wrong("loss", 0.3),
        forces.drag("body_heat", "body", 0.002),
        signals.dead_zone("power", 5.0),
    ),
    outside=(
        forces.term(
            "body_heat",
            "radiation",
            radiated,
            0.05,
            (("body",), "square"),
            (("body",), "signed_square"),
            (("body",), "cube"),
        ),
        forces.term(
            "body_heat",
            "boiling",
            lambda x: np.maximum(x["body"] - 60.0, 0.0),
            0.5,
            (("body",), "threshold"),
            (("body",), "cube"),
        ),
        forces.term(
            "body_heat", "draught", lambda x: x["body"] * x["power"], 0.001, (("body", "power"), "product")
        ),
    ),
)
