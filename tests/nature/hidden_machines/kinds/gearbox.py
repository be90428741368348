"""A direct-current motor that turns a load through an elastic gearbox; all on the side of the load."""

import numpy as np

from tests.nature.hidden_machines import forces, signals
from tests.nature.hidden_machines.machine import Array, Input, Machine, Number, Push, Sensor, Start, Values

KNEE_V = 9.0
"""Voltage at which the iron of the motor is half-way into saturation."""


def rates(x: Values, u: Values, p: Values, push: Push) -> Values:
    """Twist the shaft between both inertias."""
    twist = push("twist", x["motor_angle"] - x["load_angle"])
    shaft = p["stiffness"] * twist + SHAFT_LOSS * (x["motor_speed"] - x["load_speed"])
    motor = push("motor_torque", p["torque_per_volt"] * u["voltage"] - p["motor_damping"] * x["motor_speed"])
    load = push("load_torque", shaft - p["load_damping"] * x["load_speed"])
    return {
        "motor_angle": x["motor_speed"],
        "motor_speed": (motor - shaft) / p["motor_inertia"],
        "load_angle": x["load_speed"],
        "load_speed": load / p["load_inertia"],
    }


SHAFT_LOSS = 0.05


def outputs(x: Values, u: Values, p: Values) -> Values:
    """Read both encoders."""
    return {"motor_encoder": x["motor_angle"], "load_encoder": x["load_angle"]}


def saturated(x: Values) -> Array:
    """Return the voltage's share that saturated iron does not turn into torque, V."""
    return np.asarray(x["voltage"] * (1.0 - 1.0 / np.sqrt(1.0 + (x["voltage"] / KNEE_V) ** 2)))


MACHINE = Machine(
    name="gearbox",
    step_s=0.02,
    samples=200,
    substeps=20,
    states={"motor_angle": "rad", "motor_speed": "rad/s", "load_angle": "rad", "load_speed": "rad/s"},
    inputs=(Input("voltage", "V", -10.0, 10.0),),
    numbers=(
        Number("torque_per_volt", "N m/V", 0.1, 0.03),
        Number("motor_damping", "N m s/rad", 0.05, 0.1),
        Number("load_damping", "N m s/rad", 0.05, 0.1),
        Number("motor_inertia", "kg m^2", 0.02, 0.03),
        Number("load_inertia", "kg m^2", 0.05, 0.03),
        Number("stiffness", "N m/rad", 20.0, 0.05),
    ),
    sensors=(Sensor("motor_encoder", "rad", 0.004, 0.003), Sensor("load_encoder", "rad", 0.004, 0.006)),
    starts=(
        Start("motor_angle", 0.002, "motor_encoder"),
        Start("motor_speed", 0.3),
        Start("load_angle", 0.002, "load_encoder"),
        Start("load_speed", 0.3),
    ),
    ports={"motor_torque": ("N m", 0.03), "load_torque": ("N m", 0.03), "twist": ("rad", 0.003)},
    rates=rates,
    outputs=outputs,
    derivative="""
    twist = port("twist", x.motor_angle - x.load_angle)
    shaft = p.stiffness * twist + 0.05 * (x.motor_speed - x.load_speed)
    motor = port("motor_torque", p.torque_per_volt * u.voltage - p.motor_damping * x.motor_speed)
    load = port("load_torque", shaft - p.load_damping * x.load_speed)
    return {
        "motor_angle": x.motor_speed,
        "motor_speed": (motor - shaft) / p.motor_inertia,
        "load_angle": x.load_speed,
        "load_speed": load / p.load_inertia,
    }
""",
    output='{"motor_encoder": x.motor_angle, "load_encoder": x.load_angle}',
    catalogue=(
        forces.dry("load_torque", "load_speed", 0.03, 0.08),
        forces.uneven("load_torque", "load_speed", 0.02, 0.08),
        forces.drag("load_torque", "load_speed", 0.002),
        forces.cogging("motor_torque", "motor_angle", 0.04, 2.0 * np.pi / 7.0, 0.7),
        signals.backlash("twist", 0.01),
        signals.offset("port", "load_torque", 0.02),
        signals.sag("voltage", 0.004),
        signals.dead_zone("voltage", 0.3),
    ),
    outside=(
        forces.root_friction("load_torque", "load_speed", 0.02),
        forces.term(
            "motor_torque",
            "magnetic_saturation",
            saturated,
            0.02,
            (("voltage",), "cube"),
            (("voltage",), "signed_square"),
        ),
        forces.term(
            "twist",
            "winding_up",
            lambda x: x["load_speed"] * np.abs(x["load_speed"]),
            0.0002,
            (("load_speed",), "signed_square"),
        ),
    ),
)
