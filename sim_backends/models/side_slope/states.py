"""Cached steady states of the side-slope rover: runs under equal conditions share one."""

import math
import sys
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from drivers.errors import ModelError
from sim_backends.terramechanics.slope.balance import Balance, kinds_of_wheels
from sim_backends.terramechanics.slope.load_transfer import demand
from sim_backends.terramechanics.slope.rover import Conditions, Effects, SlopeRover, paper_rover
from sim_backends.terramechanics.slope.search import search
from sim_backends.terramechanics.slope.steady_state import SteadyState, solve_steady_state
from sim_backends.terramechanics.soil.library import ReeceLaw, SoilSettings, load_soil
from sim_backends.terramechanics.soil.quadrature import rule_for
from sim_backends.terramechanics.soil.sidewall import wall_polynomials
from sim_backends.terramechanics.soil.slip import speed_ratio
from sim_backends.terramechanics.soil.wheel_contact import Kernel, WheelContact, wheel_contact

Floats = NDArray[np.float64]

BOUND = 1e-5
"""Error of the forces, in parts of the vertical force; a thousandth of what is measured."""
REMEMBERED = 20_000


class Build(NamedTuple):
    """Parameters of a steady state, in addition to the conditions.

    Attributes:
        friction_angle_deg, shear_modulus_m, k_phi, exponent, exit_share, greatest_stress, wall_friction_deg:
            Of the soil: phi, k, k_phi, n, lambda at slip 0, a_0 and delta of paper 001, Table III.
        radius_m: Of the wheels.
        shearing_m: Radius at which soil is sheared, less that of the wheels.
        slip_sinkage_m: Sinkage per slip ratio.
        cog_lateral_m: Of the centre of gravity, from the middle of the rover towards its left side.
        cog_height_m: Over the surface.
        heading_deg: Of the rover on the slope, counter-clockwise (uphill) from the traverse.
    """

    friction_angle_deg: float
    shear_modulus_m: float
    k_phi: float
    exponent: float
    exit_share: float
    greatest_stress: float
    wall_friction_deg: float
    radius_m: float
    shearing_m: float
    slip_sinkage_m: float
    cog_lateral_m: float
    cog_height_m: float
    heading_deg: float


class Site(NamedTuple):
    """Conditions of a run."""

    slope_deg: float
    roll_deg: float
    mass_kg: float


class State(NamedTuple):
    """Steady motion of the rover; NaN where there is none.

    Attributes:
        forward: Speed of the body along its wheels, over the speed r omega of the rim.
        sideways: Speed to its left, over the same.
        sinkage_up_m, sinkage_down_m: At the middle planes of the wheels uphill and downhill.
        torque_up_nm, torque_down_nm: Of one wheel, mean of front and rear.
    """

    forward: float
    sideways: float
    sinkage_up_m: float
    sinkage_down_m: float
    torque_up_nm: float
    torque_down_nm: float


NOWHERE = State(*(math.nan for _ in State._fields))


class _Near(NamedTuple):
    """A balanced point, to begin a search with; `edge` where the slip is held at 0."""

    point: Floats
    edge: bool


class SlopeStates:
    """Solves and caches steady states.

    A search starts from the last state at the same site with another build, which is close and makes it ten
    times faster. Without one, or if that fails, all states are searched.
    """

    def __init__(self) -> None:
        self._rover: SlopeRover = paper_rover()
        self._soil: SoilSettings = load_soil("toyoura")
        self._kernel: Kernel | None = None
        self._memory: dict[tuple[Build, Site], State] = {}
        self._near: dict[tuple[Site, int], _Near] = {}

    def state(self, build: Build, site: Site) -> State:
        """Return the steady motion at a site."""
        key = (build, site)
        if key not in self._memory:
            if len(self._memory) >= REMEMBERED:
                self._memory.clear()
            self._memory[key] = self._solve(build, site)
        return self._memory[key]

    def _solve(self, build: Build, site: Site) -> State:
        if self._kernel is None:
            self._kernel = _compiled()
        rover, soil = self._changed(build, site)
        conditions = Conditions(
            math.radians(site.slope_deg), math.radians(site.roll_deg), math.radians(build.heading_deg)
        )
        required = demand(rover, conditions)
        if (
            not required.balanced
            or required.vertical_n.min() <= 0.0
            or conditions.slope_rad >= soil.friction_angle_rad
        ):
            return NOWHERE
        load_n, share, kind = kinds_of_wheels(required.vertical_n)
        effects = Effects(slip_sinkage_m=build.slip_sinkage_m)
        place = site, load_n.size
        try:
            contact = self._contact(rover, soil, conditions)._replace(slip_sinkage_m=build.slip_sinkage_m)
            balance = Balance(contact, self._kernel, conditions, effects, required, load_n, share)
            near = _next_to(balance, self._near.get(place))
            if near is None:
                found = solve_steady_state(
                    rover, soil, conditions, effects=effects, bound=BOUND, kernel=self._kernel
                )
                near = _point_of(found, kind) if found.equilibrium else None
        except ModelError:
            return NOWHERE
        if near is None:
            return NOWHERE
        self._near[place] = near
        return _state(balance, near, kind, build)

    def _contact(self, rover: SlopeRover, soil: SoilSettings, conditions: Conditions) -> WheelContact:
        """Return wheel and soil; walls depend on few numbers of the soil, so they are looked up by these."""
        contact = wheel_contact(
            rover.wheel,
            soil,
            camber_rad=conditions.roll_rad,
            cross_slope_rad=conditions.cross_slope_rad,
            sidewall=False,
        )
        alike = self._soil.model_copy(
            update={
                "friction_angle_deg": soil.friction_angle_deg,
                "wall_friction_deg": soil.wall_friction_deg,
            }
        )
        lean, rise = conditions.roll_rad, conditions.cross_slope_rad
        walls = wall_polynomials(alike, lean, rise, conditions.gravity_m_s2, rover.wheel.radius_m)
        return contact._replace(walls=walls)

    def _changed(self, build: Build, site: Site) -> tuple[SlopeRover, SoilSettings]:
        pressure = ReeceLaw(law="reece", k_c=0.0, k_phi=build.k_phi, exponent=build.exponent)
        soil = self._soil.model_copy(
            update={
                "friction_angle_deg": build.friction_angle_deg,
                "shear_modulus_m": build.shear_modulus_m,
                "pressure": pressure,
                "greatest_stress": (build.greatest_stress, self._soil.greatest_stress[1]),
                "exit_polynomial": (build.exit_share, *self._soil.exit_polynomial[1:]),
                "wall_friction_deg": build.wall_friction_deg,
            }
        )
        wheel = self._rover.wheel.model_copy(
            update={
                "radius_m": build.radius_m,
                "lug_height_m": build.shearing_m,
                "shearing_share": 1.0,
            }
        )
        rover = self._rover.model_copy(
            update={
                "mass_kg": site.mass_kg,
                "wheel": wheel,
                "cog_lateral_m": build.cog_lateral_m,
                "cog_height_m": build.cog_height_m,
            }
        )
        return rover, soil


def _next_to(balance: Balance, near: _Near | None) -> _Near | None:
    """Return the balanced point close to another build's, or None where the search must be wider."""
    if near is None:
        return None
    found = search(balance, rule_for(BOUND), near.point, edge=near.edge)
    if near.edge:
        good = found.found and found.missing[0] >= 0.0
    else:
        good = found.found and found.stable and found.point[0] >= abs(found.point[1])
    return _Near(found.point, near.edge) if good else None


def _point_of(found: SteadyState, kind: NDArray[np.int64]) -> _Near:
    side = speed_ratio(found.slip) * math.tan(found.slip_angle_rad)
    root = complex(found.slip, side) ** 0.5
    depths = [found.sinkage_m[int(np.flatnonzero(kind == one)[0])] for one in range(int(kind.max()) + 1)]
    return _Near(np.array([root.real, root.imag, *depths]), bool(found.boundary))


def _state(balance: Balance, near: _Near, kind: NDArray[np.int64], build: Build) -> State:
    # The order of the wheels of a SlopeRover is left front, right front, left rear, right rear.
    columns = balance.forces(rule_for(BOUND), near.point[np.newaxis])[0][kind]
    slips, sides = balance.motion(near.point[np.newaxis])
    depth, torque = near.point[2:][kind], columns[:, 3]
    scale = (build.radius_m + build.shearing_m) / build.radius_m
    return State(
        forward=(1.0 - float(slips[0])) * scale,
        sideways=float(sides[0]) * scale,
        sinkage_up_m=float(depth[0] + depth[2]) / 2.0,
        sinkage_down_m=float(depth[1] + depth[3]) / 2.0,
        torque_up_nm=float(torque[0] + torque[2]) / 2.0,
        torque_down_nm=float(torque[1] + torque[3]) / 2.0,
    )


def _announce(line: str) -> None:
    sys.stderr.write(f"{line}\n")


def _compiled() -> Kernel:
    from sim_backends.terramechanics.soil.compiled import load_compiled

    return load_compiled(_announce)
