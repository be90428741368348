"""Steady states of a rover on a slope: slip, slip angle and sinkages that balance it (paper 001, IV.B)."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim_backends.arrays import Array
from sim_backends.terramechanics.slope.balance import Balance, kinds_of_wheels
from sim_backends.terramechanics.slope.load_transfer import Demand, demand
from sim_backends.terramechanics.slope.profile import scan
from sim_backends.terramechanics.slope.rover import Conditions, Effects, SlopeRover
from sim_backends.terramechanics.slope.search import ACCEPTED_RESIDUAL, State, first_guess, search
from sim_backends.terramechanics.soil.library import SoilSettings
from sim_backends.terramechanics.soil.numpy_kernel import numpy_kernel
from sim_backends.terramechanics.soil.quadrature import rule_for
from sim_backends.terramechanics.soil.slip import speed_ratio
from sim_backends.terramechanics.soil.wheel_contact import Kernel, wheel_contact
from sim_backends.terramechanics.soil.wheel_forces import WheelForces
from sim_backends.terramechanics.soil.wheel_set import LEAST_SLIP

NO_EFFECTS = Effects()
AT_EDGE = "slip = 0"


@dataclass(frozen=True, slots=True)
class SteadyState:
    """Steady motion of a rover; arrays have one number per wheel, in the order of the rover's wheels.

    Attributes:
        equilibrium: False where no steady state exists; then all numbers are NaN.
        reason: Reason why no steady state exists; else empty.
        boundary: "slip = 0" where the model has excess thrust even without slip, so that the state is on the
            edge of its domain and not a root; else empty.
        slip: Slip ratio at the shearing radius; negative in skid.
        slip_angle_rad: beta, positive to the left (uphill in a traverse).
        sinkage_m: h'_c of each wheel at its middle plane; slip sinkage included.
        forces: Forces on each wheel.
        sinkage_uphill_m: Mean over the wheels to the left of the centre of gravity; NaN where there is none;
            of a rover with one wheel that of the wheel.
        sinkage_downhill_m: Mean over those to the right of it; of a rover with one wheel that of the wheel.
    """

    equilibrium: bool
    reason: str
    boundary: str
    slip: float
    slip_angle_rad: float
    sinkage_m: Array
    forces: WheelForces
    sinkage_uphill_m: float
    sinkage_downhill_m: float


def solve_steady_state(
    rover: SlopeRover,
    soil: SoilSettings,
    conditions: Conditions,
    *,
    effects: Effects = NO_EFFECTS,
    skid: bool = False,
    bound: float = 1e-8,
    kernel: Kernel = numpy_kernel,
) -> SteadyState:
    """Return the steady state of a rover on a slope.

    The wheels share slip ratio and slip angle; each sinks until it bears its load; the sums of F_x and F_y
    hold the rover's weight (paper 001, eq 8). Of several such states it is the one with the least slip. The
    paper's model covers slip only: a rover that would run ahead of its wheels is returned at the model's
    edge, slip 0, and flagged; with `skid` the search continues into skid.

    Args:
        rover: Rover.
        soil: Soil.
        conditions: Slope, roll and heading of the rover.
        effects: Effects beyond the paper's model.
        skid: Allow negative slip ratios, as a descent requires.
        bound: Bound on the error of the forces relative to F_z: 1e-5 or 1e-8.
        kernel: Computes the forces.

    Raises:
        ModelError: A number is outside the model's domain; names parameter, value, unit and range.
    """
    needed = demand(rover, conditions)
    reason = _find_obstacle(needed, soil, conditions)
    if reason:
        return _no_state(reason, len(rover.wheel_positions_m))
    load_n, share, kind = kinds_of_wheels(needed.vertical_n)
    contact = wheel_contact(
        rover.wheel,
        soil,
        camber_rad=conditions.roll_rad,
        cross_slope_rad=conditions.cross_slope_rad,
        gravity_m_s2=conditions.gravity_m_s2,
        sidewall=effects.sidewall,
        slip_sinkage_m=effects.slip_sinkage_m,
    )
    balance = Balance(contact, kernel, conditions, effects, needed, load_n, share)
    state, reason = _find_state(balance, bound, skid=skid)
    if state is None:
        return _no_state(reason, kind.size)
    return _result(rover, balance, state, kind, bound)


def _find_obstacle(needed: Demand, soil: SoilSettings, conditions: Conditions) -> str:
    if conditions.slope_rad >= soil.friction_angle_rad:
        return "the slope is steeper than the soil's angle of friction"
    if not needed.balanced or needed.vertical_n.min() <= 0.0:
        return "the rover tips over: a wheel bears no load"
    return ""


def _find_state(balance: Balance, bound: float, *, skid: bool) -> tuple[State | None, str]:
    """Return the state with the least slip, or None and the reason why there is none."""
    rule = rule_for(bound)
    point = first_guess(balance)
    edge_first = balance.straight and not skid and balance.demand.forward_n <= 0.0
    for _ in range(2):
        state = search(balance, rule, point, edge=edge_first)
        inside = skid or state.point[0] >= abs(state.point[1])
        if not edge_first and state.found and state.stable and inside:
            return state, ""
        if not skid:
            start = state.point if state.found else point
            at_edge = state if edge_first else search(balance, rule, start, edge=True)
            if at_edge.found and at_edge.missing[0] >= 0.0:
                return at_edge, ""
        edge_first = False
        scanned, reason = scan(balance, LEAST_SLIP if skid else 0.0)
        if scanned is None:
            return None, reason
        point = scanned
    return None, "the search did not converge"


def _result(
    rover: SlopeRover, balance: Balance, state: State, kind: NDArray[np.int64], bound: float
) -> SteadyState:
    columns = balance.forces(rule_for(bound), state.point[np.newaxis])[0]
    slips, sides = balance.motion(state.point[np.newaxis])
    sinkage = state.point[2:][kind]
    left = np.array(rover.wheel_positions_m)[:, 1] - rover.cog_lateral_m
    is_rig = left.size == 1
    slip = float(slips[0])
    return SteadyState(
        equilibrium=True,
        reason="",
        boundary=AT_EDGE if abs(state.missing[0]) > ACCEPTED_RESIDUAL else "",
        slip=slip,
        slip_angle_rad=math.atan2(float(sides[0]), float(speed_ratio(slip))),
        sinkage_m=sinkage,
        forces=WheelForces(*(columns[kind, index] for index in range(4))),
        sinkage_uphill_m=_mean(sinkage[(left > 0.0) | is_rig]),
        sinkage_downhill_m=_mean(sinkage[(left < 0.0) | is_rig]),
    )


def _mean(values: Array) -> float:
    return float(values.mean()) if values.size else math.nan


def _no_state(reason: str, wheels: int) -> SteadyState:
    unknown = np.full(wheels, np.nan)
    forces = WheelForces(unknown, unknown, unknown, unknown)
    return SteadyState(False, reason, "", math.nan, math.nan, unknown, forces, math.nan, math.nan)
