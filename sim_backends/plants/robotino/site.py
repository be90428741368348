"""The test site: patches of covering on firm or soft ground, from a TOML map or random."""

import math
from importlib import resources
from pathlib import Path
from typing import Annotated, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, ValidationError, model_validator

from drivers.errors import ConfigError
from drivers.files import is_file
from drivers.settings import Settings, read_toml
from sim_backends.arrays import Array
from sim_backends.plants.robotino.surfaces import InnerLayer, Surface, shipped_surfaces

Mask = NDArray[np.bool_]

TILE_M = 0.3
TILE_JITTER_M = 0.08
SURFACE_SHARES = {"table": 0.2, "brown": 0.4, "gray": 0.3, "green": 0.06, "blue": 0.04}
SOFT_SHARE = {"table": 0.4, "brown": 0.4}
"""Only below coverings with little resistance: otherwise the rover gets stuck on one site of five."""
SOFTEST_M = 0.002


class Patch(Settings):
    """A piece of the site.

    Attributes:
        surface: Name of its covering, the outer layer.
        inner: Layer below the covering, firm or soft.
        sinkage_m: Sinkage of a wheel on a soft inner layer, at the rover's mean wheel load.
    """

    surface: str
    inner: InnerLayer = "firm"
    sinkage_m: Annotated[float, Field(gt=0, le=0.02)] = 0.001


class RectanglePatch(Patch):
    """A rectangle, sides along x and y of the world."""

    type: Literal["rectangle"]
    x_min_m: float
    x_max_m: float
    y_min_m: float
    y_max_m: float

    @model_validator(mode="after")
    def _check_area(self) -> Self:
        if self.x_max_m <= self.x_min_m or self.y_max_m <= self.y_min_m:
            raise ValueError(
                "the rectangle covers nothing: x_max_m and y_max_m must be greater than x_min_m and y_min_m"
            )
        return self

    @property
    def x_range_m(self) -> tuple[float, float]:
        """Least and greatest x."""
        return self.x_min_m, self.x_max_m

    @property
    def y_range_m(self) -> tuple[float, float]:
        """Least and greatest y."""
        return self.y_min_m, self.y_max_m

    def covers(self, x_m: Array, y_m: Array) -> Mask:
        """Return for each point whether it lies on the patch."""
        inside: Mask = (self.x_min_m <= x_m) & (x_m <= self.x_max_m)
        return inside & (self.y_min_m <= y_m) & (y_m <= self.y_max_m)


class CirclePatch(Patch):
    """A disc."""

    type: Literal["circle"]
    x_m: float
    y_m: float
    radius_m: Annotated[float, Field(gt=0)]

    @property
    def x_range_m(self) -> tuple[float, float]:
        """Least and greatest x."""
        return self.x_m - self.radius_m, self.x_m + self.radius_m

    @property
    def y_range_m(self) -> tuple[float, float]:
        """Least and greatest y."""
        return self.y_m - self.radius_m, self.y_m + self.radius_m

    def covers(self, x_m: Array, y_m: Array) -> Mask:
        """Return for each point whether it lies on the patch."""
        inside: Mask = np.hypot(x_m - self.x_m, y_m - self.y_m) <= self.radius_m
        return inside


class PolygonPatch(Patch):
    """A polygon; its sides must not cross.

    Attributes:
        corners_m: x, y of each corner, in order.
    """

    type: Literal["polygon"]
    corners_m: Annotated[tuple[tuple[float, float], ...], Field(min_length=3)]

    @property
    def x_range_m(self) -> tuple[float, float]:
        """Least and greatest x."""
        return min(x for x, _ in self.corners_m), max(x for x, _ in self.corners_m)

    @property
    def y_range_m(self) -> tuple[float, float]:
        """Least and greatest y."""
        return min(y for _, y in self.corners_m), max(y for _, y in self.corners_m)

    def covers(self, x_m: Array, y_m: Array) -> Mask:
        """Return for each point whether it is inside: a ray from it crosses an odd number of sides."""
        inside: Mask = np.zeros(np.broadcast(x_m, y_m).shape, dtype=np.bool_)
        for (ax, ay), (bx, by) in zip(self.corners_m, (*self.corners_m[1:], self.corners_m[0]), strict=True):
            if ay != by:
                straddles = (ay > y_m) != (by > y_m)
                inside ^= straddles & (x_m < ax + (y_m - ay) * (bx - ax) / (by - ay))
        return inside


AnyPatch = Annotated[RectanglePatch | CirclePatch | PolygonPatch, Field(discriminator="type")]


class Site(Settings):
    """A test site.

    Attributes:
        name: Name in reports.
        floor: Surface outside every patch, firm.
        patches: Where they overlap, the last one applies.
        surfaces: The coverings by name; by default the shipped, fitted ones.
        roughness: Standard deviation of the resistance from place to place, as a share of it.
        roughness_length_m: Correlation length of the resistance.
        cell_m: Width of the cells in which the ground is stored.
    """

    name: str = "plain floor"
    floor: str = "table"
    patches: tuple[AnyPatch, ...] = ()
    surfaces: dict[str, Surface] = Field(default_factory=shipped_surfaces)
    roughness: Annotated[float, Field(ge=0, le=0.5)] = 0.1
    roughness_length_m: Annotated[float, Field(ge=0.01, le=1)] = 0.05
    cell_m: Annotated[float, Field(ge=0.001, le=0.1)] = 0.005

    @model_validator(mode="after")
    def _check_surfaces(self) -> Self:
        for name in (self.floor, *(patch.surface for patch in self.patches)):
            if name not in self.surfaces:
                raise ValueError(f"no surface '{name}': name one of {', '.join(self.surfaces)}")
        return self


def load_site(name_or_path: str) -> Site:
    """Read a site by the name of a shipped one (`paper_like`, `floor_NAME`) or the path of a TOML file.

    `floor_NAME` is the surface of that name everywhere, e.g. `floor_gray`.

    Raises:
        ConfigError: The file is missing or not TOML, a key or surface is unknown, or a value is out of range.
    """
    shipped = resources.files("sim_backends.plants.robotino") / "sites" / f"{name_or_path}.toml"
    if name_or_path.startswith("floor_"):
        table: dict[str, object] = {"name": name_or_path, "floor": name_or_path.removeprefix("floor_")}
    else:
        path = shipped if isinstance(shipped, Path) and is_file(shipped) else Path(name_or_path)
        table = read_toml(path, f"site '{name_or_path}'", "name a shipped site or a TOML file")
    try:
        return Site.model_validate(table)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"]) or "patches"
        raise ConfigError(f"site '{name_or_path}': {where}: {first['msg']}") from error


def random_site(rng: np.random.Generator) -> Site:
    """Return a patchwork of coverings about the rectangle from (0, 0) to (0.9, 0.4) m.

    Four-cornered patches about 0.3 m wide with shifted corners, from 0.5 m outside the rectangle; each
    draws its covering and, below those with little resistance, whether it is soft.

    Args:
        rng: Source of all randomness.
    """
    names = list(SURFACE_SHARES)
    columns, rows = math.ceil(1.9 / TILE_M), math.ceil(1.4 / TILE_M)
    grid = np.stack(np.meshgrid(np.arange(columns + 1), np.arange(rows + 1), indexing="ij"), axis=-1)
    shifts = rng.uniform(-TILE_JITTER_M, TILE_JITTER_M, (columns + 1, rows + 1, 2))
    corners = grid * TILE_M - 0.5 + shifts
    patches: list[AnyPatch] = []
    for column in range(columns):
        for row in range(rows):
            ring = ((column, row), (column + 1, row), (column + 1, row + 1), (column, row + 1))
            surface = names[rng.choice(len(names), p=list(SURFACE_SHARES.values()))]
            patches.append(
                PolygonPatch(
                    type="polygon",
                    corners_m=tuple((float(corners[at][0]), float(corners[at][1])) for at in ring),
                    surface=surface,
                    inner="soft" if rng.random() < SOFT_SHARE.get(surface, 0.0) else "firm",
                    sinkage_m=rng.uniform(0.1, 1.0) * SOFTEST_M,
                )
            )
    return Site(name="random", floor="brown", patches=tuple(patches))
