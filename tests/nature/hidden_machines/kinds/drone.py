"""The altitude of a drone; the input is its thrust above its weight."""

from tests.nature.hidden_machines import forces, signals
from tests.nature.hidden_machines.machine import Input, Machine, Number, Push, Sensor, Start, Values


def rates(x: Values, u: Values, p: Values, push: Push) -> Values:
    """Climb behind the lag of the rotors."""
    return {
        "altitude": x["climb"],
        "climb": push("lift", x["thrust"] - p["air"] * x["climb"]) / p["mass"],
        "thrust": (u["demand"] - x["thrust"]) / p["rotor_lag"],
    }


def outputs(x: Values, u: Values, p: Values) -> Values:
    """Read barometer and climb."""
    return {"barometer": x["altitude"], "climb_meter": x["climb"]}


MACHINE = Machine(
    name="drone",
    step_s=0.1,
    samples=150,
    substeps=12,
    states={"altitude": "m", "climb": "m/s", "thrust": "N"},
    inputs=(Input("demand", "N", -2.0, 2.0),),
    numbers=(
        Number("mass", "kg", 1.5, 0.02),
        Number("air", "N s/m", 0.6, 0.08),
        Number("rotor_lag", "s", 0.15, 0.1),
    ),
    sensors=(Sensor("barometer", "m", 0.08, 0.02), Sensor("climb_meter", "m/s", 0.05)),
    starts=(Start("altitude", 3.0, "barometer"), Start("climb", 0.2), Start("thrust", 0.2)),
    ports={"lift": ("N", 0.1)},
    rates=rates,
    outputs=outputs,
    derivative="""
    lift = port("lift", x.thrust - p.air * x.climb)
    return {"altitude": x.climb, "climb": lift / p.mass, "thrust": (u.demand - x.thrust) / p.rotor_lag}
""",
    output='{"barometer": x.altitude, "climb_meter": x.climb}',
    catalogue=(
        forces.drag("lift", "climb", 0.08),
        signals.offset("port", "lift", 0.06),
        signals.delay("input", "demand", 0.08, 0.8),
        signals.sag("demand", 0.06),
        signals.saturation("input", "demand", 2.0),
        signals.gain("channel", "climb_meter", 0.06),
        signals.offset("channel", "climb_meter", 0.05),
        signals.dead_zone("demand", 0.08),
    ),
    outside=(
        forces.term("lift", "warm_layer", lambda x: x["altitude"], 0.02, (("altitude",), "linear")),
        forces.term("lift", "wake", lambda x: x["climb"] ** 2, 0.05, (("climb",), "square")),
        forces.drift("lift", 0.1, 15.0),
    ),
)
