"""Effects that may be missing in the single wheel: one card each."""

import math

from sim_backends.models.interface import EffectCard, Values, parameter

GRIP_M = 0.002
"""Height of lugs that hold most of the soil between them."""


def rim_friction_deg(values: Values, rim_deg: float, soil_deg: float) -> float:
    """Return the friction angle of a rim by `lugs`, which hold soil between them: soil shears on soil."""
    grip = 1.0 - math.exp(-values["height"] / GRIP_M)
    return rim_deg + grip * max(soil_deg - rim_deg, 0.0)


EFFECTS = (
    EffectCard(
        name="lugs",
        sentence="Lugs shear the soil outside the rim, soil on soil.",
        place="shearing radius and friction of the rim (paper 002, eq 8)",
        parameters=(parameter("height", "m", 0.0, 0.003, 0.0, 0.02, "shearing radius less rim radius"),),
        claims=("drawbar grows at every positive slip", "none on a smooth rim"),
        experiment="the same wheel with and without lugs",
        source="Longitudinal Slip versus Skid of Planetary Rovers' Wheels, eq 8",
    ),
    EffectCard(
        name="slip_sinkage",
        sentence="A slipping wheel digs soil out from under itself and sinks deeper without bearing more.",
        place="sinkage",
        parameters=(parameter("depth_per_slip", "m", 0.0, 0.005, 0.0, 0.1, "sinkage per slip ratio"),),
        claims=("grows with slip", "none in skid"),
        experiment="one load, rising slip, straight ahead",
        source="Reece 1965, slip sinkage in proportion to slip",
    ),
    EffectCard(
        name="friction_angle",
        sentence="Soil rubs harder or less on the rim than assumed.",
        place="shear strength at the rim",
        parameters=(parameter("change", "deg", 0.0, 5.0, -12.0, 20.0, "added to the friction of the rim"),),
        claims=("drawbar and side force change in proportion to what shears",),
        experiment="a plate with the rim's surface, sheared",
        source="paper 001, eq 19",
        releases="rim_friction_deg",
    ),
    EffectCard(
        name="shear_modulus",
        sentence="Shear stress builds up over another displacement.",
        place="shear stress",
        parameters=(parameter("change", "m", 0.0, 0.01, -0.024, 0.06, "added to the shear modulus"),),
        claims=("drawbar at small slip, not at large",),
        experiment="small slips, straight ahead",
        source="paper 001, eq 19",
        releases="shear_modulus_m",
    ),
    EffectCard(
        name="sinkage_modulus",
        sentence="The soil in the bed bears another pressure than under the plates.",
        place="pressure of a plate",
        parameters=(parameter("change", "Pa/m^n", 0.0, 2e6, -6e6, 4e7, "added to k"),),
        claims=("sinkage changes, most where the wheel rolls",),
        experiment="plates in the prepared bed before each run",
        source="paper 001, eq 17",
        releases="plate_modulus_pa",
    ),
    EffectCard(
        name="pushed_soil",
        sentence="Soil piles up ahead of a wheel that is dragged or slides, and resists it.",
        place="pressure where the rim pushes the soil ahead",
        parameters=(parameter("change", "1", 0.0, 10.0, -8.0, 100.0, "added to the push number"),),
        claims=("drawbar falls in skid, most for the locked wheel", "none where the wheel slips freely"),
        experiment="a locked wheel dragged at two depths",
        source="Broms 1964: a narrow wall pushed through sand meets a multiple of the passive pressure",
        releases="push_number",
    ),
    EffectCard(
        name="sidewall",
        sentence="The side wall meets another pressure than a narrow wall in level sand.",
        place="pressure on the leading side wall",
        parameters=(parameter("change", "1", 0.0, 5.0, -8.0, 50.0, "added to the wall number"),),
        claims=("side force grows with depth and slip angle", "none straight ahead"),
        experiment="the wheel dragged sideways without turning, at two depths",
        source="Broms 1964",
        releases="wall_number",
    ),
    EffectCard(
        name="trench_flow",
        sentence="Loose soil flows in the trench along with the wheel, so that the rim slides "
        "past it slower.",
        place="sideways speed of the wheel over the soil",
        parameters=(
            parameter("share", "1", 0.0, 0.2, 0.0, 0.9, "sideways speed of the soil over the wheel's"),
        ),
        claims=("grows with the slip angle", "the same to both sides"),
        experiment="coloured sand in the trench, 90 deg",
        source="paper 001, IV.C: soil beneath the wheel moves; kinematics",
    ),
    EffectCard(
        name="rig_yaw",
        sentence="The wheel is mounted at another slip angle than was set.",
        place="slip angle",
        parameters=(parameter("offset", "deg", 0.0, 1.0, -10.0, 10.0, "true less set slip angle"),),
        claims=("side force straight ahead", "changes sign with the slip angle's"),
        experiment="slip angles to both sides",
        source="geometry",
    ),
)
