"""Corrections of the wheels of a recorded drive that are tried: one fault each."""

import math
from collections.abc import Iterator
from itertools import combinations
from typing import NamedTuple

import numpy as np

from controllers.motion.kinematics import Kinematics
from controllers.motion.rover_geometry import RoverSettings, SkidSteerRoverSettings, WheelsRoverSettings
from rover_hil.drives.arrays import Array
from rover_hil.drives.quality.drive_paths import effects_of, moves_of
from rover_hil.drives.quality.motion import Windows
from rover_hil.drives.quality.references import Fit, Reference

STEERING = (
    ("the steering reversed", -1.0),
    ("the steering in deg where rad is meant", math.radians(1.0)),
    ("the steering in rad where deg is meant", math.degrees(1.0)),
)
"""Corrections of the steering angles, and by what they multiply them."""
RATIOS = tuple(np.geomspace(1.0 / 40.0, 40.0, 75).tolist())
"""Of steering angles, that are tried."""
SIDE_FACTORS = tuple(np.geomspace(0.7, 1.4, 29).tolist())
BACKWARDS, EXCHANGED = "all wheels reversed", "left and right exchanged"


class Correction(NamedTuple):
    """A correction, and the motion with it.

    Attributes:
        what: What is corrected.
        moves: Ahead and left in m, yaw in rad, in each window.
    """

    what: str
    moves: Array


class Wheels:
    """The wheels of a drive, and what corrects them.

    Args:
        rover: They belong to it.
        kinematics: Of the rover.
        windows: What they measured.
    """

    def __init__(self, rover: RoverSettings, kinematics: Kinematics, windows: Windows) -> None:
        self._rover = rover
        self._kinematics = kinematics
        self._windows = windows
        self._effects = effects_of(kinematics, windows.steering_rad)
        self.count = kinematics.wheel_count
        self.measured = [wheel for wheel in range(self.count) if wheel not in kinematics.unmeasured]

    @property
    def moves(self) -> Array:
        """Return the motion by the wheels as they are."""
        return moves_of(self._windows.turned_rad, self._effects)

    @property
    def yaw_effects(self) -> Array:
        """Return the rotation of the rover by each wheel, per angle, as the wheels are steered first."""
        effects: Array = self._effects[0][:, 2]
        return effects

    @property
    def steering_limit_rad(self) -> float:
        """Return how far the wheels steer at most, by their description; infinite where it has none."""
        wheels = self._rover.wheels if isinstance(self._rover, WheelsRoverSettings) else ()
        limits_deg = [
            max(-each.steering.low_deg, each.steering.high_deg)
            for each in wheels
            if each.steering is not None
        ]
        return math.radians(max(limits_deg, default=math.inf))

    @property
    def is_skidding(self) -> bool:
        """Whether the wheels must slip in a rotation, so that its factor shows nothing."""
        rover = self._rover
        if isinstance(rover, WheelsRoverSettings):
            return self._windows.steering_rad is None and len({wheel.x_m for wheel in rover.wheels}) > 1
        return isinstance(rover, SkidSteerRoverSettings)

    def corrections(self) -> Iterator[Correction]:
        """Yield signs, exchanges and steering."""
        turned_rad = self._windows.turned_rad
        for what, signs, order in self._arrangements():
            moves = moves_of(turned_rad[:, np.array(order, int)] * np.array(signs), self._effects)
            yield Correction(what, moves)
        if self._windows.steering_rad is not None:
            for what, factor in STEERING:
                yield Correction(what, self._steered(factor))

    def ratio(self, reference: Reference) -> tuple[Correction, Fit] | None:
        """Return the steering angles with the factor that fits best; None where none steers."""
        if self._windows.steering_rad is None:
            return None
        # A free scale could take the place of the factor.
        factor = min(
            RATIOS, key=lambda each: float(reference.errors(self._steered(each), self.moves)[0].sum())
        )
        what = (
            f"the steering angles {factor:.2g} times as large, as with ratio = {factor:.2g}: "
            "the angle of a steering wheel, or of a motor"
        )
        correction = Correction(what, self._steered(factor))
        return correction, reference.fit(correction.moves)

    def side(self, reference: Reference) -> tuple[float, Fit] | None:
        """Return the factor of the left wheels that fits best; None where the rover has no two sides."""
        left = self._left()
        if left is None:
            return None
        best = min(SIDE_FACTORS, key=lambda each: reference.fit(self._sided(left, each)).residual)
        return best, reference.fit(self._sided(left, best))

    def signs(self) -> list[Array]:
        """Return the motion with all wheels reversed, and where there are two sides with each reversed."""
        left = self._left()
        signs = [-np.ones(self.count)] if left is None else [-np.ones(self.count), -left, left]
        return [moves_of(self._windows.turned_rad * each, self._effects) for each in signs]

    def _sided(self, left: Array, factor: float) -> Array:
        # The mean factor of both sides stays 1.
        factors = np.where(left > 0.0, factor**0.5, factor**-0.5)
        return moves_of(self._windows.turned_rad * factors, self._effects)

    def _left(self) -> Array | None:
        """Return +1 for wheels that turn the rover to the right when they go ahead, else -1."""
        if self._windows.steering_rad is not None:
            return None
        effects = self._effects[0]
        if (effects[self.measured, 0] <= 0.0).any() or (effects[self.measured, 2] == 0.0).any():
            return None
        return np.where(effects[:, 2] < 0.0, 1.0, -1.0)

    def _steered(self, factor: float) -> Array:
        angles = self._windows.steering_rad
        assert angles is not None  # noqa: S101 the callers have checked it
        return moves_of(self._windows.turned_rad, effects_of(self._kinematics, factor * angles))

    def _arrangements(self) -> Iterator[tuple[str, tuple[float, ...], tuple[int, ...]]]:
        """Yield name, sign and source of each wheel of every correction that is tried."""
        same, ones = tuple(range(self.count)), (1.0,) * self.count
        for wheel in self.measured:
            signs = tuple(-1.0 if place == wheel else 1.0 for place in same)
            yield f"wheel {wheel} reversed", signs, same
        if len(self.measured) > 1:
            yield BACKWARDS, tuple(-sign for sign in ones), same
        mirrored = _mirrored(self._rover)
        if mirrored is not None and len(self.measured) == self.count > 2:
            yield EXCHANGED, ones, mirrored
            yield f"{EXCHANGED} and all reversed", tuple(-sign for sign in ones), mirrored
        for first, second in combinations(self.measured, 2):
            order = list(same)
            order[first], order[second] = second, first
            name = "left and right" if len(self.measured) == 2 else f"wheels {first} and {second}"
            yield f"{name} exchanged", ones, tuple(order)


def _mirrored(rover: RoverSettings) -> tuple[int, ...] | None:
    """Return which wheel sits on the other side of each; None where one has no such."""
    if isinstance(rover, SkidSteerRoverSettings):
        return 1, 0, 3, 2
    if not isinstance(rover, WheelsRoverSettings):
        return None
    order = []
    for wheel in rover.wheels:
        others = [
            place
            for place, opposite in enumerate(rover.wheels)
            if math.isclose(opposite.x_m, wheel.x_m) and math.isclose(opposite.y_m, -wheel.y_m)
        ]
        if len(others) != 1:
            return None
        order.append(others[0])
    return tuple(order)
