"""Effects that may be missing in the drive of a rover on any set of wheels: one card each."""

from collections.abc import Sequence

from sim_backends.models.drive_effects import GYRO_SCALE, gyro_bias
from sim_backends.models.interface import EffectCard, Parameter, Values, parameter

DIRECTIONS_DEG = (0.0, 45.0, 90.0, 135.0, 180.0, 225.0, 270.0, 315.0)

WHEEL_RADIUS = EffectCard(
    name="wheel_radius",
    sentence="All wheels are larger or smaller than the configuration states.",
    place="kinematics: distance per turn of the wheels",
    parameters=(parameter("error", "1", 0.0, 0.05, -0.5, 0.5, "true over configured radius, less one"),),
    claims=("the same share of every distance, forwards and backwards", "turns change by the same share"),
    experiment="a measured distance on hard ground",
    source="tyres, wear, load",
    releases="radius_error",
)
BASE_RADIUS = EffectCard(
    name="base_radius",
    sentence="The wheels are farther from the origin of the rover, or nearer, than the configuration states.",
    place="kinematics: places of the wheels",
    parameters=(parameter("error", "1", 0.0, 0.05, -0.5, 2.0, "true over configured distances, less one"),),
    claims=("turns change by its inverse in both directions", "straight drives do not change"),
    experiment="full turns on the spot",
    source="width of the tyres; skid steering has a wider effective track",
    releases="base_error",
)
CONTACT_STIFFNESS = EffectCard(
    name="contact_stiffness",
    sentence="The wheels slip more on this ground than on that of the configuration, or less.",
    place="contact of wheels and ground: traction per slip",
    parameters=(
        parameter("change", "1", 0.0, 0.7, -5.0, 3.0, "natural logarithm of true over configured stiffness"),
    ),
    claims=("grows with the force that the wheels transmit", "none where a wheel transmits no force"),
    experiment="the same drive with a load that the rover pulls",
    source="linear slope of traction over slip (Pacejka, Tire and Vehicle Dynamics, 2012, chapter 1)",
    releases="stiffness_change",
)
ROLLING_RESISTANCE = EffectCard(
    name="rolling_resistance",
    sentence="The ground resists rolling more than that of the configuration.",
    place="contact of wheels and ground: force against rolling",
    parameters=(parameter("share", "1", 0.0, 0.05, 0.0, 1.0, "additional resistance per wheel load"),),
    claims=("slows the rover in both directions", "grows with the load of the wheels"),
    experiment="currents of the motors at constant speed, on this ground and on hard ground",
    source="soft ground: work of pressing it down per distance",
)
SIDE_SLOPE = EffectCard(
    name="side_slope",
    sentence="The ground is inclined, and the rover drifts downhill.",
    place="force on the body, in a fixed direction of the ground",
    parameters=(
        parameter("angle_deg", "deg", 0.0, 3.0, 0.0, 40.0, "inclination"),
        parameter("downhill_deg", "deg", 0.0, 90.0, -360.0, 360.0, "direction downhill, from the x axis"),
    ),
    shape_grid={"downhill_deg": DIRECTIONS_DEG},
    claims=("downhill, whatever the heading", "changes its sign with the direction of travel"),
    experiment="the same line in both directions",
    source="weight along the slope, carried by slip of the wheels",
)
LATENCY = EffectCard(
    name="latency",
    sentence="The pose is older or newer than the wheels at the same time in the log.",
    place="clocks of pose and wheels",
    parameters=(parameter("time", "s", 0.0, 0.1, -1.0, 1.0, "age of the pose beyond that of the wheels"),),
    claims=("shows only where the speed changes", "changes its sign with the acceleration"),
    experiment="steps of the speed",
    source="exposure and processing of pictures",
    releases="pose_age_s",
)


STEERING_RATIO = EffectCard(
    name="steering_ratio",
    sentence="All steered wheels turn by more or less than their angles state.",
    place="steering of all wheels: angle per measured angle",
    parameters=(parameter("error", "1", 0.0, 0.05, -0.6, 1.0, "true over measured angle, less one"),),
    claims=("curves change by the same share to both sides", "none where all angles are 0"),
    experiment="circles to both sides with two steering angles",
    source="gear or linkage between encoder and wheel",
)
ROTATION_CENTRE = EffectCard(
    name="rotation_centre",
    sentence="A rover that skids in turns has their centre ahead of that of its wheels, or behind it.",
    place="kinematics: sideways motion of the body per turn",
    parameters=(parameter("ahead_m", "m", 0.0, 0.03, -2.0, 2.0, "place of the centre, forward"),),
    claims=("sideways in proportion to the turn", "none on a straight line"),
    experiment="turns on the spot with the marker at two measured places of the rover",
    source="load on the axles and slip while turning; Mandow et al. 2007",
)


def uneven_wheel(wheels: Sequence[int]) -> EffectCard:
    """Return the card of one wheel of another radius, of these numbers."""
    return EffectCard(
        name="uneven_wheel",
        sentence="One wheel is larger or smaller than the others.",
        place="kinematics: distance per turn of one wheel",
        parameters=(
            parameter("error", "1", 0.0, 0.03, -0.5, 0.5, "its radius over the configured one, less one"),
            _number(wheels),
        ),
        shape_grid={"wheel": tuple(map(float, wheels))},
        claims=("turns a straight drive to the side of the smaller wheel", "the same share at every speed"),
        experiment="a straight drive at two speeds",
        source="wear, air pressure",
    )


def steering_offset(wheels: Sequence[int]) -> EffectCard:
    """Return the card of one wheel that is mounted at another steering angle, of these numbers."""
    return EffectCard(
        name="steering_offset",
        sentence="One wheel points in another direction than its steering angle.",
        place="steering of one wheel",
        parameters=(
            parameter("angle_deg", "deg", 0.0, 3.0, -45.0, 45.0, "true angle at a measured angle of 0"),
            _number(wheels),
        ),
        shape_grid={"wheel": tuple(map(float, wheels))},
        claims=("turns a straight drive, by the same angle per distance in both directions",),
        experiment="a straight drive with all steering set-points at 0",
        source="zero of the steering encoder",
    )


def _number(wheels: Sequence[int]) -> Parameter:
    first, last = float(min(wheels)), float(max(wheels))
    room = 0.0 if last > first else 0.4  # bounds differ, and round to the number
    return parameter(
        "wheel", "1", first, 0.01, first - room, last + room, "number in the configuration, from 1"
    )


def effects_of(driven: Sequence[int], steered: Sequence[int], *, skids: bool) -> tuple[EffectCard, ...]:
    """Return all cards of a rover.

    Args:
        driven: Numbers of its wheels with a motor, from 1.
        steered: Numbers of those that steer.
        skids: Wheels of two axles are fixed, so that a turn drags them sideways.
    """
    return (
        WHEEL_RADIUS,
        BASE_RADIUS,
        *((uneven_wheel(driven),) if len(driven) > 1 else ()),
        CONTACT_STIFFNESS,
        ROLLING_RESISTANCE,
        SIDE_SLOPE,
        LATENCY,
        gyro_bias("rad/s", 0.005, 0.3, "gyro_bias_rad_s"),
        GYRO_SCALE,
        *((steering_offset(steered), STEERING_RATIO) if steered else ()),
        *((ROTATION_CENTRE,) if skids else ()),
    )


def of_wheel(values: Values, wheel: int, name: str) -> float:
    """Return a number of a card that concerns one wheel; 0 for the other wheels, and without the card."""
    return values[name] if values and round(values["wheel"]) == wheel else 0.0
