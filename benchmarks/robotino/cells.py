"""Steady states of the measured Robotino runs, and of the simulated rover given the same setpoints."""

import gzip
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from drivers.clock import NANOSECONDS_PER_SECOND, nanoseconds
from sim_backends.plants.robotino.plant import RobotinoPlant
from sim_backends.plants.robotino.settings import RobotinoPlantSettings
from sim_backends.plants.robotino.site import RectanglePatch, Site
from sim_backends.plants.robotino.surfaces import Surface

Floats = NDArray[np.float64]

SPEED_STEP_RAD_S = 27.0 * math.tau / 60.0 / 16.0
RADIANS_PER_TICK = math.tau / 2000.0 / 16.0
WHEEL_RADIUS_M = 0.040
SETTLED_AFTER_S = 1.0
LAST_ROWS_LEFT_OUT_S = 0.15
FILE_SCALE_MM_PER_PX = 1.84
ANGLES = np.radians((60.0, 180.0, 300.0))
BODY_FROM_WHEELS = np.linalg.inv(np.column_stack((-np.sin(ANGLES), np.cos(ANGLES), np.full(3, 0.125))))


@dataclass(frozen=True, slots=True)
class Cell:
    """A steady state.

    Attributes:
        surface: What it runs on.
        speed_m_s, direction_deg: Commanded; the direction counter-clockwise from ahead.
        set_speed_rad_s: Of the wheels, in whole speed steps as the board gets them.
        current_a: Mean magnitude per wheel.
        velocity: x, y in m/s and yaw rate in rad/s in the body.
        encoder_speed_m_s: What the wheels' turning makes of the rover's speed.
    """

    surface: str
    speed_m_s: float
    direction_deg: int
    set_speed_rad_s: tuple[float, ...]
    current_a: Floats
    velocity: Floats
    encoder_speed_m_s: float

    @property
    def true_speed_m_s(self) -> float:
        """How fast the rover really goes."""
        return math.hypot(self.velocity[0], self.velocity[1])

    @property
    def slip(self) -> float:
        """Share of the wheels' way that is lost."""
        return 1.0 - self.true_speed_m_s / self.encoder_speed_m_s


def measured_cells(folder: Path) -> tuple[float, list[Cell]]:
    """Return the camera scale and the cells of `one_surface_type`.

    The scale, in millimetres per pixel, is the one at which the runs on the table roll without slip.
    """
    cells = [
        _measured(path, surface.name.removesuffix("_surface"))
        for surface in sorted((folder / "one_surface_type").glob("*_surface"))
        for path in sorted(surface.glob("*.csv.gz"))
    ]
    table = [cell for cell in cells if cell.surface == "table"]
    too_small = np.mean([cell.encoder_speed_m_s / cell.true_speed_m_s for cell in table])
    factor = np.array([too_small, too_small, 1.0])
    return (
        float(FILE_SCALE_MM_PER_PX * too_small),
        [replace(cell, velocity=cell.velocity * factor) for cell in cells],
    )


def _measured(path: Path, surface: str) -> Cell:
    with gzip.open(path, "rt", encoding="utf-8") as stream:
        lines = stream.read().splitlines()
    rows = np.array([[float(item) for item in line.strip(";").split(";")] for line in lines[3:]])
    column = dict(zip(lines[2].strip(";").split(";"), rows.T, strict=True))
    t_s = column["t"] / 1000.0
    steady = np.flatnonzero((t_s > SETTLED_AFTER_S) & (t_s < t_s[-1] - LAST_ROWS_LEFT_OUT_S))
    first, last = steady[0], steady[-1]
    duration_s = t_s[last] - t_s[first]
    ticks = np.array([column[f"m{motor}pos"][last] - column[f"m{motor}pos"][first] for motor in (1, 2, 3)])
    set_speed = np.array([column[f"m{motor}setvel"][first] / 16.0 for motor in (1, 2, 3)])
    forward, left = column["xsetspeed"][first], column["ysetspeed"][first]
    part = slice(first, last + 1)
    return Cell(
        surface,
        round(math.hypot(forward, left), 3),
        round(math.degrees(math.atan2(left, forward))) % 360,
        truncated(set_speed),
        np.array([column[f"m{motor}cur"][part].mean() for motor in (1, 2, 3)]),
        _camera_velocity(column["xpos"][part], column["ypos"][part], column["ang"][part], duration_s),
        float(np.hypot(*(BODY_FROM_WHEELS @ (ticks * RADIANS_PER_TICK * WHEEL_RADIUS_M))[:2])) / duration_s,
    )


def _camera_velocity(x_px: Floats, y_px: Floats, angle_deg: Floats, duration_s: float) -> Floats:
    """Return the mean velocity in the body at the file's scale; the robot's x axis is 90 degrees ahead."""
    yaw = np.unwrap(np.radians(angle_deg)) + math.pi / 2
    middle = 0.5 * (yaw[1:] + yaw[:-1])
    steps = np.diff(x_px) - 1j * np.diff(y_px)
    way = np.sum(steps * np.exp(-1j * middle)) * FILE_SCALE_MM_PER_PX / 1000.0
    return np.array([way.real, way.imag, yaw[-1] - yaw[0]]) / duration_s


def measured_cells_2021(folder: Path, scale_mm_per_px: float) -> list[Cell]:
    """Return the cells of the blue and the red surface (BrOleg5/Slippage-compensation), turning included."""
    cells: list[Cell] = []
    for surface in ("blue", "red"):
        table = np.genfromtxt(folder / f"experimental_data_{surface}.csv", delimiter=";", skip_header=1)
        for command in np.unique(table[:, :3], axis=0):
            rows = table[(table[:, :3] == command).all(axis=1)][1:]
            body = command / 1000.0 * [1.0, 1.0, 1000.0 * math.pi / 180.0]
            mean = rows.mean(axis=0)
            camera = mean[[20, 21]] / 0.5 / 1000.0 * scale_mm_per_px / FILE_SCALE_MM_PER_PX
            wheels = mean[6:9] * math.tau / 60.0 / 16.0
            cells.append(
                Cell(
                    surface,
                    round(math.hypot(body[0], body[1]), 3),
                    round(math.degrees(math.atan2(body[1], body[0]))) % 360,
                    truncated(np.linalg.solve(BODY_FROM_WHEELS, body) / WHEEL_RADIUS_M),
                    mean[9:12],
                    np.array([camera[0], camera[1], math.radians(mean[19]) / 0.5]),
                    float(np.hypot(*(BODY_FROM_WHEELS @ wheels * WHEEL_RADIUS_M)[:2])),
                )
            )
    return cells


def truncated(speed_rad_s: Floats) -> tuple[float, ...]:
    """Return setpoints as the board gets them: whole speed steps of 27 rpm at the motor, cut off."""
    steps = np.trunc(speed_rad_s / SPEED_STEP_RAD_S + np.copysign(1e-9, speed_rad_s))
    return tuple((steps * SPEED_STEP_RAD_S).tolist())


def simulated(
    cell: Cell,
    surface: Surface,
    sinkage_m: float = 0.0,
    centre_of_mass_x_m: float | None = None,
    duration_s: float = 3.0,
) -> Cell:
    """Return what the simulated rover does on an even floor of a surface with the same setpoints."""
    patches = [] if sinkage_m == 0.0 else [_everywhere(cell.surface, sinkage_m)]
    site = Site(
        floor=cell.surface,
        surfaces={cell.surface: surface},
        roughness=0.0,
        patches=tuple(patches),
        cell_m=0.1,
    )
    settings = RobotinoPlantSettings(site=site)
    if centre_of_mass_x_m is not None:
        settings = settings.model_copy(update={"centre_of_mass_x_m": centre_of_mass_x_m})
    plant = RobotinoPlant(settings, np.random.default_rng(1), NANOSECONDS_PER_SECOND)
    plant.set_wheel_speeds(cell.set_speed_rad_s)
    plant.advance(NANOSECONDS_PER_SECOND + nanoseconds(SETTLED_AFTER_S))
    start = np.array(plant.truth().wheel_position_rad)
    currents: list[Floats] = []
    velocities: list[Floats] = []
    for t_ns in _instants(SETTLED_AFTER_S, duration_s):
        plant.advance(t_ns)
        truth = plant.truth()
        currents.append(np.abs(truth.motor_current_a))
        velocities.append(np.array([truth.velocity_x_m_s, truth.velocity_y_m_s, truth.yaw_rate_rad_s]))
    turned = np.array(plant.truth().wheel_position_rad) - start
    way = BODY_FROM_WHEELS @ turned * WHEEL_RADIUS_M / (duration_s - SETTLED_AFTER_S)
    return replace(
        cell,
        current_a=np.mean(currents, axis=0),
        velocity=np.mean(velocities, axis=0),
        encoder_speed_m_s=float(np.hypot(way[0], way[1])),
    )


def _everywhere(surface: str, sinkage_m: float) -> RectanglePatch:
    return RectanglePatch(
        type="rectangle",
        surface=surface,
        inner="soft",
        sinkage_m=sinkage_m,
        x_min_m=-5.0,
        x_max_m=5.0,
        y_min_m=-5.0,
        y_max_m=5.0,
    )


def _instants(start_s: float, end_s: float) -> Iterator[int]:
    """Yield times 7 ms apart, no multiple of the speed loop's period, the end included."""
    for t_s in (*np.arange(start_s, end_s, 0.007)[1:].tolist(), end_s):
        yield NANOSECONDS_PER_SECOND + nanoseconds(t_s)
