"""A quasi-static drive of a rover along a path over a height field: a row of steady states."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from drivers.errors import ModelError
from sim_backends.terramechanics.slope.height_field import HeightField, Plane, plane_under
from sim_backends.terramechanics.slope.rover import Conditions, Effects, SlopeRover
from sim_backends.terramechanics.slope.steady_state import NO_EFFECTS, SteadyState, solve_steady_state
from sim_backends.terramechanics.soil.library import SoilSettings
from sim_backends.terramechanics.soil.numpy_kernel import numpy_kernel
from sim_backends.terramechanics.soil.quantity import check_range
from sim_backends.terramechanics.soil.slip import shearing_radius, speed_ratio
from sim_backends.terramechanics.soil.wheel_contact import Kernel

Floats = NDArray[np.float64]
TURNS = 12
SETTLED_RAD = 1e-6


@dataclass(frozen=True, slots=True)
class Station:
    """A rover at one place of its path.

    Attributes:
        distance_m: Driven so far, in the plan.
        t_s: Time since the start.
        x_m, y_m: Place.
        azimuth_rad: Where the rover points, counter-clockwise from x; it crabs against its slip angle.
        plane: On which it stands.
        state: Its steady state.
        speed_m_s: Over ground.
        power_w: Of all wheels.
    """

    distance_m: float
    t_s: float
    x_m: float
    y_m: float
    azimuth_rad: float
    plane: Plane
    state: SteadyState
    speed_m_s: float
    power_w: float


@dataclass(frozen=True, slots=True)
class Drive:
    """A drive.

    Attributes:
        stations: In order.
        finished: False where the rover could not go on.
        reason: Why not; empty when finished.
        energy_j: Mechanical, of all wheels.
    """

    stations: tuple[Station, ...]
    finished: bool
    reason: str
    energy_j: float


class Standing(NamedTuple):
    """A rover that points somewhere: plane under it, heading in that plane, steady state."""

    plane: Plane
    heading_rad: float
    state: SteadyState


def drive(
    rover: SlopeRover,
    soil: SoilSettings,
    field: HeightField,
    path_m: Floats,
    *,
    rim_speed_m_s: float = 0.02,
    step_m: float = 0.05,
    roll_rad: float = 0.0,
    effects: Effects = NO_EFFECTS,
    gravity_m_s2: float = Conditions(0.0).gravity_m_s2,
    bound: float = 1e-5,
    kernel: Kernel = numpy_kernel,
) -> Drive:
    """Return the drive along a path: at each station the rover is in the steady state of the plane under it.

    The rover points so that it travels along the path in spite of its slip angle. Inertia and the differences
    of the ground between its wheels are left out: bends of path and ground must be wider than the rover.

    Args:
        rover: Rover, with three or more wheels that are not in line.
        soil: Soil.
        field: Surface; holds the path with the rover's wheels.
        path_m: Corners of the path (x, y), (N, 2) with N >= 2.
        rim_speed_m_s: r_s omega of all wheels, 1e-4 to 10.
        step_m: Between stations, 1e-3 to 100.
        roll_rad: Roll of the rover against the surface, to its left.
        effects: What acts beyond the paper's model.
        gravity_m_s2: 0.1 to 100.
        bound: On the error of the forces, in parts of F_z: 1e-3, 1e-5 or 1e-8.
        kernel: What computes the forces.

    Raises:
        ModelError: The path leaves the height field, or a number is outside its range.
    """
    check_range("rim_speed_m_s", rim_speed_m_s, "m/s", 1e-4, 10.0)
    check_range("step_m", step_m, "m", 1e-3, 100.0)
    wheel = rover.wheel
    omega = rim_speed_m_s / shearing_radius(wheel.radius_m, wheel.lug_height_m, wheel.shearing_share)

    def standing(place: tuple[float, float], pointing_rad: float) -> Standing:
        plane = _plane(rover, field, place, pointing_rad)
        heading = plane.heading_in_plane(pointing_rad)
        conditions = Conditions(plane.slope_rad, roll_rad, heading, gravity_m_s2)
        state = solve_steady_state(
            rover, soil, conditions, effects=effects, skid=True, bound=bound, kernel=kernel
        )
        return Standing(plane, heading, state)

    stations: list[Station] = []
    t_s, energy_j, crab_rad = 0.0, 0.0, 0.0
    for place, azimuth, distance in _places(path_m, step_m):
        crab_rad, plane, state = _crab(partial(standing, place), azimuth, crab_rad)
        if not state.equilibrium:
            return Drive(tuple(stations), False, state.reason, energy_j)
        speed = rim_speed_m_s * float(speed_ratio(state.slip)) / math.cos(state.slip_angle_rad)
        power = float(state.forces.torque_nm.sum()) * omega
        if stations:
            before = stations[-1]
            climb = math.atan(math.tan(plane.slope_rad) * math.cos(azimuth - plane.uphill_rad))
            step_s = (distance - before.distance_m) / (0.5 * (before.speed_m_s + speed) * math.cos(climb))
            t_s += step_s
            energy_j += 0.5 * (before.power_w + power) * step_s
        x_m, y_m = place
        stations.append(Station(distance, t_s, x_m, y_m, azimuth - crab_rad, plane, state, speed, power))
    return Drive(tuple(stations), True, "", energy_j)


def _crab(
    standing: Callable[[float], Standing], azimuth_rad: float, crab_rad: float
) -> tuple[float, Plane, SteadyState]:
    """Return by how much the rover must point off its path to travel along it, and plane and state there."""
    for _ in range(TURNS):
        plane, heading, state = standing(azimuth_rad - crab_rad)
        if not state.equilibrium:
            break
        travel = plane.azimuth(heading + state.slip_angle_rad)
        error = math.remainder(travel - azimuth_rad, math.tau)
        if abs(error) < SETTLED_RAD:
            break
        crab_rad += error
    return crab_rad, plane, state


def _plane(rover: SlopeRover, field: HeightField, place: tuple[float, float], azimuth_rad: float) -> Plane:
    wheels = np.array(rover.wheel_positions_m)
    cosine, sine = math.cos(azimuth_rad), math.sin(azimuth_rad)
    x = place[0] + cosine * wheels[:, 0] - sine * wheels[:, 1]
    y = place[1] + sine * wheels[:, 0] + cosine * wheels[:, 1]
    return plane_under(field, x, y)


def _places(path_m: Floats, step_m: float) -> list[tuple[tuple[float, float], float, float]]:
    """Return place, azimuth and distance of stations along the path, both ends included."""
    path = np.asarray(path_m, dtype=np.float64)
    if path.ndim != 2 or path.shape[1] != 2 or len(path) < 2 or not np.isfinite(path).all():
        raise ModelError(f"path_m has shape {path.shape}; give two or more finite corners (x, y) in m.")
    legs = np.diff(path, axis=0)
    lengths = np.hypot(legs[:, 0], legs[:, 1])
    if not (lengths > 0.0).all():
        raise ModelError("path_m holds a corner twice in a row; leave one out.")
    corners = np.concatenate([[0.0], np.cumsum(lengths)])
    count = max(round(float(corners[-1]) / step_m), 1)
    stations = []
    for distance in np.linspace(0.0, corners[-1], count + 1).tolist():
        leg = min(int(np.searchsorted(corners, distance, side="right")) - 1, len(legs) - 1)
        x_m, y_m = (path[leg] + (distance - corners[leg]) / lengths[leg] * legs[leg]).tolist()
        stations.append(((x_m, y_m), math.atan2(legs[leg, 1], legs[leg, 0]), distance))
    return stations
