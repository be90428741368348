"""Find the field of each motor at a compass from a drive: gyro against compass, over the motor currents.

The compass shows the direction of the earth's field with that of the motors. The gyro gives the yaw up to
start, scale, drift and lag, and the calibration of the compass leaves a deviation; all are fitted together
with two components of the field per ampere of each motor. A prior holds those that the drive does not show,
e.g. of motors that always had the same current. The error is counted on blocks of the drive that the fit did
not see.
"""

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from controllers.estimation.headings.motor_field import GREATEST_SHARE, MotorCurrents, without_motor_field
from controllers.estimation.settings import MotorFields
from controllers.motion.kinematics import make_kinematics
from drivers.errors import LogError
from rover_hil.drives.arrays import Array, Flags, rms, wrap_angles
from rover_hil.drives.drive import Drive
from rover_hil.ready.compass.fit import reference_columns, solve_columns, waves_of
from rover_hil.ready.compass.record import CompassTurns, aligned, read_record
from rover_hil.ready.motors.parameters import MOTOR_FIELD
from rover_hil.recording import schema

LEAST_AGE_S = 0.15
"""Currents are known at least for this time, whatever the age limit of the wheels."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MotorFieldFit:
    """What came out, n headings of m motors.

    Attributes:
        fields: For the configuration.
        reference: What measured the turns, in words.
        t_s: Times of the headings, (n,).
        current_a: Currents at them, (n, m).
        before_deg: Errors of the held-out headings without the currents, counter-clockwise, (n,).
        after_deg: With a fit to the other blocks, (n,).
        largest_deg: Greatest change of the heading by the motors in this drive.
        separate: Whether the drive shows the field of each motor by itself, (m,).
        problem: Why the result must not be used; empty where it may.
    """

    fields: MotorFields
    reference: str
    t_s: Array
    current_a: Array
    before_deg: Array
    after_deg: Array
    largest_deg: float
    separate: Flags
    problem: str


@dataclass(frozen=True, slots=True)
class FieldHeadings:
    """Headings with the currents at them; yaw in rad, near that of the reference."""

    record: CompassTurns
    t_s: Array
    yaw_rad: Array
    current_a: Array


def fit_motor_fields(drive: FieldHeadings, day: str) -> MotorFieldFit:
    """Return the field of each motor at a compass, and the error of its heading with and without.

    Args:
        drive: A drive with stops, in several directions.
        day: Day of the drive, as 2026-01-31.
    """
    everything = np.ones(len(drive.t_s), np.bool_)
    field = _fit(drive, everything, has_motors=True)[0]
    fold = (drive.t_s // MOTOR_FIELD.block_s).astype(int) % MOTOR_FIELD.folds
    before, after = np.zeros(len(drive.t_s)), np.zeros(len(drive.t_s))
    left_out = []
    for number in range(MOTOR_FIELD.folds):
        held = fold == number
        for errors, has_motors in ((before, False), (after, True)):
            motor_field, fit_columns = _fit(drive, ~held, has_motors=has_motors)
            errors[held] = np.degrees(_errors(drive, motor_field, fit_columns)[held])
            if has_motors:
                left_out.append(motor_field)
    scatter = math.sqrt(MOTOR_FIELD.folds - 1) * np.std(left_out, axis=0)
    sd = np.maximum(scatter, _posterior_sd(drive, field))
    record, duration_s = drive.record, drive.t_s[-1] - drive.t_s[0]
    fields = MotorFields(
        source=f"{record.path.name}, {duration_s:.0f} s against the {record.reference}",
        identified_on=day,
        device=drive.record.device,
        per_ampere=_pairs(np.clip(field, -10.0, 10.0)),
        per_ampere_sd=_pairs(np.clip(sd, 0.0, 10.0)),
    )
    ahead_left = drive.current_a @ field
    moved = _without(drive.yaw_rad, ahead_left) - drive.yaw_rad
    return MotorFieldFit(
        fields=fields,
        reference=drive.record.reference,
        t_s=drive.t_s,
        current_a=drive.current_a,
        before_deg=before,
        after_deg=after,
        largest_deg=math.degrees(float(np.nanmax(np.abs(wrap_angles(moved))))),
        separate=_are_separate(drive.current_a),
        problem=_problem(ahead_left, before, after),
    )


def _pairs(values: Array) -> tuple[tuple[float, float], ...]:
    return tuple((round(x, 5), round(y, 5)) for x, y in values.tolist())


def read_motor_drive(path: Path, device: str | None) -> FieldHeadings:
    """Return the headings of a compass with the currents of the motors.

    Args:
        path: The log of a drive.
        device: Name of the compass; None where there is only one.

    Raises:
        ConfigError: The log's configuration has no such compass.
        LogError: The log is damaged, or holds no headings, no turns or no motor currents.
    """
    record = read_record(path, device)
    table = _headings(path, record)
    t_s, yaw, current_a = table[:, 0], table[:, 1], table[:, 2:]
    if current_a.std(axis=0).max() < MOTOR_FIELD.least_current_change_a:
        raise LogError(
            f"log {path}: the currents change by less than {MOTOR_FIELD.least_current_change_a:g} A: drive "
            "with stops, so that the field of the motors shows"
        )
    near = np.interp(t_s, record.t_s, record.yaw_rad)
    if _direction_spread(near, current_a) < MOTOR_FIELD.least_direction_spread:
        raise LogError(
            f"log {path}: the rover drove in one direction only, which shows one component of the field: "
            "drive squares in both senses, with stops"
        )
    return FieldHeadings(record, t_s, aligned(yaw, near), current_a)


def _headings(path: Path, record: CompassTurns) -> Array:
    """Return time, yaw and the currents of the motors at each heading, (n, 2 + m)."""
    drive = Drive(path)
    config = drive.config
    count, wheels = make_kinematics(config.rover).wheel_count, config.roles.wheels
    age_s = max(LEAST_AGE_S, config.devices[wheels].max_age_s or 0.0)
    currents = MotorCurrents(count, config.filter.heading_lag_s, age_s)
    with_current: set[int] = set()
    rows: list[tuple[float, ...]] = []

    def take(t_ns: int, samples: schema.SamplesRecord) -> None:
        for wheel in samples.wheels:
            if wheel.device == wheels:
                currents.take(wheel, t_ns)
                with_current.update({wheel.wheel} if wheel.current_a is not None else ())
        for heading in samples.headings:
            known = currents.at(t_ns) if heading.device == record.device else None
            if known is not None and math.isfinite(heading.heading_rad):
                rows.append(((t_ns - record.start_ns) / 1e9, heading.heading_rad, *known))

    drive.read(take)
    missing = ", ".join(str(wheel) for wheel in range(count) if wheel not in with_current)
    if missing:
        raise LogError(
            f"log {path}: '{wheels}' reports no current of the motors {missing}: without currents the field "
            "of the motors cannot be found; mount the compass away from them, on a mast"
        )
    if len(rows) < MOTOR_FIELD.least_headings:
        raise LogError(
            f"log {path} holds {len(rows)} headings of '{record.device}' with currents, "
            f"{MOTOR_FIELD.least_headings} are needed: drive longer"
        )
    return np.array(rows)


def _direction_spread(yaw_rad: Array, current_a: Array) -> float:
    """Return the share of the currents across their main direction: 0 for one line, 0.5 for a square."""
    directions = np.column_stack((np.cos(yaw_rad), np.sin(yaw_rad)))
    weights = (current_a**2).sum(axis=1)
    return float(np.linalg.eigvalsh((directions.T * weights) @ directions / weights.sum())[0])


def _without(yaw_rad: Array, ahead_left: Array) -> Array:
    """Return the yaw without the field of the motors; NaN where it is too strong."""
    corrected = [
        without_motor_field(yaw, ahead, left)
        for yaw, (ahead, left) in zip(yaw_rad.tolist(), ahead_left.tolist(), strict=True)
    ]
    wrapped = np.array([math.nan if each is None else each for each in corrected])
    near: Array = yaw_rad + wrap_angles(wrapped - yaw_rad)
    return near


def _rest_columns(drive: FieldHeadings) -> Array:
    """Return the columns of reference and deviation.

    The deviation is over the yaw of the reference: over the heading itself it would explain its own errors.
    """
    reference = reference_columns(drive.record, drive.t_s)
    return np.hstack((reference, waves_of(reference[:, 1], MOTOR_FIELD.waves)))


def _fit(drive: FieldHeadings, use: Flags, *, has_motors: bool) -> tuple[Array, Array]:
    """Return the field per ampere of each motor, (m, 2), and the coefficients of reference and deviation."""
    motors = drive.current_a.shape[1]
    field = np.zeros((motors, 2))
    yaw = drive.yaw_rad
    columns = _rest_columns(drive)
    fit_columns = solve_columns(columns[use], yaw[use])
    if not has_motors:
        return field, fit_columns
    for _ in range(MOTOR_FIELD.iterations):
        yaw = _without(drive.yaw_rad, drive.current_a @ field)
        known = use & np.isfinite(yaw)
        if known.sum() < 0.5 * use.sum():
            break  # stronger than the earth's field, which is reported
        noise_rad = max(1e-4, rms(yaw[known] - columns[known] @ solve_columns(columns[known], yaw[known])))
        effect = _effect(drive, yaw)
        prior = noise_rad / MOTOR_FIELD.prior_sd_per_a * np.eye(2 * motors)
        without = np.zeros((2 * motors, columns.shape[1]))
        rows = np.block([[columns[known], effect[known]], [without, prior]])
        values = np.concatenate((yaw[known], -prior @ field.T.ravel()))
        solution = solve_columns(rows, values)
        fit_columns, change = solution[: columns.shape[1]], solution[columns.shape[1] :]
        field = field + change.reshape(2, motors).T
    return field, fit_columns


def _effect(drive: FieldHeadings, yaw_rad: Array) -> Array:
    """Return the change of the shown yaw by the field of each motor ahead, then to the left, (n, 2 m)."""
    cosine, sine = np.cos(yaw_rad)[:, None], np.sin(yaw_rad)[:, None]
    return np.hstack((drive.current_a * cosine, -drive.current_a * sine))


def _posterior_sd(drive: FieldHeadings, field: Array) -> Array:
    """Return what drive and prior leave open, (m, 2); errors within a block count as one.

    They are not independent: most are of the model, e.g. of the damping of the compass.
    """
    yaw = _without(drive.yaw_rad, drive.current_a @ field)
    known = np.isfinite(yaw)
    columns = np.hstack((_rest_columns(drive), _effect(drive, yaw)))[known]
    noise_rad = rms(yaw[known] - columns @ solve_columns(columns, yaw[known]))
    per_block = max(1.0, len(columns) * MOTOR_FIELD.block_s / (drive.t_s[-1] - drive.t_s[0]))
    scale = np.abs(columns).max(axis=0)
    scale[scale == 0.0] = 1.0  # a motor without current: only the prior knows its field
    information = (columns / scale).T @ (columns / scale) / (per_block * noise_rad**2)
    prior = np.zeros(columns.shape[1])
    prior[-field.size :] = 1.0 / (MOTOR_FIELD.prior_sd_per_a * scale[-field.size :]) ** 2
    variance = np.diag(np.linalg.pinv(information + np.diag(prior))) / scale**2
    sd: Array = np.sqrt(variance[-field.size :]).reshape(2, -1).T
    return sd


def _errors(drive: FieldHeadings, field: Array, fit_columns: Array) -> Array:
    """Return the errors of the corrected headings against the reference, rad."""
    yaw = _without(drive.yaw_rad, drive.current_a @ field)
    yaw = np.where(np.isfinite(yaw), yaw, drive.yaw_rad)
    return wrap_angles(yaw - _rest_columns(drive) @ fit_columns)


def _are_separate(current_a: Array) -> Flags:
    """Return which motors had currents that are not a mixture of those of the others."""
    centred = current_a - current_a.mean(axis=0)
    separate = []
    for motor, own in enumerate(centred.T):
        others = np.delete(centred, motor, axis=1)
        unexplained = own - others @ np.linalg.lstsq(others, own, rcond=None)[0] if others.size else own
        separate.append(float(unexplained @ unexplained) > MOTOR_FIELD.least_own_share * float(own @ own))
    return np.array(separate, np.bool_)


def _problem(ahead_left: Array, before_deg: Array, after_deg: Array) -> str:
    strongest = float(np.hypot(*ahead_left.T).max())
    if strongest > GREATEST_SHARE:
        return (
            f"the field of the motors reaches {strongest:.1f} times the earth's: move the compass away from "
            "the motors and their cables"
        )
    if rms(after_deg) > MOTOR_FIELD.greatest_share_of_before * rms(before_deg):
        return (
            f"the motors hardly change the heading: {rms(after_deg):.2f} deg rms on held-out parts with "
            f"their currents, {rms(before_deg):.2f} deg without; no correction is needed"
        )
    if rms(after_deg) > MOTOR_FIELD.greatest_rms_deg:
        return (
            f"the error on held-out parts of the drive is {rms(after_deg):.1f} deg, more than "
            f"{MOTOR_FIELD.greatest_rms_deg:g} deg: calibrate the compass first, away from iron in the floor"
        )
    return ""
