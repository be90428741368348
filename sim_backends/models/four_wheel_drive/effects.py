"""Effects that may be missing in the odometry of a four-wheel rover with gyro and compass: one card each."""

import numpy as np
from scipy.signal import lfilter

from sim_backends.models.drive_effects import GYRO_SCALE, encoder_dropouts, gyro_bias
from sim_backends.models.interface import Array, EffectCard, Values, parameter

MOST_SLIP = 0.98


def hard_iron_deg(values: Values, heading_rad: Array) -> Array:
    """Return the error of the compass by `hard_iron`."""
    error: Array = values["size"] * np.cos(heading_rad - np.radians(values["phase"]))
    return error


def soft_iron_deg(values: Values, heading_rad: Array) -> Array:
    """Return the error of the compass by `soft_iron`."""
    error: Array = values["size"] * np.cos(2.0 * (heading_rad - np.radians(values["phase"])))
    return error


def lagging_heading(values: Values, t_s: Array, heading_rad: Array) -> Array:
    """Return what a compass damped by `compass_lag` shows of a heading."""
    if values["time"] <= 0.0:
        return heading_rad
    keep = float(np.exp(-(t_s[1] - t_s[0]) / values["time"]))
    shown: Array = lfilter([1.0 - keep], [1.0, -keep], heading_rad, zi=keep * heading_rad[:1])[0]
    return shown


def slip_on_soil(level: Values, hill: Values, climb_rad: Array, rim_m_s: Array) -> Array:
    """Return the slip by `wheel_slip` and `slope_slip`."""
    steepening = 1.0 + hill["curvature"] * np.abs(climb_rad)
    slip = level["share"] + hill["per_slope"] * climb_rad * steepening * np.sign(rim_m_s)
    return np.clip(slip, -MOST_SLIP, MOST_SLIP)


def drift_angle(values: Values, roll_rad: Array) -> Array:
    """Return the angle of the motion to the left of the rover by `side_drift`, rad."""
    return np.clip(-values["per_roll"] * roll_rad, -1.5, 1.5)


EFFECTS = (
    EffectCard(
        name="wheel_radius",
        sentence="The wheels are larger or smaller than assumed, and so is every distance.",
        place="kinematics: distance per turn of the wheels",
        parameters=(parameter("error", "1", 0.0, 0.05, -0.5, 0.5, "true over nominal radius, less one"),),
        claims=("the same share of every distance", "the same uphill and downhill"),
        experiment="a measured distance on hard ground",
        source="tyres, grousers, sinkage of the rim",
        releases="radius_error",
    ),
    EffectCard(
        name="base_radius",
        sentence="The rover turns as if its wheels stood farther apart: they scrub sideways in turns.",
        place="kinematics: turn per difference of the sides",
        parameters=(parameter("error", "1", 0.0, 0.5, -0.5, 20.0, "effective over nominal track, less one"),),
        claims=("turns change by its inverse in both directions", "straight drives do not change"),
        experiment="full turns on the spot",
        source="skid steering: effective track (Mandow et al. 2007)",
        releases="track_error",
    ),
    encoder_dropouts(
        4,
        "which one: front left, front right, rear left, rear right",
        parameter("onset", "rad/s", 0.0, 0.5, 0.0, 50.0, "wheel speed above which they are lost"),
        (0.0, 1.0),
    ),
    EffectCard(
        name="hard_iron",
        sentence="Magnets of the rover add a field that turns with it: the compass errs once per turn.",
        place="compass",
        parameters=(
            parameter("size", "deg", 0.0, 2.0, -90.0, 90.0, "greatest error"),
            parameter("phase", "deg", 0.0, 45.0, -180.0, 180.0, "heading at which it is greatest"),
        ),
        shape_grid={"phase": (0.0, 45.0, 90.0, 135.0)},
        claims=("one wave per turn of heading", "wheels and gyro do not show it"),
        experiment="one full turn, slowly",
        source="first harmonic of compass deviation (coefficients B and C)",
    ),
    EffectCard(
        name="soft_iron",
        sentence="Iron of the rover bends the earth's field: the compass errs twice per turn.",
        place="compass",
        parameters=(
            parameter("size", "deg", 0.0, 2.0, -45.0, 45.0, "greatest error"),
            parameter("phase", "deg", 0.0, 22.0, -90.0, 90.0, "heading at which it is greatest"),
        ),
        shape_grid={"phase": (0.0, 22.5, 45.0, 67.5)},
        claims=("two waves per turn of heading", "wheels and gyro do not show it"),
        experiment="one full turn, slowly",
        source="second harmonic of compass deviation (coefficients D and E)",
    ),
    EffectCard(
        name="compass_offset",
        sentence="The compass is mounted turned, or the declination is wrong.",
        place="compass",
        parameters=(parameter("angle", "deg", 0.0, 3.0, -180.0, 180.0, "added to every heading"),),
        claims=("the same at every heading",),
        experiment="one known heading",
        source="mounting, map of declination (coefficient A)",
        releases="compass_offset_deg",
    ),
    EffectCard(
        name="compass_lag",
        sentence="The compass damps its reading and lags behind.",
        place="compass",
        parameters=(parameter("time", "s", 0.0, 0.3, 0.0, 5.0, "time constant"),),
        claims=("in proportion to the turning rate", "zero on straight drives"),
        experiment="turns to both sides at some rates",
        source="first-order damping of a fluxgate compass",
    ),
    EffectCard(
        name="latency",
        sentence="The log of the wheels is later than that of the true pose, by a constant time.",
        place="clock of the wheels",
        parameters=(parameter("time", "s", 0.0, 0.1, 0.0, 1.0, "age of the encoders' values"),),
        claims=("shows only where the speed changes", "changes its sign with the acceleration"),
        experiment="steps of the speed",
        source="bus and cycle of the drive",
    ),
    EffectCard(
        name="wheel_slip",
        sentence="The wheels slip on level ground, as their own rolling resistance requires thrust.",
        place="contact of wheels and soil",
        parameters=(parameter("share", "1", 0.0, 0.1, 0.0, 0.95, "slip on the level"),),
        claims=("wheels turn more than the rover moves", "the same on all level ground"),
        experiment="the same drive on hard ground",
        source="equilibrium of traction and resistance at zero drawbar pull",
    ),
    EffectCard(
        name="slope_slip",
        sentence="Uphill the wheels carry the weight along the slope, and slip more the steeper it is.",
        place="contact of wheels and soil",
        parameters=(
            parameter("per_slope", "1/rad", 0.0, 0.5, 0.0, 10.0, "slip per slope climbed"),
            parameter("curvature", "1/rad", 0.0, 2.0, 0.0, 20.0, "growth of that slope by slope"),
        ),
        shape_grid={"curvature": (0.0, 4.0)},
        claims=("positive uphill, negative downhill", "zero on the level"),
        experiment="one slope up and down",
        source="slip over slope angle is near linear, then steepens (paper 000, fig. 8)",
    ),
    EffectCard(
        name="side_drift",
        sentence="On a side slope the rover drifts downhill while it drives.",
        place="contact of wheels and soil",
        parameters=(
            parameter("per_roll", "1", 0.0, 0.3, 0.0, 5.0, "slip angle per roll angle, both in rad"),
        ),
        claims=("downhill, on either side", "zero without roll", "only while driving"),
        experiment="one side slope in both directions",
        source="paper 000, eq 2 and fig. 12: slip angle grows with the side force",
    ),
    gyro_bias("deg/s", 0.3, 20.0, "gyro_bias_deg_s"),
    GYRO_SCALE,
)
