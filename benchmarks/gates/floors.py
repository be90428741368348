"""Rectangles on floors of `tests/nature`, which share no code with an estimator and were fitted to none."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.safety.missions import Driven, Falsify, MakeCamera, drive, ground_camera, with_fixes
from benchmarks.wilson import interval_percent
from controllers.safety import Mode
from controllers.slip.effort.gyro_response import GyroResponse
from controllers.slip.effort.parameters import EFFORT
from rover_hil.config import Config, load_config
from rover_hil.tune.metrics import TruePath, closure_m, path_rms_m
from tests.nature.floors import NATURES, Nature

BAR_PATH_M, BAR_CLOSURE_M = 0.045, 0.100
FIXES_PER_S = 0.5
FIRST_FLOOR = 100
"""Of `make gates`. Floors 0 to 39 are those of the quantiles of slip in `tests/nature/floors`."""
FIRST_FULL_FLOOR = 200
"""Of `make gates-full`; nothing is tuned on these."""
DIFFERENTIAL = Path(__file__).parents[2] / "docs" / "examples" / "differential.toml"
TWO_WHEELS = "tread, two wheels"
NATURE_NAMES = tuple(nature.name for nature in NATURES if nature.name != TWO_WHEELS)
VERSIONS = ("encoders and gyro", "shipped", "calibrated gyro", "secant")
"""`secant` is the reading without the bound by lag and force, `EFFORT.bracket.weight` of 0."""
CALIBRATED = GyroResponse(source="the simulated sensor", identified_on="2026-11-27")
CAMERA_VERSIONS = ("encoders, gyro and camera", "shipped and camera")
"""With a camera that measures the motion over the ground, by the model of its errors in `tests/nature`."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Cell:
    """A row of the table: missions of one version on the floors of one nature.

    Attributes:
        nature: Name of the contact law.
        version: How slip is known, one of `VERSIONS` or `CAMERA_VERSIONS`.
        has_fixes: With pose fixes every two seconds.
    """

    nature: str
    version: str
    has_fixes: bool

    @property
    def title(self) -> str:
        """Name of the row."""
        return f"{self.nature}, {self.version}, {'fixes' if self.has_fixes else 'no fixes'}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Way:
    """The true way of a mission.

    Attributes:
        has_finished: The mission was driven to its end.
        path_m: Rms distance from the rectangle.
        closure_m: Distance of the end from the start.
    """

    has_finished: bool
    path_m: float
    closure_m: float

    @property
    def is_within(self) -> bool:
        """Whether it is within the bars of path and closure."""
        return self.has_finished and self.path_m <= BAR_PATH_M and self.closure_m <= BAR_CLOSURE_M


def cells(versions: Sequence[str]) -> Iterator[Cell]:
    """Yield the rows of these versions; the rover with two wheels has no map of slip."""
    for nature in NATURES:
        for version in versions:
            if nature.name == TWO_WHEELS and version not in (VERSIONS[0], CAMERA_VERSIONS[0]):
                continue
            for has_fixes in (False, True):
                yield Cell(nature=nature.name, version=version, has_fixes=has_fixes)


def camera_cells(*, is_full: bool) -> Iterator[Cell]:
    """Yield the rows with a camera; of `make gates` only the camera alone on omnidirectional wheels."""
    for cell in cells(CAMERA_VERSIONS):
        is_alone = cell.version == CAMERA_VERSIONS[0] and cell.nature != TWO_WHEELS and not cell.has_fixes
        if is_full or is_alone:
            yield cell


def configure(cell: Cell, seed: int) -> Config:
    """Return the rover of a row, with noise of `seed`."""
    if cell.nature == TWO_WHEELS:
        config = _with_noise(_with_the_rectangle_of_the_robotino(load_config(str(DIFFERENTIAL))), seed)
    else:
        config = configure_version(cell.version, seed)
    return with_fixes(config, FIXES_PER_S) if cell.has_fixes else config


def configure_version(version: str, seed: int) -> Config:
    """Return the shipped Robotino with slip by a version, with noise of `seed`."""
    config = load_config("robotino")
    if version in (VERSIONS[0], CAMERA_VERSIONS[0]):
        config = config.model_copy(update={"slip": None})
    elif version not in ("shipped", CAMERA_VERSIONS[1]):
        assert config.slip is not None
        slip = config.slip.model_copy(update={"gyro_response": CALIBRATED})
        config = config.model_copy(update={"slip": slip})
    return _with_noise(config, seed)


def _with_noise(config: Config, seed: int) -> Config:
    simulation = config.require_simulation().model_copy(update={"seed": seed})
    return config.model_copy(update={"simulation": simulation})


def _with_the_rectangle_of_the_robotino(config: Config) -> Config:
    rectangle = {"length_m": 0.9, "width_m": 0.4, "speed_m_s": 0.15}
    assert config.mission is not None
    return config.model_copy(update={"mission": config.mission.model_copy(update=rectangle)})


def drive_floor(cell: Cell, seed: int) -> Way:
    """Drive the rectangle on the floor of `seed`; the same arguments give the same way."""
    make_camera = ground_camera(seed) if cell.version in CAMERA_VERSIONS else None
    with bracket_weight(0.0 if cell.version == "secant" else EFFORT.bracket.weight):
        return drive_config(configure(cell, seed), cell.nature, seed, make_camera=make_camera)[0]


@contextmanager
def bracket_weight(weight: float) -> Iterator[None]:
    """Read slip for a while at another place of the bracket; 0 is the secant alone."""
    usual = EFFORT.bracket.weight
    object.__setattr__(EFFORT.bracket, "weight", weight)
    try:
        yield
    finally:
        object.__setattr__(EFFORT.bracket, "weight", usual)


def drive_config(
    config: Config,
    nature_name: str,
    seed: int,
    falsify: Falsify = lambda _, sample: sample,
    make_camera: MakeCamera | None = None,
) -> tuple[Way, Driven]:
    """Drive a rover's mission on the floor of `seed`; return the way, and the drive cycle by cycle."""
    nature = _nature(nature_name)
    floor = nature.draw_floor(seed)
    driven = drive(
        config,
        falsify,
        limit_s=config.loop.time_limit_s,
        make_plant=lambda start_ns: nature.plant(floor, np.random.default_rng(seed), start_ns),
        make_camera=make_camera,
    )
    x_m, y_m, yaw_rad = np.array([moment.truth for moment in driven.moments]).T
    assert config.mission is not None
    path, corners = TruePath(x_m=x_m, y_m=y_m, yaw_rad=yaw_rad), config.mission.corners()
    way = Way(
        has_finished=driven.mode is Mode.FINISHED,
        path_m=path_rms_m(path, corners),
        closure_m=closure_m(path, corners),
    )
    return way, driven


def _nature(name: str) -> Nature:
    return next(nature for nature in NATURES if nature.name == name)


def row_of(ways: Sequence[Way]) -> dict[str, float]:
    """Return the figures of a row: counts, and medians in mm."""
    within, floors = sum(way.is_within for way in ways), len(ways)
    low, high = interval_percent(within, floors)
    return {
        "floors": floors,
        "within": within,
        "95 % from %": round(low),
        "to %": round(high),
        "finished": sum(way.has_finished for way in ways),
        "path mm": round(1e3 * float(np.median([way.path_m for way in ways])), 1),
        "closure mm": round(1e3 * float(np.median([way.closure_m for way in ways])), 1),
    }
