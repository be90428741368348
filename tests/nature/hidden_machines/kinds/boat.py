"""The yaw of a boat (first-order model of Nomoto)."""

import numpy as np

from tests.nature.hidden_machines import forces, signals
from tests.nature.hidden_machines.machine import Input, Machine, Number, Push, Sensor, Start, Values


def rates(x: Values, u: Values, p: Values, push: Push) -> Values:
    """Turn by the rudder."""
    return {
        "heading": x["rate"],
        "rate": push("moment", p["rudder_gain"] * u["rudder"] - p["damping"] * x["rate"]),
    }


def outputs(x: Values, u: Values, p: Values) -> Values:
    """Read compass and gyro."""
    return {"compass": x["heading"], "gyro": x["rate"]}


MACHINE = Machine(
    name="boat",
    step_s=0.5,
    samples=180,
    substeps=20,
    states={"heading": "rad", "rate": "rad/s"},
    inputs=(Input("rudder", "rad", -0.5, 0.5),),
    numbers=(Number("rudder_gain", "1/s^2", 0.05, 0.05), Number("damping", "1/s", 0.2, 0.08)),
    sensors=(Sensor("compass", "rad", 0.01), Sensor("gyro", "rad/s", 0.003, 0.001)),
    starts=(Start("heading", 0.5, "compass"), Start("rate", 0.01)),
    ports={"moment": ("rad/s^2", 0.001)},
    rates=rates,
    outputs=outputs,
    derivative="""
    moment = port("moment", p.rudder_gain * u.rudder - p.damping * x.rate)
    return {"heading": x.rate, "rate": moment}
""",
    output='{"compass": x.heading, "gyro": x.rate}',
    catalogue=(
        signals.offset("port", "moment", 0.0005),
        forces.drag("moment", "rate", 0.2),
        signals.play("rudder", 0.01),
        signals.lag("input", "rudder", 0.5, 5.0),
        signals.delay("input", "rudder", 0.5, 5.0),
        signals.dead_zone("rudder", 0.01),
        signals.saturation("input", "rudder", 0.5),
        signals.offset("channel", "gyro", 0.003),
        signals.gain("channel", "gyro", 0.05),
    ),
    outside=(
        forces.term("moment", "hull", lambda x: x["rate"] ** 3, 3.0, (("rate",), "cube")),
        forces.term("moment", "waves", lambda x: np.sin(0.9 * x["time"]), 0.002),
        forces.term("moment", "one_sided_hull", lambda x: x["rate"] ** 2, 0.2, (("rate",), "square")),
        forces.drift("moment", 0.0005, 90.0),
    ),
    pairs=(
        ("rudder_lag", "rudder_play"),
        ("rudder_lag", "rudder_saturation"),
        ("rudder_lag", "rudder_dead_zone"),
    ),
)
