"""A ladder of two resistors and two capacitors."""

import numpy as np

from tests.nature.hidden_machines import forces, signals
from tests.nature.hidden_machines.machine import Input, Machine, Number, Push, Sensor, Start, Values


def rates(x: Values, u: Values, p: Values, push: Push) -> Values:
    """Charge both capacitors; currents in mA."""
    middle = (x["first"] - x["second"]) / p["second_resistor"]
    current = push("node", (u["source"] - x["first"]) / p["first_resistor"] - middle)
    return {"first": current / p["first_capacitor"], "second": middle / p["second_capacitor"]}


def outputs(x: Values, u: Values, p: Values) -> Values:
    """Read both voltmeters."""
    return {"probe": x["first"], "meter": x["second"]}


MACHINE = Machine(
    name="ladder",
    step_s=0.02,
    samples=180,
    substeps=12,
    states={"first": "V", "second": "V"},
    inputs=(Input("source", "V", -5.0, 5.0),),
    numbers=(
        Number("first_resistor", "kohm", 10.0, 0.02),
        Number("second_resistor", "kohm", 15.0, 0.02),
        Number("first_capacitor", "mF", 0.01, 0.05),
        Number("second_capacitor", "mF", 0.02, 0.05),
    ),
    sensors=(Sensor("probe", "V", 0.015, 0.01), Sensor("meter", "V", 0.008)),
    starts=(Start("first", 1.0, "probe"), Start("second", 1.0, "meter")),
    ports={"node": ("mA", 0.01)},
    rates=rates,
    outputs=outputs,
    derivative="""
    middle = (x.first - x.second) / p.second_resistor
    current = port("node", (u.source - x.first) / p.first_resistor - middle)
    return {"first": current / p.first_capacitor, "second": middle / p.second_capacitor}
""",
    output='{"probe": x.first, "meter": x.second}',
    catalogue=(
        signals.offset("input", "source", 0.05),
        signals.dead_zone("source", 0.06),
        signals.saturation("input", "source", 5.0),
        signals.sag("source", 0.01),
        signals.lag("input", "source", 0.02, 0.2),
        signals.delay("input", "source", 0.015, 0.15),
        forces.cubic("node", "first", 0.0005),
        signals.wrong("second_resistor", 3.0),
    ),
    outside=(
        forces.term(
            "node", "diode", lambda x: np.maximum(x["first"] - 1.2, 0.0), 0.01, (("first",), "threshold")
        ),
        forces.term("node", "transistor", lambda x: x["first"] ** 2, 0.002, (("first",), "square")),
        forces.term(
            "node",
            "root_leak",
            lambda x: np.sign(x["first"]) * np.sqrt(np.abs(x["first"])),
            0.01,
            (("first",), "root"),
        ),
    ),
    pairs=(
        ("source_offset", "source_dead_zone"),
        ("source_offset", "source_saturation"),
        ("source_lag", "source_saturation"),
    ),
)
