"""Effects that may be missing in the odometry of a Robotino under an overhead camera: one card each."""

import numpy as np

from sim_backends.models.drive_effects import GYRO_SCALE, encoder_dropouts, gyro_bias
from sim_backends.models.interface import Array, EffectCard, Values, parameter

MOST_SLIP = 0.98
PAPER = "Slippage compensation of a Robotino (paper 003)"


def radius_error(values: Values, wheel: int) -> float:
    """Return the relative error of the radius of one wheel by `uneven_wheel`."""
    return values["error"] if round(values["wheel"]) == wheel else 0.0


def wheel_slip(values: Values, current_a: Array, idle_current_a: float, surface: float) -> Array:
    """Return the slip of a wheel by `wheel_slip`."""
    gain = values["gain"] if round(values["surface"]) in (0, round(surface)) else 0.0
    return np.minimum(gain * np.maximum(current_a - idle_current_a, 0.0), MOST_SLIP)


EFFECTS = (
    EffectCard(
        name="wheel_radius",
        sentence="The wheels are larger or smaller than assumed, and so are every distance and turn.",
        place="kinematics: distance per turn of the wheels",
        parameters=(parameter("error", "1", 0.0, 0.05, -0.25, 0.25, "true over nominal radius, less one"),),
        claims=("the same share in all directions and at all speeds", "turns change by the same share"),
        experiment="pure rotation: the camera's scale does not touch it",
        source="wear and tolerance of the rollers",
        releases="radius_error",
    ),
    EffectCard(
        name="base_radius",
        sentence="The wheels are nearer to or farther from the centre than assumed.",
        place="kinematics: turn per distance of the wheels",
        parameters=(
            parameter("error", "1", 0.0, 0.05, -0.4, 0.4, "true over nominal radius of the base, less one"),
        ),
        claims=("turns change by its inverse", "straight drives do not change"),
        experiment="pure rotation and straight drives",
        source="contact of two rows of rollers",
        releases="base_error",
    ),
    EffectCard(
        name="camera_scale",
        sentence="The camera's millimetres per pixel, or the size of its marker, are not what "
        "was calibrated.",
        place="position from the camera",
        parameters=(
            parameter("error", "1", 0.0, 0.05, -0.4, 0.4, "true over nominal mm per pixel, less one"),
        ),
        claims=(
            "the same share in all directions and at all speeds",
            "turns do not change",
            "independent of current",
        ),
        experiment="two marks a known distance apart under the camera",
        source="height of the marker above the calibrated plane",
        releases="scale_error",
    ),
    EffectCard(
        name="marker_yaw",
        sentence="The marker is glued to the rover turned by some angle.",
        place="heading from the camera",
        parameters=(
            parameter("angle", "rad", 0.0, 0.05, -0.8, 0.8, "of the marker's x axis, left of the rover's"),
        ),
        claims=("turns every measured motion by one angle", "its length stays"),
        experiment="a ruler along the rover's side",
        source="mounting",
        releases="marker_yaw_rad",
    ),
    EffectCard(
        name="uneven_wheel",
        sentence="One wheel is larger or smaller than the other two.",
        place="kinematics: distance per turn of one wheel",
        parameters=(
            parameter("error", "1", 0.0, 0.02, -0.4, 0.4, "its radius over that of the others, less one"),
            parameter("wheel", "1", 1.0, 0.01, 1.0, 3.0, "which one"),
        ),
        shape_grid={"wheel": (1.0, 2.0, 3.0)},
        claims=("turns a straight drive, by direction", "the same share at every speed"),
        experiment="drive straight in the direction that the wheel pulls most",
        source="wear",
    ),
    encoder_dropouts(
        3,
        "which one",
        parameter("onset", "rad/s", 2.0, 1.0, 0.0, 20.0, "wheel speed above which they are lost"),
        (0.0, 2.0, 4.0, 6.0),
    ),
    EffectCard(
        name="latency",
        sentence="The camera's pose is older than its time in the log.",
        place="clock of the camera",
        parameters=(parameter("time", "s", 0.0, 0.05, -0.02, 0.5, "added to the known age"),),
        claims=("shows only where the speed changes", "changes its sign with the acceleration"),
        experiment="steps of the speed",
        source="exposure, transfer and search for the marker",
        releases="camera_age_s",
    ),
    EffectCard(
        name="wheel_slip",
        sentence="A wheel slips on the ground in proportion to its pull, which its current "
        "above idle measures.",
        place="contact of wheel and ground",
        parameters=(
            parameter("gain", "1/A", 0.0, 0.2, 0.0, 5.0, "slip per current above that of an idle wheel"),
            parameter("surface", "1", 0.0, 0.01, 0.0, 20.0, "which surface; 0 for all"),
        ),
        shape_grid={"surface": (0.0, 1.0, 2.0, 3.0, 4.0)},
        claims=(
            "grows with the current",
            "a wheel that pulls nothing rolls",
            "wheels turn more than the rover moves",
        ),
        experiment="the same drive with a load on the rover",
        source=f"{PAPER}: effective over actual speed falls linearly with current, no-load current apart",
    ),
    EffectCard(
        name="turn_scrub",
        sentence="Rollers scrub when the rover turns, and eat a share of the turn.",
        place="contact of wheel and ground",
        parameters=(parameter("share", "1", 0.0, 0.05, 0.0, 0.7, "of the turn that is lost"),),
        claims=("turns fall short in both directions", "straight drives do not change"),
        experiment="full turns on the spot on two surfaces",
        source="width of the contact patch",
    ),
    gyro_bias("rad/s", 0.01, 0.5),
    GYRO_SCALE,
)
