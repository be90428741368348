"""Path of a recorded drive by the estimator that drives, smoothed backwards."""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from controllers.estimation.filter.guarded_filter import FilterStep, Innovation
from controllers.estimation.filter.state_layout import YAW, StateLayout, X, Y
from controllers.estimation.settings import FilterSettings
from controllers.motion.planar import wrap_angle
from controllers.slip.scomp.motion_model import FIRST, SECOND, MotionModel, Tilt
from controllers.slip.scomp.parameters import ScompParameters
from controllers.slip.scomp.states import ScompStates
from drivers.errors import ModelError
from drivers.samples import HeadingReference
from rover_hil.drives.arrays import Array
from rover_hil.scomp.drive import SensorRows, Track
from rover_hil.scomp.recorded_samples import COMPASS, RecordedSamples, recorded_estimator
from rover_hil.scomp.smoother import Estimate, smooth

Source = tuple[str, HeadingReference]
"""Device and reference of headings."""

START_AGREES_RAD = math.radians(4.0)
START_AGREES_UNCALIBRATED_RAD = math.radians(10.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Result:
    """A path of a recorded drive.

    Attributes:
        innovations: Of every correction, in order.
        learnt: First and second parameter of the slip law at the end, and their standard deviations.
        notes: Missing sensors and decisions, one sentence each.
    """

    track: Track
    innovations: tuple[Innovation, ...]
    learnt: tuple[float, float, float, float]
    notes: tuple[str, ...] = field(default=())


class Row(NamedTuple):
    """What a time of the drive leaves.

    Attributes:
        t_s: The time.
        steps: Number of steps of the filter before the newest one.
        tilt: Of the rover.
        steering_rad: Mean steering angle.
        is_turning: Whether a wheel has turned since the row before.
    """

    t_s: float
    steps: int
    tilt: Tilt
    steering_rad: float
    is_turning: bool


def estimate_track(
    drive: SensorRows,
    parameters: ScompParameters,
    progress: Callable[[int], None] = lambda _: None,
    *,
    online: bool = False,
) -> Result:
    """Return the path by the estimator of the control loop, one estimate for each row of the drive.

    Args:
        drive: The log; sensors may be missing.
        parameters: Rover, ground and sensors.
        progress: Called from time to time with the number of rows done.
        online: Estimate each row from the rows before, not from the whole drive. The last row is the same.

    Raises:
        ModelError: Fewer than two rows.
    """
    if len(drive.t_s) < 2:
        raise ModelError(
            f"an odometry needs at least two rows, the drive has {len(drive.t_s)}: give a longer log"
        )
    parameters, sign_note = with_compass_sign(drive, parameters)
    start_rad, start_note = start_heading(drive, parameters)
    states = ScompStates(
        parameters, has_pitch=drive.pitch_rad is not None, has_roll=drive.roll_rad is not None
    )
    samples = RecordedSamples(drive, parameters, start_rad)
    estimator = recorded_estimator(samples, parameters, sensor_noise(parameters), states)
    steps = estimator.pose_filter.keep_steps()
    turns = np.diff(drive.wheel_rad, prepend=2.0 * drive.wheel_rad[0] - drive.wheel_rad[1]) != 0.0
    rows: list[Row] = []
    innovations: list[Innovation] = []
    for index in range(len(drive.t_s)):
        for sample in samples.of_row(index):
            estimator.take(sample, sample.t_ns)
        innovations += estimator.advance(samples.t_ns(index))
        steering_rad = 0.0 if drive.steering_rad is None else float(drive.steering_rad[index])
        rows.append(
            Row(float(drive.t_s[index]), len(steps) - 1, states.tilt, steering_rad, bool(turns[index]))
        )
        if index % 200 == 0:
            progress(index)
    layout = estimator.pose_filter.layout
    estimates = [step.estimate for step in steps] if online else smooth(steps, layout.angles)
    track = path_of(rows, [(0, estimates)], states.model, layout)
    if start_rad is not None:
        source = (COMPASS, HeadingReference.MAGNETIC)
        track = _turned(track, *_start_by_compass(parameters, layout, steps[-1], start_rad, source))
    return Result(
        track=track,
        innovations=tuple(innovations),
        learnt=learnt_of(layout, steps[-1]),
        notes=(*_missing(drive), *sign_note, *start_note),
    )


def sensor_noise(parameters: ScompParameters) -> FilterSettings:
    """Return the noise of the pose filter for the sensors of a rover.

    No slip remains beside that of the slip law: its uncertainty is part of the states.
    """
    gyro, compass = parameters.gyro, parameters.compass
    return FilterSettings(
        position_noise_m_sqrt_m=1e-4,
        unsure_position_noise_m_sqrt_m=1e-4,
        gyro_noise_rad_sqrt_s=min(max(gyro.walk_rad_sqrt_s, 1e-6), 0.1),
        gyro_bias_rad_s=min(max(gyro.bias_rad_s, 1e-6), 0.5),
        gyro_bias_walk_rad_s_sqrt_s=min(max(gyro.bias_walk_rad_s_sqrt_s, 1e-7), 0.01),
        heading_noise_rad=min(max(compass.noise_rad, 1e-3), 0.8),
        heading_lag_s=compass.lag_s,
        heading_deviation_rad=min(compass.deviation_rad, 1.0),
    )


def path_of(
    rows: Sequence[Row],
    blocks: Iterable[tuple[int, Sequence[Estimate]]],
    model: MotionModel,
    layout: StateLayout,
) -> Track:
    """Return a path.

    Args:
        rows: In the order of their times.
        blocks: Estimates of the steps of the filter, the newest block first, each with the number of its
            first step.
        model: Of the slip.
        layout: Of the states.
    """
    states, variances = np.zeros((len(rows), layout.size)), np.zeros((len(rows), 2))
    unread = len(rows)
    for first, estimates in blocks:
        while unread and rows[unread - 1].steps >= first:
            unread -= 1
            state, covariance = estimates[rows[unread].steps - first]
            states[unread], variances[unread] = state, np.diag(covariance)[:2]
    slips = [model.slip(state[layout.block], row.tilt) for state, row in zip(states, rows, strict=True)]
    drifts = [model.drift(state[layout.block], row.tilt) for state, row in zip(states, rows, strict=True)]
    return Track(
        t_s=np.array([row.t_s for row in rows]),
        x_m=states[:, X],
        y_m=states[:, Y],
        heading_rad=np.unwrap(states[:, YAW]),
        slip=np.where([row.is_turning for row in rows], slips, 0.0),
        slip_angle_rad=np.array(drifts) + np.array([row.steering_rad for row in rows]),
        sigma_x_m=np.sqrt(variances[:, 0]),
        sigma_y_m=np.sqrt(variances[:, 1]),
    )


def learnt_of(layout: StateLayout, last: FilterStep) -> tuple[float, float, float, float]:
    """Return both parameters of the slip law at the end, and their standard deviations."""
    state, covariance = last.estimate
    values, spread = state[layout.block], np.sqrt(np.diag(covariance)[layout.block])
    return float(values[FIRST]), float(values[SECOND]), float(spread[FIRST]), float(spread[SECOND])


def turned_by_compass(
    track: Track, parameters: ScompParameters, layout: StateLayout, last: FilterStep, source: Source
) -> tuple[Track, tuple[str, ...]]:
    """Return a track that begins along x, with the heading at start by a compass; and a note.

    Unchanged where the start defines the frame of the path, see `start_heading`.
    """
    start_rad = wrap_angle(last.estimate[0][layout.offsets[source]] - (parameters.compass.offset_rad or 0.0))
    if starts_along_x(parameters, start_rad):
        return track, ()
    found_rad, sd_rad = _start_by_compass(parameters, layout, last, start_rad, source)
    return _turned(track, found_rad, sd_rad), (_start_note(found_rad),)


def starts_along_x(parameters: ScompParameters, by_compass_rad: float) -> bool:
    """Return whether the pose at start defines the frame of the path."""
    is_calibrated = parameters.compass.offset_rad is not None
    agrees_rad = START_AGREES_RAD if is_calibrated else START_AGREES_UNCALIBRATED_RAD
    return parameters.starts_along_x and abs(by_compass_rad) < agrees_rad


def _start_note(start_rad: float) -> str:
    return f"the heading at start is that of the compass, {math.degrees(start_rad):.1f} deg"


def _start_by_compass(
    parameters: ScompParameters, layout: StateLayout, last: FilterStep, start_rad: float, source: Source
) -> tuple[float, float]:
    """Return the heading at start by all readings of the compass, and its standard deviation.

    The estimator counts the yaw from the start; the offset that it finds contains the heading there. The
    deviation is zero at the start in the estimator, and at `reference_rad` in the parameters.
    """
    state, covariance = last.estimate
    offset, compass = layout.offsets[source], parameters.compass
    found_rad = state[offset] - (compass.offset_rad or 0.0)
    if source in layout.deviations:
        first = layout.deviations[source]
        at_rad = compass.reference_rad - start_rad
        waves = np.array(
            [math.sin(at_rad), math.cos(at_rad) - 1.0, math.sin(2 * at_rad), math.cos(2 * at_rad) - 1.0]
        )
        found_rad += float((waves * state[first : first + len(waves)]).sum())
    sd_rad = math.sqrt(covariance[offset, offset] + compass.offset_sd_rad**2)
    return start_rad + wrap_angle(found_rad - start_rad), sd_rad


def _turned(track: Track, start_rad: float, sd_rad: float) -> Track:
    """Return a track whose first heading is `start_rad`, with a standard deviation."""
    way = (track.x_m + 1j * track.y_m) * np.exp(1j * start_rad)
    xx, yy = track.sigma_x_m**2, track.sigma_y_m**2
    cosine2, sine2 = math.cos(start_rad) ** 2, math.sin(start_rad) ** 2
    return Track(
        t_s=track.t_s,
        x_m=way.real,
        y_m=way.imag,
        heading_rad=track.heading_rad + start_rad,
        slip=track.slip,
        slip_angle_rad=track.slip_angle_rad,
        sigma_x_m=np.sqrt(cosine2 * xx + sine2 * yy + (sd_rad * way.imag) ** 2),
        sigma_y_m=np.sqrt(sine2 * xx + cosine2 * yy + (sd_rad * way.real) ** 2),
    )


def start_heading(drive: SensorRows, parameters: ScompParameters) -> tuple[float | None, tuple[str, ...]]:
    """Return the heading at start by the compass, and a note; None where the start defines the frame.

    The frame of the path is the pose at start, x ahead, unless the parameters are from a truth in another
    frame, or a compass with a known offset contradicts it.
    """
    compass = parameters.compass
    reading = _first(drive.compass_rad)
    if reading is None:
        return None, ()
    by_compass = wrap_angle((compass.sign or 1) * reading - (compass.offset_rad or 0.0))
    if starts_along_x(parameters, by_compass):
        return None, ()
    return by_compass, (_start_note(by_compass),)


def _missing(drive: SensorRows) -> list[str]:
    """Return a note for each missing sensor, with its replacement."""
    notes: list[str] = []
    if drive.gyro_rad_s is None and drive.compass_rad is None:
        notes.append("no gyro and no compass: the heading follows the difference of the wheels alone")
    elif drive.gyro_rad_s is None:
        notes.append("no gyro: the heading follows the wheels and the compass")
    elif drive.compass_rad is None:
        notes.append("no compass: the heading is that of the gyro, and drifts with its bias")
    if drive.pitch_rad is None:
        notes.append("no pitch: the two-segment slip law is used; it ignores the slope")
    if drive.roll_rad is None:
        notes.append("no roll: the slip angle is that of the trace")
    if drive.trace_rad is None and drive.roll_rad is None:
        notes.append("no trace either: the slip angle is assumed zero")
    elif drive.trace_rad is None:
        notes.append("no trace: the slip angle is the one expected from the roll")
    return notes


def with_compass_sign(
    drive: SensorRows, parameters: ScompParameters
) -> tuple[ScompParameters, tuple[str, ...]]:
    """Return the parameters with the sign of the compass, found by the gyro where it is unknown."""
    if parameters.compass.sign is not None or drive.compass_rad is None:
        return parameters, ()
    clockwise = drive.gyro_rad_s is not None and _turns_clockwise(drive, drive.gyro_rad_s, drive.compass_rad)
    compass = parameters.compass.model_copy(update={"sign": -1 if clockwise else 1})
    notes = ("the compass turns against the gyro: it is positive clockwise",) if clockwise else ()
    return parameters.model_copy(update={"compass": compass}), notes


def _turns_clockwise(drive: SensorRows, rate_rad_s: Array, readings_rad: Array) -> bool:
    """Return whether the negative compass agrees better with the gyro; constant drifts do not matter."""
    new = np.isfinite(readings_rad)
    steps = np.diff(drive.t_s, prepend=drive.t_s[0]) * rate_rad_s
    turned, t_s, compass = np.cumsum(steps)[new], drive.t_s[new], readings_rad[new]
    if len(t_s) < 3:
        return False
    trend = np.column_stack([np.ones_like(t_s), t_s])
    turned = turned - trend @ np.linalg.lstsq(trend, turned, rcond=None)[0]
    compass = compass - trend @ np.linalg.lstsq(trend, compass, rcond=None)[0]
    size2 = float(turned @ turned) * float(compass @ compass)
    return float(turned @ compass) / math.sqrt(size2 + 1e-30) < -0.5


def _first(values: Array | None) -> float | None:
    """Return the first number."""
    if values is None:
        return None
    finite = values[np.isfinite(values)]
    return float(finite[0]) if len(finite) else None
