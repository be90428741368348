"""A tank with an outlet and an overflow; the port is the net inflow."""

import numpy as np

from rover_hil.gap import Channel, Parameter, Port, RunParameter, StateModel, effects


def derivative(x, u, p, port):
    """Rate of each state, per second."""
    outflow = p.outlet * np.sqrt(np.maximum(x.level, 0.0))
    return {"level": port("net_inflow", u.pump - outflow) / p.area}


def start(p, u):
    """States at the first sample of a run."""
    return {"level": p.fill + p.fill_error}


def output(x, u, p, port):
    """Value of each channel."""
    return {"gauge": x.level}


def make():
    """Make the model."""
    return StateModel(
        name="tank",
        states={"level": "m"},
        inputs={"pump": "L/s"},
        condition_units={"fill": "m"},
        derivative=derivative,
        start=start,
        output=output,
        channels=(Channel(name="gauge", unit="m", sigma=0.0005, quantum=0.001),),
        parameters=(
            Parameter(name="outlet", unit="L/s/m^0.5", nominal=0.5, prior_sd=0.05, lower=0.1, upper=2.0),
            Parameter(name="area", unit="L/m", nominal=20.0, prior_sd=0.2, lower=5.0, upper=80.0),
        ),
        run_parameters=(RunParameter(name="fill_error", unit="m", prior_sd=0.005),),
        ports=(Port(name="net_inflow", unit="L/s", force_sd=0.02),),
        port_effects=(
            effects.overflow("net_inflow", level="level", limits=(0.3, 0.4, 0.5), weir=10.0),
            effects.lag("pump", size=2.0, longest=30.0),
            effects.dead_zone("pump", size=0.02),
            effects.saturation("pump", limits=(0.3, 0.4)),
            effects.offset("net_inflow", size=0.02, name="leak"),
            effects.gain_error("gauge", size=0.02),
            effects.offset("gauge", size=0.005, name="gauge_offset"),
            effects.quantisation("pump", step=0.05),
        ),
    )
