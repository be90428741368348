"""Three rovers: what their wheels do at a commanded motion, and how they are described to the program."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

STEERING_STEP_RAD = math.radians(0.1)


@dataclass(frozen=True, kw_only=True)
class Rover:
    """Wheels of a rover.

    Attributes:
        spots: Contact points, x forward and y to the left, shape (n, 2), m.
        angles: Directions in which the wheels roll unsteered, counter-clockwise from x, shape (n,), rad.
        resists_sideways: False for wheels with rollers.
        steers: Whether each wheel steers.
        rover_toml: The same rover as `[rover]` of a configuration.
    """

    name: str
    spots: Array
    angles: Array
    radius_m: float
    ticks_per_turn: int
    resists_sideways: bool
    steers: bool
    rover_toml: str

    def directions(self, steering: Array) -> Array:
        """Return unit vectors in which the wheels roll, shape (n, 2)."""
        angles = self.angles + steering
        return np.stack((np.cos(angles), np.sin(angles)), axis=1)

    def contact_velocities(self, twist: Sequence[float] | Array) -> Array:
        """Return velocities of the contact points of a rigid body, shape (n, 2)."""
        forward, left, rate = twist
        return np.stack((forward - rate * self.spots[:, 1], left + rate * self.spots[:, 0]), axis=1)

    def wheels_for(self, twist: Sequence[float] | Array, steering: Array) -> tuple[Array, Array]:
        """Return rim speeds and steering angles without slip; at standstill the steering stays."""
        wanted = self.contact_velocities(twist)
        if self.steers and float(np.abs(wanted).max()) > 1e-3:
            steering = np.arctan2(wanted[:, 1], wanted[:, 0])
            steering = (steering + 0.5 * math.pi) % math.pi - 0.5 * math.pi
        return np.einsum("ij,ij->i", wanted, self.directions(steering)), steering

    def twist_of(self, directions: Array) -> Array:
        """Return the matrix from velocities along and across the wheels to the twist of least squares."""
        return np.asarray(np.linalg.pinv(self.constraints(directions)), dtype=np.float64)

    def constraints(self, directions: Array) -> Array:
        """Return the matrix from the twist to velocities along the wheels, then across them."""
        rows = [directions]
        if self.resists_sideways:
            rows.append(np.stack((-directions[:, 1], directions[:, 0]), axis=1))
        blocks = [
            np.column_stack((row, row[:, 1] * self.spots[:, 0] - row[:, 0] * self.spots[:, 1]))
            for row in rows
        ]
        return np.concatenate(blocks)


def _wheels_toml(spots: Array, radius_m: float, steering: str) -> str:
    lines = (f"  {{ x_m = {x:g}, y_m = {y:g}, radius_m = {radius_m:g}{steering} }}," for x, y in spots)
    return "\n".join(('[rover]\nkinematics = "wheels"\nwheels = [', *lines, "]\n"))


_SIDES = np.array(((0.0, 0.2), (0.0, -0.2)))
_CORNERS = np.array(((0.3, 0.25), (0.3, -0.25), (-0.3, 0.25), (-0.3, -0.25)))
_ARMS = np.radians((60.0, 180.0, 300.0))

DIFFERENTIAL = Rover(
    name="differential",
    spots=_SIDES,
    angles=np.zeros(2),
    radius_m=0.1,
    ticks_per_turn=4096,
    resists_sideways=True,
    steers=False,
    rover_toml=_wheels_toml(_SIDES, 0.1, ""),
)
OMNI = Rover(
    name="omni",
    spots=0.2 * np.stack((np.cos(_ARMS), np.sin(_ARMS)), axis=1),
    angles=_ARMS + 0.5 * math.pi,
    radius_m=0.06,
    ticks_per_turn=16384,
    resists_sideways=False,
    steers=False,
    rover_toml='[rover]\nkinematics = "omni3"\nwheel_radius_m = 0.06\nbase_radius_m = 0.2\n'
    "wheel_angles_deg = [60, 180, 300]\n",
)
STEERED = Rover(
    name="steered",
    spots=_CORNERS,
    angles=np.zeros(4),
    radius_m=0.1,
    ticks_per_turn=8192,
    resists_sideways=True,
    steers=True,
    rover_toml=_wheels_toml(_CORNERS, 0.1, ", steering = { low_deg = -90, high_deg = 90 }"),
)
ROVERS = (DIFFERENTIAL, OMNI, STEERED)
