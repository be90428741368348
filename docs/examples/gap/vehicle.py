"""A vehicle with measured poses; the heading is not wrapped at 180 deg."""

import numpy as np

from rover_hil.gap import Channel, Parameter, Port, RunParameter, StateModel, effects


def derivative(x, u, p, port):
    """Rate of each state, per second."""
    speed = port("speed_over_ground", u.speed)
    turn = port("turn", p.curvature * u.steering * speed)
    return {"east": speed * np.cos(x.heading), "north": speed * np.sin(x.heading), "heading": turn}


def start(p, u):
    """States at the first sample of a run."""
    return {"east": p.first_east, "north": p.first_north, "heading": p.first_heading}


def output(x, u, p, port):
    """Value of each channel."""
    return {"x": x.east, "y": x.north, "yaw": x.heading}


def make():
    """Make the model."""
    return StateModel(
        name="vehicle",
        states={"east": "m", "north": "m", "heading": "rad"},
        inputs={"speed": "m/s", "steering": "1"},
        is_held=True,
        derivative=derivative,
        start=start,
        output=output,
        channels=(
            Channel(name="x", unit="m", sigma=0.003),
            Channel(name="y", unit="m", sigma=0.003),
            Channel(name="yaw", unit="rad", sigma=0.005),
        ),
        parameters=(
            Parameter(name="curvature", unit="1/m", nominal=0.92, prior_sd=0.05, lower=0.05, upper=3.0),
        ),
        run_parameters=(
            RunParameter(name="first_east", unit="m", prior_sd=0.004, channel="x"),
            RunParameter(name="first_north", unit="m", prior_sd=0.004, channel="y"),
            RunParameter(name="first_heading", unit="rad", prior_sd=0.007, channel="yaw"),
        ),
        ports=(
            Port(name="turn", unit="rad/s", force_sd=0.05),
            Port(name="speed_over_ground", unit="m/s", force_sd=0.02),
        ),
        port_effects=(
            effects.lag("steering", size=0.1, longest=1.0, name="steering_lag"),
            effects.offset("steering", size=0.03, name="steering_offset"),
            effects.play("steering", size=0.02),
            effects.product(
                "turn", sources=("speed", "speed", "speed", "steering"), size=0.1, name="understeer"
            ),
            effects.gain_error("speed_over_ground", size=0.02, name="slip"),
        ),
    )
