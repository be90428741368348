"""Grounds: from the velocity that a wheel's rim gives its contact point to the velocity that the point gets.

A share of the rim's velocity is lost along it, and a share is added across it. Patches have one pair of
shares each: squares, or the cells between random lines, whose shares correlate with exp(-r / size) exactly.
Errors of drives on patches are no normal numbers, as a loop inside one patch closes: a smooth normal field
has the same correlation and makes normal errors.
The physical floors are force balances of linear tyres: slip is force over slip stiffness. Where the ground
changes, a tyre needs a way of about its radius until it feels that (relaxation length).
"""

import math
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
GRAVITY_M_S2 = 9.81
MOST_LOST = 0.9
RELAXATION_M = 0.1


@dataclass(frozen=True)
class Contact:
    """Wheels on the ground.

    Attributes:
        spots: Contact points on the ground, shape (n, 2), m.
        rims: Velocities of the contact points without slip, in axes of the ground, shape (n, 2), m/s.
        body: Velocity of the rover's origin without slip, in axes of the ground, shape (2,), m/s.
        steps_m: Distances by the rims in this step, shape (n,).
        acceleration: Of the rover along its course, m/s^2.
        travel_m: Distance by the wheels until now.
    """

    spots: Array
    rims: Array
    body: Array
    steps_m: Array
    acceleration: float
    travel_m: float


class Ground(Protocol):
    """Decides the velocities of contact points."""

    def velocities(self, contact: Contact) -> Array:
        """Return the velocities of free contact points, in axes of the ground, shape (n, 2), m/s."""
        ...


def across(vectors: Array) -> Array:
    """Return vectors rotated by 90 degrees counter-clockwise, shape (n, 2)."""
    return np.stack((-vectors[:, 1], vectors[:, 0]), axis=1)


@dataclass(frozen=True)
class Shares:
    """One lost share and one share across, the same everywhere; or one pair for each wheel."""

    lost: float | Array
    sideways: float | Array = 0.0

    def velocities(self, contact: Contact) -> Array:
        """Return the velocities of free contact points."""
        lost, sideways = (np.reshape(share, (-1, 1)) for share in (self.lost, self.sideways))
        return (1.0 - lost) * contact.rims + sideways * across(contact.rims)


@dataclass(kw_only=True)
class Patches:
    """Pairs of shares, normal, one for each patch.

    Attributes:
        size_m: Side of the squares, or mean chord of the cells between lines.
        lines: Directions and distances of the lines, shape (n, 2), or None for squares.
        corner: Offset and rotation of the grid of squares.
        drawn: Shares by patch, as far as patches were entered.
        felt: Shares that each wheel feels, shape (n, 2).
    """

    mean: float
    lost_sd: float
    sideways_sd: float
    size_m: float
    seed: int
    lines: Array | None
    corner: tuple[float, float, float]
    drawn: dict[bytes, tuple[float, float]] = field(default_factory=dict)
    felt: Array | None = None

    def velocities(self, contact: Contact) -> Array:
        """Return the velocities of free contact points."""
        shares = np.array([self.shares(x, y) for x, y in contact.spots.tolist()])
        if self.felt is None:
            self.felt = shares
        self.felt = self.felt + -np.expm1(-contact.steps_m / RELAXATION_M)[:, None] * (shares - self.felt)
        return Shares(self.felt[:, 0], self.felt[:, 1]).velocities(contact)

    def shares(self, x: float, y: float) -> tuple[float, float]:
        """Return the shares of the patch at a place."""
        if self.lines is None:
            east, north, angle = self.corner
            cos, sin = math.cos(angle), math.sin(angle)
            place = np.array((east + cos * x + sin * y, north + cos * y - sin * x))
            key = np.floor(place / self.size_m).astype(np.int64).tobytes()
        else:
            sides = np.cos(self.lines[:, 0]) * x + np.sin(self.lines[:, 0]) * y > self.lines[:, 1]
            key = np.packbits(sides).tobytes()
        if key not in self.drawn:
            rng = np.random.default_rng([self.seed, *key])
            lost = self.mean + self.lost_sd * rng.standard_normal()
            while abs(lost) > MOST_LOST:
                lost = self.mean + self.lost_sd * rng.standard_normal()
            self.drawn[key] = (float(lost), float(self.sideways_sd * rng.standard_normal()))
        return self.drawn[key]


@dataclass(frozen=True)
class Smooth:
    """A normal field of shares that correlate with exp(-r / size): a sum of many waves.

    Attributes:
        waves: Wave vectors, rad/m, shape (n, 2).
        phases: Of the waves of the lost and of the sideways share, shape (2, n).
    """

    mean: float
    sds: tuple[float, float]
    waves: Array
    phases: Array

    def velocities(self, contact: Contact) -> Array:
        """Return the velocities of free contact points."""
        lost, sideways = self.shares(contact.spots)
        return Shares(lost, sideways).velocities(contact)

    def shares(self, spots: Array) -> tuple[Array, Array]:
        """Return the shares at places of shape (n, 2), two arrays of shape (n,)."""
        angles = spots @ self.waves.T
        scale = math.sqrt(2.0 / len(self.waves))
        lost, sideways = (
            sd * scale * np.cos(angles + phases).sum(axis=1)
            for sd, phases in zip(self.sds, self.phases, strict=True)
        )
        return np.clip(self.mean + lost, -MOST_LOST, MOST_LOST), sideways


def draw_smooth(
    rng: np.random.Generator,
    lost_sd: float,
    sideways_sd: float,
    *,
    mean: float = 0.0,
    size_m: float = 10.0,
    count: int = 300,
) -> Smooth:
    """Return a smooth field.

    The spectrum of exp(-r / size) in the plane has the share 1 - 1 / sqrt(1 + (k size)^2) below k.
    """
    sizes = np.sqrt(rng.uniform(0.0, 1.0, count) ** -2.0 - 1.0) / size_m
    directions = rng.uniform(0.0, math.tau, count)
    waves = sizes[:, None] * np.stack((np.cos(directions), np.sin(directions)), axis=1)
    return Smooth(mean, (lost_sd, sideways_sd), waves, rng.uniform(0.0, math.tau, (2, count)))


def draw_patches(
    rng: np.random.Generator,
    lost_sd: float,
    sideways_sd: float,
    *,
    mean: float = 0.0,
    size_m: float = 10.0,
    extent_m: float = 40.0,
    are_squares: bool,
) -> Patches:
    """Return patches around the origin. Lines cover a circle of the given radius.

    The rate of lines that cross a straight way of length r is r / size_m: two points are in one cell with
    probability exp(-r / size_m).
    """
    lines = None
    if not are_squares:
        # A line at a uniform angle in [0, pi) and distance in [-R, R] crosses a way of length r with mean
        # probability r / (pi R).
        count = rng.poisson(math.pi * extent_m / size_m)
        lines = np.column_stack((rng.uniform(0.0, math.pi, count), rng.uniform(-extent_m, extent_m, count)))
    corner = (rng.uniform(0.0, size_m), rng.uniform(0.0, size_m), rng.uniform(0.0, math.tau))
    return Patches(
        mean=mean,
        lost_sd=lost_sd,
        sideways_sd=sideways_sd,
        size_m=size_m,
        seed=int(rng.integers(2**31)),
        lines=lines,
        corner=corner,
    )


@dataclass(frozen=True, kw_only=True)
class Floor:
    """A firm floor by force balance of linear tyres.

    Attributes:
        resistance: Rolling resistance over weight.
        stiffness: Force over weight per unit of slip, the same along and across.
        pile: Force of the pile of a carpet over weight, axes of the ground.
        radius_errors: True radius over the stated one less one, of each wheel.
    """

    resistance: float
    stiffness: float
    radius_errors: Array
    pile: tuple[float, float] = (0.0, 0.0)

    def velocities(self, contact: Contact) -> Array:
        """Return the velocities of free contact points."""
        rims = contact.rims * (1.0 + self.radius_errors[:, None])
        speed: Array = np.linalg.norm(rims, axis=1)[:, None]
        slip = (self.resistance + contact.acceleration / GRAVITY_M_S2) / self.stiffness
        velocities: Array = (1.0 - slip) * rims + speed * np.array(self.pile) / self.stiffness
        return velocities


@dataclass(frozen=True)
class Drag:
    """A load behind the rover: every contact point loses the same share of the velocity of the body.

    Rotations lose nothing, so that a gyro and the wheels agree.
    """

    lost: float
    sideways: float = 0.0

    def velocities(self, contact: Contact) -> Array:
        """Return the velocities of free contact points."""
        body = contact.body[None, :]
        return contact.rims - self.lost * body + self.sideways * across(body)


@dataclass(frozen=True)
class Later:
    """One ground until a distance by the wheels; then a second one takes from what the first one left."""

    before: Ground
    after: Ground
    begin_m: float

    def velocities(self, contact: Contact) -> Array:
        """Return the velocities of free contact points."""
        left = self.before.velocities(contact)
        since_m = contact.travel_m - self.begin_m
        if since_m <= 0.0:
            return left
        after = self.after.velocities(replace(contact, rims=left))
        return left + -math.expm1(-since_m / RELAXATION_M) * (after - left)
