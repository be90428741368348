"""The force of a linear axis from its measured motion."""

from rover_hil.gap import Channel, Parameter, Port, StateModel, effects


def derivative(x, u, p, port):
    """Rate of each state, per second."""
    return {}


def start(p, u):
    """States at the first sample of a run."""
    return {}


def output(x, u, p, port):
    """Value of each channel."""
    resistance = -p.mass * u.acceleration - p.viscous * u.velocity
    return {"force": -port("resistance", resistance)}


def make():
    """Make the model."""
    slow = 0.002
    return StateModel(
        name="drive",
        states={},
        inputs={"velocity": "m/s", "acceleration": "m/s^2"},
        is_held=False,
        step_s=0.02,
        derivative=derivative,
        start=start,
        output=output,
        channels=(Channel(name="force", unit="N", sigma=0.6, tolerance=1.0),),
        parameters=(
            Parameter(name="mass", unit="kg", nominal=20.0, prior_sd=2.0, lower=5.0, upper=80.0),
            Parameter(name="viscous", unit="N s/m", nominal=50.0, prior_sd=25.0, lower=0.0, upper=500.0),
        ),
        ports=(Port(name="resistance", unit="N", force_sd=2.0),),
        port_effects=(
            effects.coulomb_friction("resistance", velocity="velocity", size=5.0, slow=slow),
            effects.asymmetric_friction("resistance", velocity="velocity", size=1.0, slow=slow),
            effects.stribeck_friction("resistance", velocity="velocity", size=2.0, speed=0.01, slow=slow),
            effects.offset("resistance", size=1.0),
        ),
    )
