"""What can be wrong with the wheels of a rover, and with the marker of its ground truth, as numbers.

All numbers are 0 for the rover as it is described. Radii have a common factor and one factor for each
contrast (left against right, front against rear, ...), because common and opposite errors show in different
motions: those of single wheels would be confounded where several wheels roll alike.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from controllers.motion.kinematics import make_kinematics
from controllers.motion.rover_geometry import (
    OmniRoverSettings,
    RoverSettings,
    SkidSteerRoverSettings,
    WheelsRoverSettings,
    wheels_reach_m,
)
from controllers.motion.wheel_constraints import skids_in_turns
from controllers.motion.wheel_settings import WheelSettings
from controllers.motion.wheel_solution import WheelEquations, WheelSolution
from rover_hil.drives.arrays import Array
from rover_hil.drives.quality.drive_paths import effects_of

RADIUS, BASE, TRACK, WHEELBASE = "radius", "base radius", "track", "wheelbase"
BASES = (BASE, TRACK, WHEELBASE)
"""Numbers that rotations depend on, and distances do not."""
STEERING_ZERO, STEERING_RATIO, STEERING_DELAY = "steering zero", "steering ratio", "delay of the steering"
MARKER_X, MARKER_Y, MARKER_YAW, DELAY = "marker x", "marker y", "marker yaw", "delay of the ground truth"
MARKER = (MARKER_X, MARKER_Y, MARKER_YAW)
RADIUS_OF = "radius, "
"""Followed by the name of a contrast."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Number:
    """A number that may differ from its description.

    Attributes:
        name: What it is.
        unit: "" for a relative difference, else "m", "deg" or "s".
        plausible: It lies within plus and minus this, in SI units; chosen by hand.
        is_geometry: Of the wheels; False for what is only of the measurement: marker and clock.
        is_optional: Left out where it is within a standard deviation of 0.
        shown_by: A drive that would show it.
    """

    name: str
    unit: str
    plausible: float
    shown_by: str
    is_geometry: bool = True
    is_optional: bool = False


@dataclass(frozen=True, slots=True)
class Geometry:
    """The wheels of a rover, with what may be wrong about them.

    Attributes:
        rover: As described.
        wheels: The same as a list of wheels; a rover with four wheels in two rows has none.
        contrasts: Unit vectors over the wheels, by name.
        numbers: In the order of the values that the methods take.
    """

    rover: RoverSettings
    wheels: tuple[WheelSettings, ...]
    contrasts: Mapping[str, Array]
    numbers: tuple[Number, ...]

    def corrected(self, values: Mapping[str, float]) -> RoverSettings:
        """Return the description with numbers that differ; a list of wheels where radii differ.

        Args:
            values: By name of the number; those that are not in it are 0.
        """
        rover, radius = self.rover, 1.0 + values.get(RADIUS, 0.0)
        contrast = sum(
            (values.get(RADIUS_OF + name, 0.0) * each for name, each in self.contrasts.items()),
            start=np.zeros(len(self.wheels)),
        )
        if isinstance(rover, SkidSteerRoverSettings):
            track_m = (1.0 + values.get(TRACK, 0.0)) * rover.track_m
            return rover.model_copy(
                update={"wheel_radius_m": radius * rover.wheel_radius_m, "track_m": track_m}
            )
        if isinstance(rover, OmniRoverSettings) and not contrast.any():
            base_m = (1.0 + values.get(BASE, 0.0)) * rover.base_radius_m
            return rover.model_copy(
                update={"wheel_radius_m": radius * rover.wheel_radius_m, "base_radius_m": base_m}
            )
        base = values.get(BASE, 0.0)
        along, aside = (1.0 + values.get(name, base) for name in (WHEELBASE, TRACK))
        zero_deg = math.degrees(values.get(STEERING_ZERO, 0.0))
        wheels = [
            wheel.model_copy(
                update={
                    "x_m": along * wheel.x_m,
                    "y_m": aside * wheel.y_m,
                    "radius_m": float(radius * (1.0 + contrast[place]) * wheel.radius_m),
                    "angle_deg": wheel.angle_deg + (zero_deg if wheel.steering is not None else 0.0),
                }
            )
            for place, wheel in enumerate(self.wheels)
        ]
        return WheelsRoverSettings.model_construct(kinematics="wheels", wheels=tuple(wheels))

    def effects(self, values: Mapping[str, float], steering_rad: Array | None) -> Array:
        """Return the motion of the body per angle of each wheel, see `effects_of`."""
        rover = self.corrected(values)
        if steering_rad is None or not isinstance(rover, WheelsRoverSettings):
            return effects_of(make_kinematics(rover), steering_rad)
        # The kinematics would also find the least radius of a bend, which takes as long again.
        equations = WheelEquations(rover.wheels)
        angles = ((1.0 + values.get(STEERING_RATIO, 0.0)) * steering_rad).tolist()
        return np.array([WheelSolution(equations, row).effects for row in angles])


def geometry_of(rover: RoverSettings) -> Geometry:
    """Return what may be wrong with a rover."""
    if isinstance(rover, SkidSteerRoverSettings):
        return Geometry(rover, (), {}, (_radius(), _track(skids=True)))
    if isinstance(rover, OmniRoverSettings):
        wheels = _wheels_of(rover)
        contrasts = _contrasts(wheels)
        base = Number(name=BASE, unit="", plausible=0.3, shown_by="rotations on the spot")
        return Geometry(rover, wheels, contrasts, (_radius(), base, *map(_contrast, contrasts)))
    contrasts = _contrasts(rover.wheels)
    skids = skids_in_turns(rover.wheels)
    steers = any(wheel.steering is not None for wheel in rover.wheels)
    numbers = [_radius(), *map(_contrast, contrasts)]
    # Rollers add both distances, so that one factor is common to them.
    has_rollers = any(wheel.roller_deg is not None for wheel in rover.wheels)
    if has_rollers:
        numbers.append(Number(name=BASE, unit="", plausible=0.3, shown_by="rotations on the spot"))
    elif len({wheel.y_m for wheel in rover.wheels if wheel.measured}) > 1:
        numbers.append(_track(skids=skids))
    if steers:
        bends = "bends to both sides at several steering angles"
        numbers += [
            Number(name=WHEELBASE, unit="", plausible=0.3, shown_by=bends),
            Number(name=STEERING_ZERO, unit="deg", plausible=math.radians(15.0), shown_by=bends),
            Number(name=STEERING_RATIO, unit="", plausible=0.1, shown_by=bends, is_optional=True),
        ]
    if sum(wheel.steering is not None for wheel in rover.wheels) == 1:
        numbers.append(_delay(STEERING_DELAY, "bends that begin and end"))
    return Geometry(rover, rover.wheels, contrasts, tuple(numbers))


def marker_numbers(rover: RoverSettings, *, has_yaw: bool) -> tuple[Number, ...]:
    """Return what may be wrong with the measurement of the ground truth.

    Args:
        rover: Carries the marker or the antenna.
        has_yaw: Whether the ground truth has a yaw.
    """
    reach_m = 2.0 * wheels_reach_m(rover)
    bends = "bends to both sides, or rotations on the spot"
    lever = [
        Number(name=name, unit="m", plausible=reach_m, shown_by=bends, is_geometry=False)
        for name in (MARKER_X, MARKER_Y)
    ]
    yaw = Number(name=MARKER_YAW, unit="deg", plausible=math.pi, shown_by="a straight", is_geometry=False)
    return (*lever, *([yaw] if has_yaw else []), _delay(DELAY, "changes of speed"))


def _delay(name: str, shown_by: str) -> Number:
    return Number(name=name, unit="s", plausible=0.5, shown_by=shown_by, is_geometry=False, is_optional=True)


def _radius() -> Number:
    return Number(name=RADIUS, unit="", plausible=0.25, shown_by="a straight, or bends to both sides")


def _contrast(name: str) -> Number:
    return Number(
        name=RADIUS_OF + name,
        unit="",
        plausible=0.04,
        shown_by="a straight, and rotations on the spot",
        is_optional=True,
    )


def _track(*, skids: bool) -> Number:
    return Number(
        name=TRACK, unit="", plausible=1.0 if skids else 0.3, shown_by="bends, or rotations on the spot"
    )


def _contrasts(wheels: Sequence[WheelSettings]) -> dict[str, Array]:
    """Return unit contrasts of the radii of wheels with encoder, across the common factor and each other."""
    is_measured = np.array([wheel.measured for wheel in wheels], float)
    named = [
        ("left/right", np.sign([wheel.y_m for wheel in wheels])),
        ("front/rear", np.sign([wheel.x_m for wheel in wheels])),
        *((f"wheel {place}", np.eye(len(wheels))[place]) for place in range(len(wheels))),
    ]
    if len({(wheel.x_m > 0.0, wheel.y_m > 0.0) for wheel in wheels}) != len(wheels):
        named = named[:1] if not any(wheel.roller_deg for wheel in wheels) else named[2:]
    basis, contrasts = [is_measured / np.linalg.norm(is_measured)], {}
    for name, vector in named:
        rest = vector * is_measured
        for other in basis:
            rest = rest - float(rest @ other) * other
        size = float(np.linalg.norm(rest))
        if size > 1e-6:
            basis.append(rest / size)
            # Scaled so that the greatest share is 1: the number is the factor of a radius.
            contrasts[name] = rest / float(np.abs(rest).max())
    return contrasts


def _wheels_of(rover: OmniRoverSettings) -> tuple[WheelSettings, ...]:
    """Return the wheels of a rover with three omnidirectional ones, which drive counter-clockwise."""
    return tuple(
        WheelSettings(
            x_m=rover.base_radius_m * math.cos(math.radians(angle_deg)),
            y_m=rover.base_radius_m * math.sin(math.radians(angle_deg)),
            radius_m=rover.wheel_radius_m,
            angle_deg=math.remainder(angle_deg + 90.0, 360.0),
            roller_deg=90.0,
        )
        for angle_deg in rover.wheel_angles_deg
    )
