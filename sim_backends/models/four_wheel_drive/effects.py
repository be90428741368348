"""Effects that may be missing in the odometry of a four-wheel rover with gyro and compass: one card each."""

from sim_backends.models.interface import EffectCard, parameter

WHEEL_RADIUS = EffectCard(
    name="wheel_radius",
    sentence="The wheels are larger or smaller than thought, so that every way is, too.",
    place="kinematics: way per turn of the wheels",
    parameters=(parameter("error", "1", 0.0, 0.05, -0.5, 0.5, "true over nominal radius, less one"),),
    claims=("the same share of every way", "the same uphill and downhill"),
    experiment="a measured way on hard ground",
    source="tyres, grousers, sinkage of the rim",
    releases="radius_error",
)
BASE_RADIUS = EffectCard(
    name="base_radius",
    sentence="The rover turns as if its wheels stood farther apart: they scrub sideways in turns.",
    place="kinematics: turn per difference of the sides",
    parameters=(parameter("error", "1", 0.0, 0.5, -0.5, 20.0, "effective over nominal track, less one"),),
    claims=("turns change by its inverse, both ways", "straight drives do not change"),
    experiment="full turns on the spot",
    source="skid steering: effective track (Mandow et al. 2007)",
    releases="track_error",
)
DROPOUTS = EffectCard(
    name="encoder_dropouts",
    sentence="The counter of one wheel loses ticks.",
    place="encoder of one wheel",
    parameters=(
        parameter("share", "1", 0.0, 0.05, 0.0, 0.9, "ticks lost above the onset"),
        parameter(
            "wheel", "1", 1.0, 0.01, 1.0, 4.0, "which one: front left, front right, rear left, rear right"
        ),
        parameter("onset", "rad/s", 0.0, 0.5, 0.0, 50.0, "wheel speed above which they are lost"),
    ),
    shape_grid={"wheel": (1.0, 2.0, 3.0, 4.0), "onset": (0.0, 1.0)},
    claims=("one wheel", "the wheel seems slower than it is, never faster"),
    experiment="the wheel off the ground beside the others",
    source="interrupts missed by a counter, a broken wire",
)
HARD_IRON = EffectCard(
    name="hard_iron",
    sentence="Magnets of the rover add a field that turns with it: the compass errs once per turn.",
    place="compass",
    parameters=(
        parameter("size", "deg", 0.0, 2.0, -90.0, 90.0, "greatest error"),
        parameter("phase", "deg", 0.0, 45.0, -180.0, 180.0, "heading at which it is greatest"),
    ),
    shape_grid={"phase": (0.0, 45.0, 90.0, 135.0)},
    claims=("one wave per turn of heading", "wheels and gyro do not know of it"),
    experiment="one full turn, slowly",
    source="first harmonic of compass deviation (coefficients B and C)",
)
SOFT_IRON = EffectCard(
    name="soft_iron",
    sentence="Iron of the rover bends the earth's field: the compass errs twice per turn.",
    place="compass",
    parameters=(
        parameter("size", "deg", 0.0, 2.0, -45.0, 45.0, "greatest error"),
        parameter("phase", "deg", 0.0, 22.0, -90.0, 90.0, "heading at which it is greatest"),
    ),
    shape_grid={"phase": (0.0, 22.5, 45.0, 67.5)},
    claims=("two waves per turn of heading", "wheels and gyro do not know of it"),
    experiment="one full turn, slowly",
    source="second harmonic of compass deviation (coefficients D and E)",
)
COMPASS_OFFSET = EffectCard(
    name="compass_offset",
    sentence="The compass is mounted turned, or the declination is wrong.",
    place="compass",
    parameters=(parameter("angle", "deg", 0.0, 3.0, -180.0, 180.0, "added to every heading"),),
    claims=("the same at every heading",),
    experiment="one known heading",
    source="mounting, map of declination (coefficient A)",
    releases="compass_offset_deg",
)
COMPASS_LAG = EffectCard(
    name="compass_lag",
    sentence="The compass follows late: it damps its reading.",
    place="compass",
    parameters=(parameter("time", "s", 0.0, 0.3, 0.0, 5.0, "time constant"),),
    claims=("in proportion to the turning rate", "zero on straight ways"),
    experiment="turns to both sides at some rates",
    source="first-order damping of a fluxgate compass",
)
LATENCY = EffectCard(
    name="latency",
    sentence="The log of the wheels is later than that of the true pose, by a constant time.",
    place="clock of the wheels",
    parameters=(parameter("time", "s", 0.0, 0.1, 0.0, 1.0, "age of the encoders' values"),),
    claims=("shows only where the speed changes", "changes its sign with the acceleration"),
    experiment="steps of the speed",
    source="bus and cycle of the drive",
)
WHEEL_SLIP = EffectCard(
    name="wheel_slip",
    sentence="The wheels slip on level ground by what their own rolling resistance asks of the soil.",
    place="contact of wheels and soil",
    parameters=(parameter("share", "1", 0.0, 0.1, 0.0, 0.95, "slip on the level"),),
    claims=("wheels turn more than the rover moves", "the same on every level way"),
    experiment="the same way on hard ground",
    source="equilibrium of traction and resistance at zero drawbar pull",
)
SLOPE_SLIP = EffectCard(
    name="slope_slip",
    sentence="Uphill the wheels pull the weight's share along the slope, and slip more the steeper it is.",
    place="contact of wheels and soil",
    parameters=(
        parameter("per_slope", "1/rad", 0.0, 0.5, 0.0, 10.0, "slip per slope climbed"),
        parameter("curvature", "1/rad", 0.0, 2.0, 0.0, 20.0, "growth of that slope by slope"),
    ),
    shape_grid={"curvature": (0.0, 4.0)},
    claims=("positive uphill, negative downhill", "zero on the level"),
    experiment="one slope up and down",
    source="slip over slope angle is near linear, then steepens (paper 000, fig. 8)",
)
SIDE_DRIFT = EffectCard(
    name="side_drift",
    sentence="On a side slope the rover drifts downhill while it drives.",
    place="contact of wheels and soil",
    parameters=(parameter("per_roll", "1", 0.0, 0.3, 0.0, 5.0, "slip angle per roll angle, both in rad"),),
    claims=("downhill, whichever side", "zero without roll", "only while driving"),
    experiment="one side slope in both directions",
    source="paper 000, eq 2 and fig. 12: slip angle grows with the side force",
)
GYRO_BIAS = EffectCard(
    name="gyro_bias",
    sentence="The gyro shows a rate at rest.",
    place="gyro",
    parameters=(parameter("rate", "deg/s", 0.0, 0.3, -20.0, 20.0, "shown at rest"),),
    claims=("the same at every rate", "wheels and compass do not know of it"),
    experiment="log at rest",
    source="micromechanical gyro",
    releases="gyro_bias_deg_s",
)
GYRO_SCALE = EffectCard(
    name="gyro_scale",
    sentence="The gyro shows too much or too little of every rate.",
    place="gyro",
    parameters=(parameter("error", "1", 0.0, 0.02, -0.5, 0.5, "shown over true rate, less one"),),
    claims=("in proportion to the rate, both ways",),
    experiment="ten full turns",
    source="data sheets tell 1 to 3 %",
)
EFFECTS = (
    WHEEL_RADIUS,
    BASE_RADIUS,
    DROPOUTS,
    HARD_IRON,
    SOFT_IRON,
    COMPASS_OFFSET,
    COMPASS_LAG,
    LATENCY,
    WHEEL_SLIP,
    SLOPE_SLIP,
    SIDE_DRIFT,
    GYRO_BIAS,
    GYRO_SCALE,
)
