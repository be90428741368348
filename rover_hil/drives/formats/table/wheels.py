"""Angles, speeds and currents of the wheels of a drive, from the columns of a table."""

import math
from collections.abc import Sequence

import numpy as np

from controllers.motion.kinematics import Kinematics, make_kinematics
from controllers.motion.rover_geometry import RoverSettings, WheelsRoverSettings
from drivers.clock import NANOSECONDS_PER_SECOND
from drivers.errors import LogError
from rover_hil.drives.arrays import Array
from rover_hil.drives.formats.drive import check_steering
from rover_hil.drives.formats.rosbag.joints import REGULAR, Steps
from rover_hil.drives.formats.table.columns import (
    LENGTHS,
    SI_PER_UNIT,
    SpeedColumn,
    SteeringColumn,
    TurnColumn,
    WheelColumns,
    angle_unit,
    turn_unit,
)
from rover_hil.drives.formats.table.drive_table import DriveTable
from rover_hil.drives.quality.oddities import NO_FAULT, REPAIRED, Oddity

LEAST_WRAP = 256
"""Fewer ticks are no counter."""
MOST_JUMPS = 0.02
"""Share of the rows in which a wheel may turn faster than the limits say: chosen by hand, as for a bag."""


def take_wheels(source: DriveTable, wheels: Sequence[WheelColumns]) -> None:
    """Take what is measured of each wheel.

    Raises:
        LogError: The columns do not fit the rover, or a wheel is faster than it can be.
    """
    radii_m = _radii_m(source.rover.rover)
    kinematics = make_kinematics(source.rover.rover)
    wheels = _with_unmeasured(wheels, kinematics)
    if len(wheels) != len(radii_m):
        raise LogError(
            f"the file of columns has {len(wheels)} [[wheel]], but the rover {len(radii_m)} wheels: give "
            "one for each, in the rover's order; only wheels with measured = false that do not steer may be "
            "left out"
        )
    for place, wheel in enumerate(wheels):
        is_given = not (wheel.position is None and wheel.step is None and wheel.speed is None)
        if is_given == (place in kinematics.unmeasured):
            has = "is not measured by [rover], but has a column: correct one of them"
            lacks = "has neither position nor step nor speed: add one, or measured = false in [rover]"
            raise LogError(f"{source.table.path}: wheel {place} {has if is_given else lacks}")
    steered = [place for place, wheel in enumerate(wheels) if wheel.steering is not None]
    check_steering(kinematics, steered, source.table.path, "add steering to its [[wheel]]")
    none = np.full(len(source.t_ns), math.nan)
    quantities: dict[str, list[Array]] = {}
    for place, (wheel, radius_m) in enumerate(zip(wheels, radii_m, strict=True)):
        measured = {
            "Position": _angles_rad(source, place, wheel, radius_m),
            "Speed": None if wheel.speed is None else _speeds_rad_s(source, place, wheel.speed, radius_m),
            "Current": None
            if wheel.current is None
            else source.numbers(wheel.current) * SI_PER_UNIT[wheel.current.unit],
            "Steering": None if wheel.steering is None else steering_rad(source, wheel.steering),
        }
        for quantity, values in measured.items():
            quantities.setdefault(quantity, []).append(none if values is None else values)
    given = {name: rows for name, rows in quantities.items() if not all(row is none for row in rows)}
    source.drive.quantities = tuple(dict.fromkeys(("Position", *given)))
    stacks = {name: np.column_stack(rows) for name, rows in given.items()}
    held = np.any([np.isfinite(stack).any(axis=1) for stack in stacks.values()], axis=0)
    source.add("wheels", {name: stack.tolist() for name, stack in stacks.items()}, held)


def _with_unmeasured(wheels: Sequence[WheelColumns], kinematics: Kinematics) -> Sequence[WheelColumns]:
    """Return a [[wheel]] for each wheel, where those of which nothing is measured were left out."""
    rates = kinematics.steering_rates_rad_s or (0.0,) * kinematics.wheel_count
    named = [place for place, rate in enumerate(rates) if rate > 0.0 or place not in kinematics.unmeasured]
    if len(wheels) != len(named):
        return wheels
    given = dict(zip(named, wheels, strict=True))
    return [given.get(place, WheelColumns()) for place in range(kinematics.wheel_count)]


def _angles_rad(source: DriveTable, place: int, wheel: WheelColumns, radius_m: float) -> Array | None:
    """Return how far a wheel has turned in every row, NaN where that is not known."""
    column = wheel.step or wheel.position
    if column is None:
        if wheel.speed is None:
            return None
        source.drive.notes.append(f"wheel {place}: no angles, its speeds are integrated")
        return None
    unit = turn_unit(column, radius_m)
    if wheel.step is not None:
        turned = np.cumsum(source.numbers(column, is_needed=True)) * unit
    else:
        turned = _unwrapped(source, place, column, unit)
    check_jumps(source, place, turned, source.name_of(source.table, column))
    return turned


def _unwrapped(source: DriveTable, place: int, column: TurnColumn, unit: float) -> Array:
    values = source.numbers(column)
    known = np.flatnonzero(np.isfinite(values))
    if len(known) < 2:
        return values * unit
    steps = np.diff(values[known])
    wrap = column.wrap or _certain_wrap(source, place, column, values[known])
    if wrap is None:
        return values * unit
    limit = source.rover.limits.wheel_speed_rad_s / abs(unit)
    elapsed_s = np.diff(np.asarray(source.t_ns)[known]) / NANOSECONDS_PER_SECOND
    if not Steps(elapsed_s, steps, float(np.ptp(values[known])), limit).are_counted(wrap):
        name = source.name_of(source.table, column)
        raise LogError(
            f"{source.table.path}, column '{name}': it wraps after {wrap:g}, and the wheel may "
            "turn by more than half of that between two rows at limits.wheel_speed_rad_s = "
            f"{source.rover.limits.wheel_speed_rad_s:g}: "
            "lower that limit if the wheels are slower, or record faster"
        )
    steps = steps - wrap * np.round(steps / wrap)
    values[known] = values[known[0]] + np.concatenate(([0.0], np.cumsum(steps)))
    return values * unit


def _certain_wrap(source: DriveTable, place: int, column: TurnColumn, values: Array) -> float | None:
    """Return the range of a counter that starts again, where it is certain; None else.

    Whole numbers jump by one power of two, at least twice, always to the other end, and the wheel goes on
    in between.
    """
    steps = np.diff(values)
    extent = float(np.ptp(values))
    if column.unit != "ticks" or extent < LEAST_WRAP / 2 or (values != np.round(values)).any():
        return None
    wrap = 2.0 ** math.ceil(math.log2(extent + 1.0))
    far = np.abs(steps) > 0.5 * wrap
    turned = np.abs(steps - wrap * np.round(steps / wrap))
    usual = float(np.quantile(turned[~far], 0.99)) if (~far).any() else math.inf
    if far.sum() < 2 or (turned[far] > REGULAR * usual + 1.0).any() or usual > 0.1 * wrap:
        return None
    source.drive.oddities.append(
        Oddity(
            what=f"the counter starts again after {wrap:.0f}",
            where=f"wheel {place}",
            count=int(far.sum()),
            done=REPAIRED,
        )
    )
    return wrap


def check_jumps(source: DriveTable, place: int, turned_rad: Array, name: str) -> None:
    """Check that a wheel is not faster than it can be, which a wrong unit or an unknown wrap makes it.

    Raises:
        LogError: It is, often.
    """
    known = np.flatnonzero(np.isfinite(turned_rad))
    elapsed_s = np.diff(np.asarray(source.t_ns)[known]) / NANOSECONDS_PER_SECOND
    limit_rad_s = source.rover.limits.wheel_speed_rad_s
    # Rows come late by up to a period: the wheel may have turned since long before.
    slack_s = 2.0 * float(np.median(elapsed_s)) if len(elapsed_s) else 0.0
    fast = np.abs(np.diff(turned_rad[known])) > limit_rad_s * (elapsed_s + slack_s)
    if not fast.any():
        return
    rows = np.flatnonzero(source.used)[known[1:][fast]]
    where = source.table.where(int(rows[0]))
    if fast.sum() > max(3.0, MOST_JUMPS * len(fast)):
        raise LogError(
            f"{where}, column '{name}': wheel {place} turns faster than limits.wheel_speed_rad_s = "
            f"{limit_rad_s:g} there and in {int(fast.sum())} rows in all: correct the unit, "
            "ticks_per_turn or gear_ratio, give the wrap, or raise that limit"
        )
    what = f"the angle jumps by more than the wheel can turn, first in {where}"
    source.drive.oddities.append(
        Oddity(what=what, where=f"wheel {place}", count=int(fast.sum()), done=NO_FAULT)
    )


def _speeds_rad_s(source: DriveTable, place: int, column: SpeedColumn, radius_m: float) -> Array:
    """Return the speed of a wheel.

    Raises:
        LogError: It is often faster than it can be.
    """
    unit = SI_PER_UNIT[column.unit] / (radius_m if column.unit in LENGTHS else column.gear_ratio)
    speeds = source.numbers(column) * unit
    limit_rad_s = source.rover.limits.wheel_speed_rad_s
    fast = np.flatnonzero(np.abs(speeds) > limit_rad_s)
    if fast.size > max(3.0, MOST_JUMPS * np.isfinite(speeds).sum()):
        where = source.table.where(int(np.flatnonzero(source.used)[fast[0]]))
        raise LogError(
            f"{where}, column '{source.name_of(source.table, column)}': wheel {place} turns faster than "
            f"limits.wheel_speed_rad_s = {limit_rad_s:g} there and in {fast.size} rows in all: correct "
            "the unit or gear_ratio, or raise that limit"
        )
    return speeds


def steering_rad(source: DriveTable, column: SteeringColumn, *, is_needed: bool = False) -> Array:
    """Return the steering angles of a wheel in all rows, NaN where they are not measured."""
    values = source.numbers(column, is_needed=is_needed) - column.sign * column.zero
    known = np.isfinite(values)
    if column.wrap is not None and known.any():
        half = 0.5 * column.wrap
        first = (values[known][0] + half) % column.wrap - half
        turned = np.concatenate(([first], values[known][1:]))
        values[known] = np.unwrap(turned, period=column.wrap)
    return values * (angle_unit(column) / column.ratio)


def _radii_m(rover: RoverSettings) -> list[float]:
    """Return the radius of each wheel, in the rover's order."""
    if isinstance(rover, WheelsRoverSettings):
        return [wheel.radius_m for wheel in rover.wheels]
    return [rover.wheel_radius_m] * (3 if rover.kinematics == "omni3" else 4)
