"""Driven pendulum."""

from types import SimpleNamespace

import numpy as np

from benchmarks.gap_machines.models.parts import begin, channel, constant, start_error
from rover_hil.gap import Array, Port, StateModel, effects
from sim_backends.state_model.equations import Signal

SLOW_RAD_S = 0.02


def derivative(x: SimpleNamespace, u: SimpleNamespace, p: SimpleNamespace, port: Signal) -> dict[str, Array]:
    """Return the rates of angle and rate."""
    torque = port(
        "torque",
        p.drive_gain * u.torque_nm - p.gravity_nm * np.sin(x.angle_rad) - p.viscous_nm_s * x.rate_rad_s,
    )
    return {"angle_rad": x.rate_rad_s, "rate_rad_s": torque / p.inertia_kg_m2}


def start(p: SimpleNamespace, _: SimpleNamespace) -> dict[str, Array]:
    """Return the first angle and rate."""
    return {name: begin(p, name) for name in ("angle_rad", "rate_rad_s")}


def output(x: SimpleNamespace, _: SimpleNamespace, __: SimpleNamespace, ___: Signal) -> dict[str, Array]:
    """Return the measured angle."""
    return {"measured_angle_rad": x.angle_rad}


def make_model() -> StateModel:
    """Return the model with its candidate effects."""
    rate, angle = "rate_rad_s", "angle_rad"
    return StateModel(
        name="pendulum",
        states={"angle_rad": "rad", "rate_rad_s": "rad/s"},
        inputs={"torque_nm": "N m"},
        channels=(channel("measured_angle_rad", "rad", 0.004, 0.00153398),),
        parameters=(
            constant("inertia_kg_m2", "kg m^2", 0.02, 0.04, 0.0),
            constant("gravity_nm", "N m", 0.75, 0.03, 0.0003),
            constant("viscous_nm_s", "N m s", 0.015, 0.2, 0.005),
            constant("drive_gain", "1", 1.0, 0.03, 0.002),
        ),
        derivative=derivative,
        start=start,
        output=output,
        step_s=0.02,
        run_parameters=(
            start_error("angle_rad", "rad", 0.01),
            start_error("rate_rad_s", "rad/s", 0.01),
        ),
        ports=(Port(name="torque", unit="N m", force_sd=0.01),),
        port_effects=(
            effects.coulomb_friction("torque", velocity=rate, size=0.03, slow=SLOW_RAD_S),
            effects.stribeck_friction("torque", velocity=rate, size=0.03, speed=0.5, slow=SLOW_RAD_S),
            effects.quadratic_drag("torque", velocity=rate, size=0.01),
            effects.cubic_stiffness("torque", position=angle, size=0.07),
            effects.lag("torque_nm", size=0.13, longest=0.6, name="actuator_lag"),
            effects.delay("torque_nm", size=0.1, longest=0.5, name="input_delay"),
            effects.offset("measured_angle_rad", size=0.07, name="sensor_offset"),
        ),
        condition_units={"start_angle_rad": "rad", "start_rate_rad_s": "rad/s"},
    )
