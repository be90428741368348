"""A pendulum that swings freely; stiffness is (2 pi / period)^2 of small swings."""

import numpy as np

from rover_hil.gap import Channel, Parameter, Port, RunParameter, StateModel, effects


def derivative(x, u, p, port):
    """Rate of each state, per second."""
    pull = -p.stiffness * np.sin(x.angle) - p.damping * x.rate
    return {"angle": x.rate, "rate": port("acceleration", pull)}


def start(p, u):
    """States at the first sample of a run."""
    return {"angle": p.first_angle, "rate": p.first_rate}


def output(x, u, p, port):
    """Value of each channel."""
    return {"angle_sensor": x.angle}


def make():
    """Make the model."""
    return StateModel(
        name="pendulum",
        states={"angle": "rad", "rate": "rad/s"},
        inputs={},
        derivative=derivative,
        start=start,
        output=output,
        channels=(Channel(name="angle_sensor", unit="rad", sigma=0.0005),),
        parameters=(
            Parameter(name="stiffness", unit="1/s^2", nominal=60.0, prior_sd=3.0, lower=5.0, upper=200.0),
            Parameter(name="damping", unit="1/s", nominal=0.05, prior_sd=0.05, lower=0.0, upper=5.0),
        ),
        run_parameters=(
            RunParameter(name="first_angle", unit="rad", prior_sd=0.005, channel="angle_sensor"),
            RunParameter(name="first_rate", unit="rad/s", prior_sd=3.0),
        ),
        ports=(Port(name="acceleration", unit="rad/s^2", force_sd=0.5),),
        port_effects=(
            effects.coulomb_friction("acceleration", velocity="rate", size=0.3, slow=0.05),
            effects.quadratic_drag("acceleration", velocity="rate", size=0.02),
            effects.cubic_stiffness("acceleration", position="angle", size=1.0),
            effects.offset("acceleration", size=0.3),
            effects.offset("angle_sensor", size=0.01, name="zero_error"),
            effects.gain_error("angle_sensor", size=0.02),
        ),
    )
