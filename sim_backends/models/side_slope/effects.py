"""Effects that may be missing in the side-slope rover: one card each."""

import math

from sim_backends.models.interface import EffectCard, Values, parameter
from sim_backends.models.side_slope.states import Build, Site, State

REFERENCE_MASS_KG = 23.8
USUAL_SLIP = 0.1
PAPER = "Slope Traversability Analysis of Reconfigurable Planetary Rovers"


BODY_SHARE = parameter(
    "body_share", "1", 1.0, 0.5, 0.0, 1.0, "share of the turn that the body makes; the rest is sideways creep"
)


def flow_of_soil(values: Values, site: Site) -> tuple[float, float]:
    """Return the speed of the soil downhill and backward over r omega by `slope_failure`."""
    above = math.radians(max(site.slope_deg - values["onset"], 0.0))
    down = values["gain"] * above * (site.mass_kg / REFERENCE_MASS_KG) ** values["load_exponent"]
    return down, values["backward_share"] * down


def cog_shift_m(values: Values) -> tuple[float, float]:
    """Return the shift of the centre of gravity uphill and up by `cog_offset`."""
    direction = math.radians(values["direction"])
    return values["offset"] * math.cos(direction), values["offset"] * math.sin(direction)


def drift_rate_deg_m(values: Values, site: Site) -> float:
    """Return the turn of the rover uphill per metre by `heading_drift`."""
    steep = math.sin(math.radians(site.slope_deg)) / math.sin(math.radians(20.0))
    load = (site.mass_kg / REFERENCE_MASS_KG) ** values["load_exponent"]
    return float(values["rate"] * steep ** values["slope_exponent"] * load)


def dug_in(state: State, build: Build, values: Values) -> State:
    """Return a state with the sinkage that `slip_sinkage` adds beyond its part in the contact."""
    slip = max(1.0 - state.forward * build.radius_m / (build.radius_m + build.shearing_m), 0.0)
    deeper_m = values["depth_per_slip"] * USUAL_SLIP * (slip / USUAL_SLIP) ** values["exponent"]
    more_m = deeper_m - build.slip_sinkage_m * slip
    return state._replace(
        sinkage_up_m=state.sinkage_up_m + more_m, sinkage_down_m=state.sinkage_down_m + more_m
    )


EFFECTS = (
    EffectCard(
        name="slope_failure",
        sentence="Above a slope the loaded soil under the wheels fails and flows downhill, and backward as "
        "the wheels shear it, and carries the rover with it, at any roll.",
        place="speed of the soil under the wheels",
        parameters=(
            parameter(
                "gain", "1/rad", 0.0, 0.15, 0.0, 3.0, "downhill speed over rim speed, per slope above onset"
            ),
            parameter("onset", "deg", 10.0, 4.0, 0.0, 25.0, "slope at which the soil begins to flow"),
            parameter(
                "backward_share", "1", 0.25, 0.25, 0.0, 2.0, "backward over downhill speed of the soil"
            ),
            parameter("load_exponent", "1", 0.5, 0.5, 0.0, 3.0, f"power of mass over {REFERENCE_MASS_KG} kg"),
        ),
        shape_grid={
            "onset": (0.0, 5.0, 10.0, 15.0),
            "backward_share": (0.0, 0.5),
            "load_exponent": (0.0, 1.0),
        },
        claims=(
            "downhill, also when the traverse is mirrored",
            "does not vanish where the roll equals the slope",
            "zero below the onset, then grows with the slope",
            "forces, sinkages and torques stay: only the soil moves",
        ),
        experiment="roll equal to slope on two slopes, and one traverse mirrored",
        source=f"{PAPER}, IV.C and figure 13: soil beneath the wheel moves downhill; the law is kinematics",
    ),
    EffectCard(
        name="friction_angle",
        sentence="The soil's angle of internal friction is not the one of the tables.",
        place="shear strength (paper 001, eq 19)",
        parameters=(parameter("change", "deg", 0.0, 3.0, -10.0, 10.0, "added to phi"),),
        claims=("slip angle stays zero where the roll equals the slope", "slip and slip angle grow together"),
        experiment="shear box, or drawbar at high slip",
        source=f"{PAPER}, eq 19 and Table III",
        releases="friction_angle_deg",
    ),
    EffectCard(
        name="shear_modulus",
        sentence="Shear stress builds up over another displacement than that of the tables.",
        place="shear stress (paper 001, eq 19)",
        parameters=(parameter("change", "m", 0.0, 0.006, -0.018, 0.04, "added to k"),),
        claims=("slip angle stays zero where the roll equals the slope", "scales slips, hardly sinkages"),
        experiment="drawbar over slip at small slips",
        source=f"{PAPER}, eq 19 and Table III",
        releases="shear_modulus_m",
    ),
    EffectCard(
        name="sinkage_modulus",
        sentence="The soil bears another pressure at a given depth than that of the tables.",
        place="normal stress (paper 001, eq 17)",
        parameters=(parameter("change", "1", 0.0, 25.0, -80.0, 240.0, "added to k_phi"),),
        claims=("all sinkages change by nearly one factor", "slip angle stays zero where roll equals slope"),
        experiment="plates, or ruts of the wheels at rest",
        source=f"{PAPER}, eq 17 and Table III",
        releases="sinkage_modulus",
    ),
    EffectCard(
        name="cog_offset",
        sentence="The centre of gravity is beside or above its assumed place, which shifts load between the "
        "uphill and the downhill wheels.",
        place="load transfer (paper 001, eqs 3 and 4)",
        parameters=(
            parameter("offset", "m", 0.0, 0.015, -0.12, 0.12, "distance"),
            parameter("direction", "deg", 0.0, 20.0, -90.0, 90.0, "0 uphill, 90 up"),
        ),
        shape_grid={"direction": (0.0, 90.0)},
        claims=(
            "sinkages and torques of the two sides change in opposite senses",
            "to the side: also on the flat, and fixed to the rover when the traverse is mirrored",
            "in height: grows with the slope",
        ),
        experiment="static loads of the wheels on level ground and on a slope",
        source=f"{PAPER}, eqs 3 and 4, Table I",
    ),
    EffectCard(
        name="heading_drift",
        sentence="The rover slowly turns, or creeps sideways faster and faster, while it travels, the more "
        "the steeper the slope or the greater its load, as the side forces of front and rear wheels "
        "do not balance.",
        place="yaw of the rover along the path",
        parameters=(
            parameter(
                "rate", "deg/m", 0.0, 2.0, -20.0, 20.0, "turn uphill per distance on 20 deg with 23.8 kg"
            ),
            parameter("slope_exponent", "1", 1.0, 0.5, 0.0, 3.0, "power of the sine of the slope"),
            parameter("load_exponent", "1", 0.0, 1.0, 0.0, 4.0, f"power of mass over {REFERENCE_MASS_KG} kg"),
            BODY_SHARE,
        ),
        shape_grid={"slope_exponent": (0.0, 1.0), "load_exponent": (0.0, 2.0), "body_share": (0.0, 1.0)},
        claims=(
            "the path bends",
            "grows along the path from zero",
            "slip and torque fall where the body turns downhill, as its weight pulls along",
        ),
        experiment="a longer traverse with a gyro or two markers",
        source=f"{PAPER}, IV.C: the heading drifted slightly downhill with the greater mass",
    ),
    EffectCard(
        name="heading_offset",
        sentence="The rover was set down with its heading off the traverse, so that its weight also pulls "
        "along it.",
        place="heading of the rover on the slope",
        parameters=(
            parameter("offset", "deg", 0.0, 1.5, -15.0, 15.0, "heading uphill of the traverse"),
            BODY_SHARE,
        ),
        shape_grid={"body_share": (0.0, 1.0)},
        claims=(
            "slip angle off by nearly a constant, the path straight",
            "slip changes with the slope: the weight pulls along",
            "turns from downhill to uphill when the traverse is mirrored",
        ),
        experiment="a mirrored traverse, and one on the flat",
        source="geometry; the paper's outlook requires the yaw angle",
        releases="heading_deg",
    ),
    EffectCard(
        name="camera_yaw",
        sentence="The frame of the motion capture is turned against the slope, so that every path appears "
        "turned.",
        place="measured path",
        parameters=(
            parameter("offset", "deg", 0.0, 1.5, -15.0, 15.0, "turn of the measured path, uphill"),
            parameter(
                "slip_share", "1", 1.0, 0.5, 0.0, 1.0, "share that also enters the speed along the traverse"
            ),
        ),
        shape_grid={"slip_share": (0.0, 1.0)},
        claims=(
            "slip angle off by one constant under all conditions, also on the flat",
            "sinkages and torques stay as they are",
            "the same sense on the picture when the traverse is mirrored",
        ),
        experiment="a traverse on the flat, or the camera turned by 180 deg",
        source="geometry",
        releases="camera_yaw_deg",
    ),
    EffectCard(
        name="grouser_radius",
        sentence="Grousers shear the soil outside the rim, at a greater radius than that of the wheel.",
        place="slip velocity and shear displacement (paper 002, eq 8)",
        parameters=(parameter("excess", "m", 0.0, 0.002, 0.0, 0.02, "shearing radius less wheel radius"),),
        claims=("slip falls by nearly one constant", "hardly any slip angle", "none on hard ground"),
        experiment="free rolling on a hard floor against free rolling in the sand",
        source="Longitudinal Slip versus Skid of Planetary Rovers' Wheels, eq 8",
    ),
    EffectCard(
        name="slip_sinkage",
        sentence="A slipping wheel digs soil out from under itself and sinks deeper without bearing more.",
        place="sinkage",
        parameters=(
            parameter("depth_per_slip", "m", 0.0, 0.015, 0.0, 0.2, "sinkage per slip ratio, at slip 0.1"),
            parameter("exponent", "1", 1.0, 0.4, 0.3, 3.0, "power of the slip"),
            parameter(
                "contact_share", "1", 0.5, 0.5, 0.0, 1.0, "share that also lengthens the contact in front"
            ),
        ),
        shape_grid={"exponent": (1.0,), "contact_share": (0.0, 1.0)},
        claims=("grows with slip", "none where the slip is zero"),
        experiment="drawbar at rising slip with the sinkage watched",
        source="Reece 1965, slip sinkage in proportion to slip",
    ),
    EffectCard(
        name="wheel_radius",
        sentence="The wheels have another radius than the encoder speeds were turned into rim speeds with.",
        place="rim speed and contact",
        parameters=(parameter("change", "m", 0.0, 0.002, -0.015, 0.015, "added to the radius"),),
        claims=("slip is off by nearly one constant", "also on a hard floor", "hardly any slip angle"),
        experiment="free rolling on a hard floor over a measured distance",
        source="geometry",
        releases="wheel_radius_m",
    ),
    EffectCard(
        name="sidewall",
        sentence="Soil rubs on the side walls of the wheels, so that the soil pushed aside "
        "holds them harder.",
        place="side walls (paper 001, eqs 26 to 32)",
        parameters=(
            parameter("wall_friction", "deg", 0.0, 8.0, 0.0, 25.0, "between soil and side wall, delta"),
        ),
        claims=("grows with the slip angle", "none where the slip angle is zero"),
        experiment="wheels with smooth and with rough discs on their sides",
        source=f"{PAPER}, eqs 26 to 32; Table III sets delta to 0",
    ),
)
