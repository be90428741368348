"""A pneumatic control valve with a spring."""

from tests.nature.hidden_machines import forces, signals
from tests.nature.hidden_machines.machine import Input, Machine, Number, Push, Sensor, Start, Values


def rates(x: Values, u: Values, p: Values, push: Push) -> Values:
    """Fill the diaphragm and move the stem."""
    force = p["area"] * x["pressure"] - p["spring"] * x["stem"] - p["damping"] * x["speed"]
    return {
        "pressure": (p["bar_per_signal"] * u["signal"] - x["pressure"]) / p["filling"],
        "stem": x["speed"],
        "speed": 1000.0 * push("stem_force", force) / p["mass"],
    }


def outputs(x: Values, u: Values, p: Values) -> Values:
    """Read stem and manometer."""
    return {"lift": x["stem"], "manometer": x["pressure"]}


MACHINE = Machine(
    name="valve",
    step_s=0.05,
    samples=180,
    substeps=80,
    states={"pressure": "bar", "stem": "mm", "speed": "mm/s"},
    inputs=(Input("signal", "mA", -8.0, 8.0),),
    numbers=(
        Number("bar_per_signal", "bar/mA", 0.06, 0.02),
        Number("filling", "s", 0.3, 0.08),
        Number("area", "N/bar", 500.0, 0.03),
        Number("spring", "N/mm", 20.0, 0.03),
        Number("damping", "N s/mm", 1.5, 0.1),
        Number("mass", "kg", 20.0, 0.1),
    ),
    sensors=(Sensor("lift", "mm", 0.08, 0.05), Sensor("manometer", "bar", 0.004)),
    starts=(Start("pressure", 0.05, "manometer"), Start("stem", 1.0, "lift"), Start("speed", 1.0)),
    ports={"stem_force": ("N", 10.0)},
    rates=rates,
    outputs=outputs,
    derivative="""
    force = port("stem_force", p.area * x.pressure - p.spring * x.stem - p.damping * x.speed)
    filling = (p.bar_per_signal * u.signal - x.pressure) / p.filling
    return {"pressure": filling, "stem": x.speed, "speed": 1000.0 * force / p.mass}
""",
    output='{"lift": x.stem, "manometer": x.pressure}',
    catalogue=(
        forces.dry("stem_force", "speed", 8.0, 1.0),
        signals.play("signal", 0.2),
        signals.dead_zone("signal", 0.15),
        signals.delay("input", "signal", 0.06, 0.5),
        forces.cubic("stem_force", "stem", 0.02),
        signals.offset("port", "stem_force", 5.0),
        signals.offset("input", "signal", 0.1),
        signals.wrong("spring", 4.0),
        signals.saturation("input", "signal", 8.0),
    ),
    outside=(
        forces.term("stem_force", "wound_spring", lambda x: x["stem"] ** 2, 0.1, (("stem",), "square")),
        forces.term(
            "stem_force",
            "stream",
            lambda x: x["stem"] * x["pressure"],
            2.0,
            (("pressure", "stem"), "product"),
        ),
        forces.drift("stem_force", 10.0, 9.0),
    ),
    pairs=(("signal_offset", "signal_dead_zone"), ("signal_offset", "signal_saturation")),
)
