"""Small models for tests of the gap workflow: a cart on a slope, and a motor axis."""

from collections.abc import Mapping, Sequence

import numpy as np

from sim_backends.models.interface import Array, Channel, EffectCard, Model, Parameter, Run, Values, parameter

G = 9.81


def card(
    name: str,
    place: str,
    *parameters: Parameter,
    grid: Mapping[str, tuple[float, ...]] | None = None,
    releases: str | None = None,
) -> EffectCard:
    return EffectCard(
        name=name,
        sentence=f"{name.replace('_', ' ')} is not what the model says",
        place=place,
        parameters=parameters,
        claims=(),
        experiment=f"a run that shows {name.replace('_', ' ')} alone",
        source="reasoning",
        shape_grid=grid or {},
        releases=releases,
    )


def delta(name: str, base: str, unit: str, size: float, reach: float) -> EffectCard:
    """A base parameter set free beyond its prior."""
    return card(name, "soil", parameter(f"{name}_change", unit, 0.0, size, -reach, reach), releases=base)


class Cart:
    """A cart on a slope: closed formulas, ten thousand runs a second."""

    name = "cart"
    channels = (
        Channel(name="slip", unit="1"),
        Channel(name="slip_angle_deg", unit="deg"),
        Channel(name="sinkage_up_mm", unit="mm"),
        Channel(name="sinkage_down_mm", unit="mm"),
        Channel(name="torque_up_nm", unit="N m"),
        Channel(name="torque_down_nm", unit="N m"),
    )
    condition_units: Mapping[str, str] = {"slope_deg": "deg", "roll_deg": "deg", "mass_kg": "kg"}
    parameters = (
        parameter("friction_deg", "deg", 38.0, 1.0, 30.0, 46.0),
        parameter("shear_mm", "mm", 36.0, 2.0, 15.0, 60.0),
        parameter("softness_mm_per_n", "mm/N", 0.35, 0.02, 0.1, 0.8),
        parameter("height_mm", "mm", 280.0, 5.0, 200.0, 400.0),
        parameter("rolling", "1", 0.12, 0.01, 0.05, 0.3),
    )
    effects = (
        card(
            "slope_failure",
            "soil velocity",
            parameter("gain_deg_per_deg", "deg/deg", 0.0, 0.3, 0.0, 3.0),
            parameter("onset_deg", "deg", 12.0, 6.0, 0.0, 30.0),
            grid={"onset_deg": (6.0, 10.0, 14.0, 17.0)},
        ),
        delta("friction_angle", "friction_deg", "deg", 3.0, 8.0),
        delta("shear_modulus", "shear_mm", "mm", 8.0, 20.0),
        delta("sinkage_modulus", "softness_mm_per_n", "mm/N", 0.08, 0.24),
        card("cog_offset", "load transfer", parameter("lateral_mm", "mm", 0.0, 20.0, -100.0, 100.0)),
        card("heading_offset", "heading", parameter("heading_deg", "deg", 0.0, 2.0, -10.0, 10.0)),
        card("camera_yaw", "camera", parameter("yaw_deg", "deg", 0.0, 1.0, -10.0, 10.0)),
        card("slip_sinkage", "sinkage", parameter("mm_per_slip", "mm", 0.0, 20.0, 0.0, 200.0)),
        card("wheel_radius", "encoder", parameter("radius_percent", "%", 0.0, 2.0, -10.0, 10.0)),
    )

    def predict(
        self, runs: Sequence[Run], parameters: Values, effects: Mapping[str, Values]
    ) -> list[dict[str, Array]]:
        base = {item.name: item.nominal for item in self.parameters} | dict(parameters)

        def of(effect: str, name: str) -> float:
            if effect not in effects:
                return 0.0
            return effects[effect].get(name, 0.0)

        friction = np.tan(np.radians(base["friction_deg"] + of("friction_angle", "friction_angle_change")))
        shear = base["shear_mm"] + of("shear_modulus", "shear_modulus_change")
        soft = base["softness_mm_per_n"] + of("sinkage_modulus", "sinkage_modulus_change")
        columns = [[run.conditions[key] for run in runs] for key in self.condition_units]
        slope, roll, mass = (np.array(column, dtype=np.float64) for column in columns)
        heading = np.radians(of("heading_offset", "heading_deg"))
        down = np.tan(np.radians(slope)) * np.cos(heading)
        ahead = np.tan(np.radians(slope)) * np.sin(heading)
        normal = mass * G * np.cos(np.radians(slope))
        arm = base["height_mm"] * np.tan(np.radians(slope - roll)) - of("cog_offset", "lateral_mm")
        upper, lower = (normal * (0.5 - sign * arm / 550.0) / 2.0 for sign in (1.0, -1.0))
        side = down - np.tan(np.radians(roll)) * (1.0 + of("cog_offset", "lateral_mm") / 550.0)
        along = base["rolling"] + ahead
        use = np.minimum(np.hypot(side, along) / friction, 0.97)
        slide = -shear / 60.0 * np.log(1.0 - use)
        slip = slide * along / np.hypot(side, along) * 0.4
        angle = -np.degrees(np.arctan(slide * side / np.hypot(side, along) * 1.2))
        if "slope_failure" in effects:
            onset = effects["slope_failure"].get("onset_deg", 12.0)
            angle = angle - of("slope_failure", "gain_deg_per_deg") * np.maximum(slope - onset, 0.0)
        slip = 1.0 - (1.0 - slip) * (1.0 + of("wheel_radius", "radius_percent") / 100.0)
        grow = of("slip_sinkage", "mm_per_slip") * np.maximum(slip, 0.0)
        table = {
            "slip": slip,
            "slip_angle_deg": angle + of("camera_yaw", "yaw_deg"),
            "sinkage_up_mm": soft * upper + grow,
            "sinkage_down_mm": soft * lower + grow,
            "torque_up_nm": upper * 0.097 * (along + 0.2 * slide),
            "torque_down_nm": lower * 0.097 * (along + 0.2 * slide),
        }
        return [{name: values[i : i + 1] for name, values in table.items()} for i in range(len(runs))]


def make_cart() -> Model:
    return Cart()
