"""The motion of a drive from increments of distance and turn, whose rests show the bias of a gyro."""

import math

import numpy as np

from controllers.motion.kinematics import make_kinematics
from drivers.clock import NANOSECONDS_PER_SECOND
from drivers.errors import LogError
from rover_hil.drives.arrays import Array
from rover_hil.drives.formats.drive import check_straight
from rover_hil.drives.formats.table.columns import (
    SI_PER_UNIT,
    BodyColumns,
    Column,
    IncrementColumns,
    SteeredWheelColumns,
    angle_unit,
    turn_unit,
)
from rover_hil.drives.formats.table.drive_table import DriveTable
from rover_hil.drives.formats.table.gyro_rests import GyroRest, learn_bias
from rover_hil.drives.formats.table.wheels import check_jumps, steering_rad

REST_SHARE = 0.005
"""Speeds below this share of the fast ones are jitter of the encoders."""
LEAST_REST_S = 0.5
"""Shorter stands of a drive by increments are no rests: the rover may still swing."""


def take_increments(source: DriveTable, increments: IncrementColumns) -> None:
    """Take increments of distance and turn; a turn by a gyro is freed of the bias that its rests show."""
    distance, turn = increments.distance, increments.turn
    forward_m = source.increments(distance, SI_PER_UNIT[distance.unit])
    turn_rad = source.increments(turn, angle_unit(turn))
    if increments.turn_by_gyro:
        forward_m, turn_rad = _with_gyro(source, forward_m, turn_rad)
    _take_moves(source, forward_m, np.zeros_like(forward_m), turn_rad, distance)


def _with_gyro(source: DriveTable, forward_m: Array, turn_rad: Array) -> tuple[Array, Array]:
    """Take the turns as readings of a gyro where rests show that it has a bias.

    Returns the increments of the wheels, which then stand in the rests: encoders jitter there, and the
    gyro has its bias. What they count in a rest goes to the row behind it.
    """
    rates = _rates_rad_s(source, turn_rad)
    rests = _rests(source, forward_m)
    if not rests:
        source.drive.notes.append("no rest of half a second: the bias of the gyro is not known")
        return forward_m, turn_rad
    t_s = np.asarray(source.t_ns) / NANOSECONDS_PER_SECOND
    steps = np.diff(np.unique(rates))
    gyro_rests = [
        GyroRest(
            t_s=float(t_s[first:after].mean()),
            mean_rad_s=float(rates[first:after].mean()),
            readings=after - first,
            duration_s=float(t_s[after - 1] - t_s[max(0, first - 1)]),
            squares_rad2_s2=float(rates[first:after].var()) * (after - first),
        )
        for first, after in rests
    ]
    learned = learn_bias(gyro_rests, float(steps.min()) if len(steps) else 0.0, source.rover.filter)
    bias = f"bias of the gyro by {len(rests)} rests {learned.bias_rad_s:+.2g} rad/s, standard deviation "
    bias += f"{learned.sd_rad_s:.2g} rad/s"
    if not learned.is_significant:
        source.drive.notes.append(f"{bias}: it may be none, and is not corrected")
        return forward_m, turn_rad
    source.drive.notes.append(f"{bias}: it is corrected")
    source.drive.filter = learned.filter
    zeros, middles_s = np.zeros_like(rates), [rest.t_s for rest in gyro_rests]
    # Between two rests the mean of a random walk is the straight line.
    rates = rates - np.interp(t_s, middles_s, learned.biases_rad_s)
    source.add("imu", {"rate": np.column_stack((zeros, zeros, rates)).tolist()})
    forward_m, turn_rad = forward_m.copy(), turn_rad.copy()
    for first, after in rests:
        moved_m = float(forward_m[first:after].sum())
        forward_m[first:after] = turn_rad[first:after] = 0.0
        if after < len(forward_m):
            forward_m[after] += moved_m
    return forward_m, turn_rad


def _rests(source: DriveTable, forward_m: Array) -> list[tuple[int, int]]:
    """Return first row and row behind the last of each rest."""
    t_s = np.asarray(source.t_ns) / NANOSECONDS_PER_SECOND
    elapsed_s = np.diff(t_s, prepend=t_s[0])
    speeds = np.abs(forward_m) / np.where(elapsed_s > 0.0, elapsed_s, math.inf)
    is_slow = np.concatenate(([False], speeds < REST_SHARE * np.quantile(speeds, 0.95), [False]))
    edges = np.flatnonzero(np.diff(is_slow.astype(int))).tolist()
    return [
        (first, after)
        for first, after in zip(edges[::2], edges[1::2], strict=True)
        if elapsed_s[first:after].sum() >= LEAST_REST_S
    ]


def _rates_rad_s(source: DriveTable, turns_rad: Array) -> Array:
    """Return the rates at the rows whose integral by the trapezoid rule is that of the turns."""
    elapsed_s = np.diff(np.asarray(source.t_ns)) / NANOSECONDS_PER_SECOND
    means = turns_rad[1:] / np.where(elapsed_s > 0.0, elapsed_s, math.inf)
    return np.concatenate((means[:1], means))


def take_tricycle(source: DriveTable, tricycle: SteeredWheelColumns) -> None:
    """Take the motion of a rolling wheel that leads or follows an axle: no wheel slips sideways."""
    rolled_m = (
        source.increments(tricycle.step, turn_unit(tricycle.step, tricycle.radius_m)) * tricycle.radius_m
    )
    if tricycle.steering_step is not None:
        column = tricycle.steering_step
        steered_rad = np.cumsum(source.numbers(column, is_needed=True)) * angle_unit(column) / column.ratio
    else:
        assert tricycle.steering is not None  # noqa: S101 the model has checked it
        steered_rad = steering_rad(source, tricycle.steering, is_needed=True)
    # In the middle of the step, where the wheel pointed on average.
    middle_rad = steered_rad - 0.5 * np.diff(steered_rad, prepend=steered_rad[0])
    forward_m = rolled_m * np.cos(middle_rad)
    turn_rad = rolled_m * np.sin(middle_rad) / tricycle.wheelbase_m
    _take_moves(source, forward_m, np.zeros_like(forward_m), turn_rad, tricycle.step)


def take_body(source: DriveTable, body: BodyColumns) -> None:
    """Take the motion of a body with known speeds: they go evenly from each measured one to the next.

    Raises:
        LogError: No row holds both speed and yaw rate.
    """
    columns = (body.speed, body.speed_y, body.yaw_rate)
    zeros = np.zeros(len(source.t_ns))
    rates = [
        zeros if column is None else source.numbers(column) * SI_PER_UNIT[column.unit] for column in columns
    ]
    known = np.flatnonzero(np.isfinite(np.sum(rates, axis=0)))
    if not known.size:
        raise LogError(f"{source.table.path}: no row holds both a speed and a yaw rate: name other columns")
    elapsed_s = np.diff(np.asarray(source.t_ns)[known]) / NANOSECONDS_PER_SECOND
    moves = np.zeros((3, len(source.t_ns)))
    for move, rate in zip(moves, rates, strict=True):
        move[known[1:]] = 0.5 * (rate[known][1:] + rate[known][:-1]) * elapsed_s
    x_m, y_m, turn_rad = moves
    _take_moves(source, x_m, y_m, turn_rad, body.speed)


def _take_moves(source: DriveTable, x_m: Array, y_m: Array, turn_rad: Array, column: Column) -> None:
    kinematics = make_kinematics(source.rover.rover)
    check_straight(kinematics, source.table.path)
    # What the first row holds was driven before the drive begins.
    for values in (x_m, y_m, turn_rad):
        values[0] = 0.0
    moves = zip(x_m.tolist(), y_m.tolist(), turn_rad.tolist(), strict=True)
    turned_rad = np.cumsum([kinematics.wheel_speeds(*move) for move in moves], axis=0)
    for place, angles_rad in enumerate(turned_rad.T):
        check_jumps(source, place, angles_rad, source.name_of(source.table, column))
    source.drive.notes.append(
        "the wheels get the angles that give this path: identify neither slip nor motors with them"
    )
    source.add("increments", {"move": np.column_stack((x_m, y_m, turn_rad)).tolist()})
