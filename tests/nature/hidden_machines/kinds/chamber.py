"""A thermal chamber whose air is heated and cooled; temperatures are above that of the room."""

from tests.nature.hidden_machines import forces, signals
from tests.nature.hidden_machines.machine import Input, Machine, Number, Push, Sensor, Start, Values


def rates(x: Values, u: Values, p: Values, push: Push) -> Values:
    """Balance the heat of air and wall."""
    passed = p["transfer"] * (x["air"] - x["wall"])
    return {
        "air": push("air_heat", p["heating"] * u["duty"] - passed) / p["air_capacity"],
        "wall": push("wall_heat", passed - p["loss"] * x["wall"]) / p["wall_capacity"],
    }


def outputs(x: Values, u: Values, p: Values) -> Values:
    """Read probe and wall sensor."""
    return {"probe": x["air"], "wall_sensor": x["wall"]}


MACHINE = Machine(
    name="chamber",
    step_s=20.0,
    samples=160,
    substeps=16,
    states={"air": "K", "wall": "K"},
    inputs=(Input("duty", "1", -1.0, 1.0),),
    numbers=(
        Number("heating", "kW", 8.0, 0.04),
        Number("transfer", "kW/K", 0.5, 0.05),
        Number("loss", "kW/K", 0.15, 0.08),
        Number("air_capacity", "kJ/K", 20.0, 0.05),
        Number("wall_capacity", "kJ/K", 150.0, 0.05),
    ),
    sensors=(Sensor("probe", "K", 0.12, 0.05), Sensor("wall_sensor", "K", 0.1)),
    starts=(Start("air", 8.0, "probe"), Start("wall", 8.0, "wall_sensor")),
    ports={"air_heat": ("kW", 0.3), "wall_heat": ("kW", 0.3)},
    rates=rates,
    outputs=outputs,
    derivative="""
    passed = p.transfer * (x.air - x.wall)
    air = port("air_heat", p.heating * u.duty - passed)
    wall = port("wall_heat", passed - p.loss * x.wall)
    return {"air": air / p.air_capacity, "wall": wall / p.wall_capacity}
""",
    output='{"probe": x.air, "wall_sensor": x.wall}',
    catalogue=(
        signals.delay("input", "duty", 20.0, 150.0),
        signals.lag("input", "duty", 20.0, 150.0),
        signals.dead_zone("duty", 0.04),
        signals.offset("port", "wall_heat", 0.08),
        signals.saturation("input", "duty", 1.0),
        signals.sag("duty", 0.08),
        signals.wrong("loss", 0.05),
        forces.cubic("wall_heat", "wall", 0.00002),
    ),
    outside=(
        forces.term("wall_heat", "seal", lambda x: x["wall"] ** 2, 0.001, (("wall",), "square")),
        forces.term(
            "air_heat",
            "hot_heater",
            lambda x: x["duty"] * x["air"],
            0.02,
            (("air", "duty"), "product"),
        ),
        forces.drift("air_heat", 0.2, 3200.0),
    ),
    pairs=(("duty_lag", "duty_dead_zone"), ("duty_lag", "duty_saturation")),
)
