"""A skid-steered rover with measured poses; the inputs are the speeds of its sides."""

import numpy as np

from tests.nature.hidden_machines import forces, signals
from tests.nature.hidden_machines.machine import Input, Machine, Number, Push, Sensor, Start, Values


def rates(x: Values, u: Values, p: Values, push: Push) -> Values:
    """Drive and rotate by mean and difference of the sides."""
    speed = push("speed", 0.5 * (u["left"] + u["right"]))
    rotation = push("rotation", (u["right"] - u["left"]) / p["track"])
    return {
        "east": speed * np.cos(x["heading"]),
        "north": speed * np.sin(x["heading"]),
        "heading": rotation,
    }


def outputs(x: Values, u: Values, p: Values) -> Values:
    """Read the overhead camera."""
    return {"x": x["east"], "y": x["north"], "yaw": x["heading"]}


MACHINE = Machine(
    name="skid_rover",
    step_s=0.1,
    samples=150,
    substeps=10,
    states={"east": "m", "north": "m", "heading": "rad"},
    inputs=(Input("left", "m/s", -0.25, 0.45), Input("right", "m/s", -0.25, 0.45)),
    numbers=(Number("track", "m", 0.7, 0.05),),
    sensors=(Sensor("x", "m", 0.005), Sensor("y", "m", 0.005), Sensor("yaw", "rad", 0.006)),
    starts=(Start("east", 1.0, "x"), Start("north", 1.0, "y"), Start("heading", 1.5, "yaw")),
    ports={"speed": ("m/s", 0.01), "rotation": ("rad/s", 0.02)},
    rates=rates,
    outputs=outputs,
    derivative="""
    speed = port("speed", 0.5 * (u.left + u.right))
    rotation = port("rotation", (u.right - u.left) / p.track)
    return {"east": speed * np.cos(x.heading), "north": speed * np.sin(x.heading), "heading": rotation}
""",
    output='{"x": x.east, "y": x.north, "yaw": x.heading}',
    catalogue=(
        signals.gain("input", "left", 0.02),
        signals.lag("input", "right", 0.1, 1.0),
        signals.offset("port", "rotation", 0.005),
        signals.gain("port", "speed", 0.02),
        signals.dead_zone("left", 0.01),
        signals.play("right", 0.01),
        forces.cogging("rotation", "heading", 0.01, 2.0 * np.pi, 0.8),
        signals.saturation("input", "left", 0.45),
        signals.delay("input", "left", 0.1, 1.0),
    ),
    outside=(
        forces.term(
            "speed", "digging", lambda x: x["left"] * x["right"], 0.1, (("left", "right"), "product")
        ),
        forces.term("rotation", "scrubbing", lambda x: x["left"] ** 3, 0.3, (("left",), "cube")),
        forces.drift("rotation", 0.01, 15.0),
        forces.term("speed", "side_hill", lambda x: x["north"], 0.005, (("north",), "linear")),
    ),
)
