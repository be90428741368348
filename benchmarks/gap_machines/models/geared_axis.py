"""Motor with a gear."""

import math
from types import SimpleNamespace

from benchmarks.gap_machines.models.parts import begin, channel, constant, start_error
from rover_hil.gap import Array, Port, StateModel, effects
from sim_backends.state_model.equations import Signal

GEAR_RATIO = 20.0
SLOW_RAD_S = 1.0
IMPACT_S = 0.001
COGS_PER_TURN = 4.0


def derivative(x: SimpleNamespace, u: SimpleNamespace, p: SimpleNamespace, port: Signal) -> dict[str, Array]:
    """Return the rates of speed and angle of the motor."""
    speed = x.motor_speed_rad_s
    drive = p.torque_constant_v_s / p.resistance_ohm * (u.voltage_v - p.torque_constant_v_s * speed)
    torque = port("torque", drive - p.viscous_nm_s * speed)
    return {"motor_speed_rad_s": torque / p.inertia_kg_m2, "motor_angle_rad": speed}


def start(p: SimpleNamespace, _: SimpleNamespace) -> dict[str, Array]:
    """Return the first speed and angle."""
    return {name: begin(p, name) for name in ("motor_speed_rad_s", "motor_angle_rad")}


def output(x: SimpleNamespace, _: SimpleNamespace, __: SimpleNamespace, ___: Signal) -> dict[str, Array]:
    """Return the speed of the motor and the angle of the load."""
    return {"speed_rad_s": x.motor_speed_rad_s, "load_angle_rad": x.motor_angle_rad / GEAR_RATIO}


def make_model() -> StateModel:
    """Return the model with its candidate effects."""
    speed, angle = "motor_speed_rad_s", "motor_angle_rad"
    return StateModel(
        name="geared_axis",
        states={"motor_speed_rad_s": "rad/s", "motor_angle_rad": "rad"},
        inputs={"voltage_v": "V"},
        channels=(
            channel("speed_rad_s", "rad/s", 0.5, 0.1),
            channel("load_angle_rad", "rad", 0.01, 0.00628319),
        ),
        parameters=(
            constant("torque_constant_v_s", "V s", 0.05, 0.03, 0.002),
            constant("resistance_ohm", "ohm", 1.0, 0.05, 0.004),
            constant("inertia_kg_m2", "kg m^2", 1e-4, 0.05, 0.0),
            constant("viscous_nm_s", "N m s", 2e-4, 0.2, 0.02),
        ),
        derivative=derivative,
        start=start,
        output=output,
        step_s=0.01,
        run_parameters=(start_error("motor_angle_rad", "rad", 0.1),),
        ports=(Port(name="torque", unit="N m", force_sd=0.02),),
        port_effects=(
            effects.coulomb_friction("torque", velocity=speed, size=0.03, slow=SLOW_RAD_S),
            effects.asymmetric_friction("torque", velocity=speed, size=0.02, slow=SLOW_RAD_S),
            effects.presliding("torque", velocity=speed, size=0.03, distance=1.2, name="presliding_friction"),
            effects.two_body_backlash(
                "torque",
                inertia="inertia_kg_m2",
                load="load_angle_rad",
                ratio=GEAR_RATIO,
                size=2.0,
                impact_s=IMPACT_S,
            ),
            effects.dead_zone("voltage_v", size=1.0),
            effects.supply_sag("voltage_v", size=0.01),
            effects.delay("voltage_v", size=0.02, longest=0.1, name="input_delay"),
            effects.cogging("torque", position=angle, period=2.0 * math.pi / COGS_PER_TURN, size=0.07),
        ),
        condition_units={"start_motor_speed_rad_s": "rad/s", "start_motor_angle_rad": "rad"},
    )
