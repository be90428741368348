"""Fit the calibration of a compass to turns, and judge it on turns that the fit did not see.

The reference (a gyro, else the wheels) gives the turns up to four unknowns: start, scale, drift and the lag
of the compass. They are fitted together with the deviation, by least squares on the other turns. The
constant part of the heading cannot be seen in turns; the filter estimates it while driving
(docs/decisions/0004), so the error of a held-out turn is counted without its mean.
"""

import datetime as dt
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from drivers.angles import compass_deg_from_yaw
from drivers.driver import Codec
from drivers.errors import LogError, ModelError
from drivers.heading_calibration import DeviationTable, MagnetometerCalibration, Vector, fit_magnetometer
from drivers.link import Received
from drivers.mounting import Mounting
from drivers.nmea_compass.codec import NmeaCompassCodec
from drivers.samples import HeadingReference, HeadingSample
from drivers.witmotion.codec import MagneticReader, WitMotionCodec
from drivers.witmotion.settings import WitMotionSettings
from rover_hil.drives.arrays import Array, Flags, rms, wrap_angles
from rover_hil.ready.compass.parameters import COMPASS_FIT
from rover_hil.ready.compass.record import CompassSettings, CompassTurns, aligned

Calibration = DeviationTable | MagnetometerCalibration

AXES: tuple[Vector, ...] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


@dataclass(frozen=True, slots=True, kw_only=True)
class CompassFit:
    """What came out.

    Attributes:
        calibration: Fitted to all turns; None where nothing could be fitted.
        heading_deg: Compass headings of the held-out readings by the reference, (n,).
        error_deg: Their errors with a calibration that did not see their turn, clockwise, (n,).
        before_deg: Errors without a calibration, clockwise, at `before_heading_deg`; the drift of the
            reference is taken out where a calibration could be fitted.
        before_heading_deg: Compass headings of these.
        turns: Number of whole turns that were used.
        covered: Share of the directions, 0 to 1.
        raw_counts: Readings of a magnetometer, (m, 3); empty for a compass.
        strength_counts: Horizontal field after calibration; 0 for a compass.
        lag_s: Lag of the compass against the reference.
        scale: Turns of the reference over those of the compass, less one.
        problem: Why the result must not be used; empty where it may.
    """

    calibration: Calibration | None
    heading_deg: Array
    error_deg: Array
    before_heading_deg: Array
    before_deg: Array
    turns: int
    covered: float
    raw_counts: Array
    strength_counts: float
    lag_s: float
    scale: float
    problem: str

    @property
    def rms_deg(self) -> float:
        """Root mean square of the error on held-out turns."""
        return rms(self.error_deg) if self.error_deg.size else math.nan

    @property
    def before_rms_deg(self) -> float:
        """The same without a calibration."""
        return rms(self.before_deg) if self.before_deg.size else math.nan


@dataclass(frozen=True, slots=True)
class _Headings:
    """Headings of a compass: times, yaw in rad, number of the turn."""

    t_s: Array
    yaw_rad: Array
    turn: Array


def fit_compass(record: CompassTurns, date: dt.date, dip_deg: float | None = None) -> CompassFit:
    """Return the calibration of a compass and its error on held-out turns.

    Args:
        record: Turns of the compass.
        date: Day of the turns, for the calibration.
        dip_deg: Angle of the earth's field below the horizontal at this place. Turns on level ground do not
            show it; without it a magnetometer is not compensated for tilt.

    Raises:
        LogError: The compass sent no headings or no magnetic readings.
    """
    source = f"{record.path.name}, {record.turns:.1f} turns against the {record.reference}"
    if isinstance(record.settings, WitMotionSettings):
        return _fit_magnetometer(record, record.settings, source, date, dip_deg)
    return _fit_deviation(record, source, date)


def _fit_magnetometer(
    record: CompassTurns, settings: WitMotionSettings, source: str, date: dt.date, dip_deg: float | None
) -> CompassFit:
    mounting = settings.make_mounting(settings.yaw_zero_deg)
    reader = MagneticReader(mounting)
    for payload in record.payloads:
        reader.decode(payload)
    if not reader.readings:
        raise LogError(
            f"log {record.path}: '{record.device}' did not send both attitude (0x53) and magnetic frames "
            "(0x54): switch these outputs on with the manufacturer's program, at the rate of the others"
        )
    t_s = np.array([(t_ns - record.start_ns) / 1e9 for t_ns, *_ in reader.readings])
    raw = np.array([words for _, words, _ in reader.readings], np.float64)
    tilt = np.array([tilt for *_, tilt in reader.readings])
    turn = record.turn_of(t_s)
    folds = _folds(turn)
    before = _headings(record, None)

    def headings(calibration: MagnetometerCalibration) -> _Headings:
        yaw = _level_yaw(mounting, calibration, raw, tilt)
        return _Headings(t_s, aligned(yaw, np.interp(t_s, record.t_s, record.yaw_rad)), turn)

    def fit(use: Flags) -> MagnetometerCalibration:
        try:
            return fit_magnetometer(raw[use], source=source, date=date)
        except ModelError:
            flat = fit_magnetometer(raw[use], source=source, date=date, planar=True)
        flat = _with_vertical(flat, raw[use], dip_deg)
        return flat if dip_deg is not None else _refined_vertical(record, flat, headings, use)

    try:
        final = fit(np.ones(len(raw), np.bool_))
        held_out = [_judge(record, headings(fit(turn != fold)), fold) for fold in folds]
    except ModelError as error:
        return _nothing(record, before, folds, raw, str(error).removeprefix("fit_magnetometer: "))
    field = np.array([final.apply((x, y, z)) for x, y, z in raw.tolist()])
    strength = float(np.median(np.hypot(*field.T[:2])))
    return _result(record, final, _headings(record, final), before, folds, held_out, raw, strength)


def _level_yaw(mounting: Mounting, calibration: MagnetometerCalibration, raw: Array, tilt: Array) -> Array:
    """Return the yaw in rad as the driver computes it, for all readings at once."""
    to_rover = np.array([mounting.vector_to_rover(axis) for axis in AXES])
    field = (raw - np.array(calibration.hard_iron_counts)) @ np.array(calibration.soft_iron).T
    x, y, z = (field @ to_rover).T
    roll, pitch = tilt.T
    level_y = np.cos(roll) * y - np.sin(roll) * z
    level_x = np.cos(pitch) * x + np.sin(pitch) * (np.sin(roll) * y + np.cos(roll) * z)
    yaw: Array = np.arctan2(level_x, level_y)
    return yaw


def _with_vertical(
    flat: MagnetometerCalibration, raw: Array, dip_deg: float | None
) -> MagnetometerCalibration:
    """Return the calibration with the vertical axis shifted to the field that the dip gives, or to none.

    Left as it is, the rover's magnetism along z would count as the earth's as soon as the rover tilts.
    """
    field = np.array([flat.apply((x, y, z)) for x, y, z in raw.tolist()])
    level = float(np.median(np.hypot(*field.T[:2])))
    down = 0.0 if dip_deg is None else level * math.tan(math.radians(dip_deg))
    x, y, _ = flat.hard_iron_counts
    return flat.model_copy(update={"hard_iron_counts": (x, y, float(raw[:, 2].mean()) + down)})


def _refined_vertical(
    record: CompassTurns,
    flat: MagnetometerCalibration,
    headings: Callable[[MagnetometerCalibration], _Headings],
    use: Flags,
) -> MagnetometerCalibration:
    """Return the calibration with the vertical axis that fits the turns best, where tilts show it.

    Small tilts of the rover mix the vertical field into the heading; one step of a linear least squares, as
    the heading is linear in the vertical field at small tilts.
    """
    x, y, z = flat.hard_iron_counts

    def shifted(by: float) -> MagnetometerCalibration:
        return flat.model_copy(update={"hard_iron_counts": (x, y, z + by)})

    step = COMPASS_FIT.vertical_step_counts
    base = headings(flat)
    slope = wrap_angles(headings(shifted(step)).yaw_rad - headings(shifted(-step)).yaw_rad) / (2.0 * step)
    columns = np.column_stack((reference_columns(record, base.t_s), slope))[use]
    values = base.yaw_rad[use]
    solution = solve_columns(columns, values)
    residuals = values - columns @ solution
    others = columns[:, :4]
    own = columns[:, 4] - others @ solve_columns(others, columns[:, 4])
    sd = rms(residuals) / math.sqrt(max(float(own @ own), 1e-30))
    # Consecutive readings tilt together: the noise is not white over the column.
    is_seen = abs(solution[4]) > COMPASS_FIT.vertical_sds * sd
    return shifted(-float(solution[4])) if is_seen else flat


def _fit_deviation(record: CompassTurns, source: str, date: dt.date) -> CompassFit:
    headings = _headings(record, None)
    if not len(headings.t_s):
        raise LogError(
            f"log {record.path}: '{record.device}' sent no magnetic headings (HDG or HDM): "
            "only these have a deviation"
        )
    harmonics = _deviation_and_lag(record, headings, 2)[1]
    lag_s = harmonics if harmonics > COMPASS_FIT.least_lag_s else 0.0
    record = _damped(record, lag_s)
    folds = _folds(headings.turn)
    best: tuple[float, int, list[tuple[Array, Array]]] | None = None
    for waves in range(COMPASS_FIT.most_harmonics + 1) if folds else ():
        held_out = []
        for fold in folds:
            coefficients = _deviation(record, headings, headings.turn != fold, waves)
            corrected = _Headings(
                headings.t_s,
                headings.yaw_rad - waves_of(headings.yaw_rad, waves) @ coefficients,
                headings.turn,
            )
            held_out.append(_judge(record, corrected, fold))
        error = rms(np.concatenate([error for _, error in held_out]))
        if best is None or error < 0.98 * best[0]:  # one wave more must be worth it
            best = (error, waves, held_out)
    if best is None:
        return _nothing(record, headings, folds, np.zeros((0, 3)), "")
    _, waves, held_out = best
    coefficients = _deviation(record, headings, np.ones(len(headings.t_s), np.bool_), waves)
    entries = np.arange(0, 360, COMPASS_FIT.table_step_deg)
    # A deviation is added to a clockwise heading, so its sign is that of the error of the yaw.
    deviation_deg = np.degrees(waves_of(np.radians(90.0 - entries), waves) @ coefficients)
    if np.abs(deviation_deg).max(initial=0.0) > 90.0:
        return _nothing(record, headings, folds, np.zeros((0, 3)), "the deviation exceeds 90 deg")
    table = DeviationTable.model_validate(
        {
            "source": source,
            "date": date,
            "heading_deg": entries.astype(float).tolist(),
            "deviation_deg": np.round(deviation_deg, 2).tolist(),
        }
    )
    after = _headings(record, table)
    result = _result(record, table, after, headings, folds, held_out, np.zeros((0, 3)), 0.0)
    return replace(result, lag_s=result.lag_s + lag_s)


def _deviation_and_lag(record: CompassTurns, headings: _Headings, waves: int) -> tuple[Array, float]:
    columns = np.hstack((reference_columns(record, headings.t_s), waves_of(headings.yaw_rad, waves)))
    solution = solve_columns(columns, headings.yaw_rad)
    return solution[4:], float(solution[3])


def _damped(record: CompassTurns, lag_s: float) -> CompassTurns:
    """Return the record with a reference that is damped as the compass is, to first order."""
    if not lag_s:
        return record
    keep = np.exp(-np.diff(record.t_s) / lag_s)
    damped = [float(record.yaw_rad[0])]
    for share, yaw in zip(keep.tolist(), record.yaw_rad[1:].tolist(), strict=True):
        damped.append(share * damped[-1] + (1.0 - share) * yaw)
    yaw_rad = np.array(damped)
    return replace(record, yaw_rad=yaw_rad, rate_rad_s=np.gradient(yaw_rad, record.t_s))


def _headings(record: CompassTurns, calibration: Calibration | None) -> _Headings:
    """Return the magnetic headings that the driver gives with a calibration."""
    codec = _codec(record.settings, calibration)
    headings = [
        ((sample.t_ns - record.start_ns) / 1e9, sample.heading_rad)
        for payload in record.payloads
        for sample in codec.decode(Received(payload.t_ns, payload.payload))
        if isinstance(sample, HeadingSample) and sample.reference is HeadingReference.MAGNETIC
    ]
    table = np.array(headings).reshape(-1, 2)
    inside = (table[:, 0] >= record.t_s[0]) & (table[:, 0] <= record.t_s[-1])
    t_s, yaw_rad = table[inside].T
    near = np.interp(t_s, record.t_s, record.yaw_rad)
    return _Headings(t_s, aligned(yaw_rad, near) if len(t_s) else yaw_rad, record.turn_of(t_s))


def _codec(settings: CompassSettings, calibration: Calibration | None) -> Codec[bytes]:
    if isinstance(settings, WitMotionSettings):
        return WitMotionCodec(
            "",
            settings.make_mounting(settings.yaw_zero_deg),
            calibration if isinstance(calibration, MagnetometerCalibration) else None,
        )
    table = calibration if isinstance(calibration, DeviationTable) else None
    return NmeaCompassCodec("", require_checksum=settings.require_checksum, deviation_table=table)


def _folds(turn: Array) -> list[float]:
    """Return the turns with enough readings; the last one may be cut off."""
    numbers, counts = np.unique(turn, return_counts=True)
    return [float(each) for each in numbers[counts >= COMPASS_FIT.least_readings_per_turn]]


def reference_columns(record: CompassTurns, t_s: Array) -> Array:
    """Return the columns of the reference: start, yaw, drift, lag; shape (n, 4)."""
    yaw = np.interp(t_s, record.t_s, record.yaw_rad)
    rate = np.interp(t_s, record.t_s, record.rate_rad_s)
    return np.column_stack((np.ones(len(t_s)), yaw, t_s, -rate))


def solve_columns(columns: Array, values: Array) -> Array:
    """Return the least squares solution for columns of very different sizes."""
    scale = np.abs(columns).max(axis=0)
    scale[scale == 0.0] = 1.0
    coefficients, *_ = np.linalg.lstsq(columns / scale, values, rcond=1e-6)
    solution: Array = coefficients / scale
    return solution


def waves_of(yaw_rad: Array, waves: int) -> Array:
    """Return sine and cosine of the heading, once per turn and more often, shape (n, 2 waves)."""
    numbers = np.arange(1, waves + 1)
    angle = np.outer(math.pi / 2 - yaw_rad, numbers)
    return np.hstack((np.sin(angle), np.cos(angle)))


def _deviation(record: CompassTurns, headings: _Headings, use: Flags, waves: int) -> Array:
    """Return the coefficients of the error of the yaw over the reading."""
    part = _Headings(headings.t_s[use], headings.yaw_rad[use], headings.turn[use])
    return _deviation_and_lag(record, part, waves)[0]


def _judge(record: CompassTurns, headings: _Headings, fold: float) -> tuple[Array, Array]:
    """Return compass heading and clockwise error of a turn, in deg, by the reference of the other turns."""
    columns, is_held = reference_columns(record, headings.t_s), headings.turn == fold
    unknowns = solve_columns(columns[~is_held], headings.yaw_rad[~is_held])
    expected = columns[is_held] @ unknowns
    error = wrap_angles(headings.yaw_rad[is_held] - expected)
    mean = math.atan2(float(np.sin(error).sum()), float(np.cos(error).sum()))
    heading_deg = np.array(
        [compass_deg_from_yaw(yaw) for yaw in (expected + unknowns[3] * columns[is_held, 3]).tolist()]
    )
    return heading_deg, -np.degrees(wrap_angles(error - mean))


def _errors_of(
    record: CompassTurns, headings: _Headings, unknowns: Array | None = None
) -> tuple[Array, Array]:
    """Return heading and error of the readings as they are.

    Args:
        record: The turns.
        headings: The readings.
        unknowns: Start, scale, drift and lag of the reference; without them its drift counts as an error.
    """
    if not len(headings.t_s):
        return np.zeros(0), np.zeros(0)
    if unknowns is None:
        yaw = np.interp(headings.t_s, record.t_s, record.yaw_rad)
    else:
        yaw = reference_columns(record, headings.t_s) @ unknowns
    error = headings.yaw_rad - yaw
    mean = math.atan2(float(np.sin(error).sum()), float(np.cos(error).sum()))
    heading_deg = np.array([compass_deg_from_yaw(each) for each in (yaw + mean).tolist()])
    return heading_deg, -np.degrees(wrap_angles(error - mean))


def _covered(yaw_rad: Array) -> float:
    sectors = np.unique(
        (yaw_rad % math.tau / math.tau * COMPASS_FIT.sectors).astype(int) % COMPASS_FIT.sectors
    )
    return float(len(sectors) / COMPASS_FIT.sectors)


def _result(
    record: CompassTurns,
    calibration: Calibration,
    after: _Headings,
    before: _Headings,
    folds: Sequence[float],
    held_out: Sequence[tuple[Array, Array]],
    raw: Array,
    strength: float,
) -> CompassFit:
    unknowns = solve_columns(reference_columns(record, after.t_s), after.yaw_rad)
    error_deg = np.concatenate([error for _, error in held_out]) if held_out else np.zeros(0)
    covered, scale = _covered(after.yaw_rad), float(unknowns[1] - 1.0)
    before_heading, before_error = _errors_of(record, before, unknowns)
    return CompassFit(
        calibration=calibration,
        heading_deg=np.concatenate([heading for heading, _ in held_out]) if held_out else np.zeros(0),
        error_deg=error_deg,
        before_heading_deg=before_heading,
        before_deg=before_error,
        turns=len(folds),
        covered=covered,
        raw_counts=raw,
        strength_counts=strength,
        lag_s=float(unknowns[3]),
        scale=scale,
        problem=_problem(record, len(folds), covered, scale, error_deg),
    )


def _nothing(
    record: CompassTurns, before: _Headings, folds: Sequence[float], raw: Array, problem: str
) -> CompassFit:
    heading, error = _errors_of(record, before)
    return CompassFit(
        calibration=None,
        heading_deg=np.zeros(0),
        error_deg=np.zeros(0),
        before_heading_deg=heading,
        before_deg=error,
        turns=len(folds),
        covered=_covered(record.yaw_rad),
        raw_counts=raw,
        strength_counts=0.0,
        lag_s=0.0,
        scale=0.0,
        problem=_turns_problem(record, len(folds)) or problem,
    )


def _turns_problem(record: CompassTurns, turns: int) -> str:
    if turns >= COMPASS_FIT.least_turns:
        return ""
    return (
        f"the {record.reference} turned {record.turns:.1f} times: at least {COMPASS_FIT.least_turns} turns "
        "are needed, so that some can be held out"
    )


def _problem(record: CompassTurns, turns: int, covered: float, scale: float, error_deg: Array) -> str:
    few = _turns_problem(record, turns)
    if few:
        return few
    if abs(scale) > COMPASS_FIT.greatest_scale_error:
        return (
            f"the compass turns {1.0 + scale:.2f} times as far as the {record.reference}: one of them is "
            "mounted the wrong way up, does not turn with the rover, "
            "or the rover's iron is stronger than the earth's field"
        )
    if covered * COMPASS_FIT.sectors < COMPASS_FIT.least_covered:
        return (
            f"the headings cover only {100 * covered:.0f} % of the directions: turn evenly through all of "
            "them; if the rover did, its iron is stronger than the earth's field, "
            "and the compass must be moved away from it"
        )
    if rms(error_deg) > COMPASS_FIT.greatest_rms_deg:
        return (
            f"the error on held-out turns is {rms(error_deg):.1f} deg, more than "
            f"{COMPASS_FIT.greatest_rms_deg:g} deg: "
            "turn where no iron lies in the floor, and keep the sensor level"
        )
    return ""
