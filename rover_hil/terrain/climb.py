"""Slopes that a rover can climb and descend: by its steady states, and by wheels measured in paper 002."""

import math
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

from rover_hil.terrain.table import Cell, Table, number
from sim_backends.terramechanics.slope.rover import Conditions, SlopeRover
from sim_backends.terramechanics.slope.steady_state import SteadyState, solve_steady_state
from sim_backends.terramechanics.soil.library import SoilSettings
from sim_backends.terramechanics.soil.slip_skid_model import shipped_wheels, slip_ratio_on_slope, slope_rad
from sim_backends.terramechanics.soil.wheel_contact import Kernel

UPHILL_RAD = math.pi / 2.0
STEEPEST_DEG = 45.0
LEAST_SLIP = -0.99
LOCKED = -1.0
BISECTIONS = 13
"""From 45 deg down to 0.006 deg."""
SLOPE_COLUMNS = ("slope_deg", "slip_up", "sinkage_up_m", "slip_down", "sinkage_down_m", "reason")
LIMIT_COLUMNS = ("what", "climbable_deg", "descendable_deg", "reason")
NOT_ON_LINE = "no slip ratio from -1 to 1 on the measured line"
SolveSlope = Callable[[float, bool], SteadyState]


class SlopeRow(NamedTuple):
    """Steady states straight up and straight down one slope; None where there is none.

    Attributes:
        slope_deg: Of the surface.
        slip_up: Slip ratio of the climb.
        sinkage_up_m: Greatest of the wheels in the climb.
        slip_down: Slip ratio of the descent, negative in skid.
        sinkage_down_m: Greatest of the wheels in the descent.
        reason: Why there is no steady state up or down; else empty.
    """

    slope_deg: float
    slip_up: float | None
    sinkage_up_m: float | None
    slip_down: float | None
    sinkage_down_m: float | None
    reason: str


class Limit(NamedTuple):
    """The steepest slope with a steady state.

    Attributes:
        slope_deg: None where not even level ground has one.
        reason: What ends it; empty where it is `STEEPEST_DEG`, or more.
    """

    slope_deg: float | None
    reason: str


def slope_solver(rover: SlopeRover, soil: SoilSettings, kernel: Kernel) -> SolveSlope:
    """Return a function that solves for a slope, deg, up (True) or down (False), wheels parallel to it."""

    def solve(slope_deg: float, up: bool) -> SteadyState:
        conditions = Conditions(
            slope_rad=math.radians(slope_deg), heading_rad=UPHILL_RAD if up else -UPHILL_RAD
        )
        return solve_steady_state(rover, soil, conditions, skid=True, kernel=kernel)

    return solve


def solve_slopes(solve: SolveSlope, slopes_deg: Sequence[float]) -> Iterator[SlopeRow]:
    """Yield climb and descent of each slope."""
    for slope_deg in slopes_deg:
        up, down = solve(slope_deg, True), solve(slope_deg, False)
        yield SlopeRow(
            slope_deg,
            number(up.slip),
            number(float(up.sinkage_m.max())),
            number(down.slip),
            number(float(down.sinkage_m.max())),
            _reasons(up.reason, down.reason),
        )


def find_limit(solve: SolveSlope, slip_limit: float, *, up: bool) -> Limit:
    """Return the steepest slope with a steady state within a slip limit.

    Args:
        solve: From `slope_solver`.
        slip_limit: Greatest slip ratio of a climb, or least (negative) of a descent.
        up: Climb or descent.
    """

    def obstacle(slope_deg: float) -> str:
        """Return why a slope is none; empty where it is one."""
        state = solve(slope_deg, up)
        if not state.equilibrium:
            return state.reason
        is_within = state.slip <= slip_limit if up else state.slip >= slip_limit
        return "" if is_within else f"the slip ratio passes {slip_limit:g}"

    reason = obstacle(STEEPEST_DEG)
    if not reason:
        return Limit(STEEPEST_DEG, "")
    if on_level := obstacle(0.0):
        return Limit(None, f"on level ground already {on_level}")
    low, high = 0.0, STEEPEST_DEG
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        at_middle = obstacle(middle)
        low, high = (low, middle) if at_middle else (middle, high)
        reason = at_middle or reason
    return Limit(low, reason)


def slopes_table(rows: Sequence[SlopeRow]) -> Table:
    """Return the slopes as a table."""
    return Table("slopes", "Straight up and down a slope", SLOPE_COLUMNS, list(rows))


def limits_table(solve: SolveSlope, slip_limit: float) -> Table:
    """Return the steepest slopes of the rover, and of paper 002's wheels by their measured lines (eq 15).

    Args:
        solve: From `slope_solver`.
        slip_limit: Greatest slip ratio of a climb, more than 0 to 1; a descent may go to the locked wheel.
    """
    up, down = find_limit(solve, slip_limit, up=True), find_limit(solve, LEAST_SLIP, up=False)
    reason = _reasons(up.reason, down.reason)
    rows: list[tuple[Cell, ...]] = [("rover, steady state", up.slope_deg, down.slope_deg, reason)]
    for name, wheel in shipped_wheels().items():
        climbed, descended = slope_rad(wheel, [slip_limit, LOCKED])
        rows.append((f"{name}, measured lines", math.degrees(climbed), -math.degrees(descended), ""))
    return Table("limits", f"Steepest slopes, climbs with slip up to {slip_limit:g}", LIMIT_COLUMNS, rows)


def measured_table(slopes_deg: Sequence[float]) -> Table:
    """Return slip up and down each slope of paper 002's wheels by their measured lines (eqs 14, 21)."""
    wheels = shipped_wheels()
    columns = tuple(f"{name}_slip_{way}" for name in wheels for way in ("up", "down"))
    rows: list[tuple[Cell, ...]] = []
    for slope_deg in slopes_deg:
        angle = math.radians(slope_deg)
        slips = [slip_ratio_on_slope(wheel, sign * angle) for wheel in wheels.values() for sign in (1, -1)]
        rows.append((slope_deg, *slips, NOT_ON_LINE if None in slips else ""))
    return Table(
        "measured_wheels",
        "The same by the measured lines of paper 002",
        ("slope_deg", *columns, "reason"),
        rows,
    )


def _reasons(up: str, down: str) -> str:
    """Return why there is no steady state up and down in one text."""
    if up == down:
        return up
    return "; ".join(f"{way}: {reason}" for way, reason in (("up", up), ("down", down)) if reason)
