"""Path of a recorded drive by the sComp filter."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from controllers.estimation.guarded_filter import Innovation
from controllers.motion.planar import wrap_angle
from controllers.slip.scomp.filter import FilterStep, ScompFilter, StartHeading
from controllers.slip.scomp.motion_model import (
    ANGLES,
    FIRST,
    SECOND,
    YAW,
    Motion,
    X,
    Y,
    expected_drift,
    tilt_along,
)
from controllers.slip.scomp.parameters import SCOMP, ScompParameters
from controllers.slip.scomp.slip_laws import PitchLaw, SlipLaw, TwoSegmentLaw
from drivers.errors import ModelError
from rover_hil.datasets.arrays import Array
from rover_hil.scomp.drive import Drive, Track
from rover_hil.scomp.smoother import smooth
from rover_hil.scomp.windows import smoothed

START_AGREES_RAD = math.radians(4.0)
START_AGREES_UNCALIBRATED_RAD = math.radians(10.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Result:
    """A path by the sComp filter.

    Attributes:
        innovations: Of every correction, in order.
        learnt: First and second parameter of the slip law at the end, and their standard deviations.
        notes: Missing sensors and decisions, one sentence each.
    """

    track: Track
    innovations: tuple[Innovation, ...]
    learnt: tuple[float, float, float, float]
    notes: tuple[str, ...] = field(default=())


def estimate_track(
    drive: Drive,
    parameters: ScompParameters,
    progress: Callable[[int], None] = lambda _: None,
    *,
    online: bool = False,
) -> Result:
    """Return the path by the sComp filter, one estimate for each row of the drive.

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
    notes = _missing(drive)
    drive = _with_smooth_tilt(drive)
    parameters, sign_note = with_compass_sign(drive, parameters)
    start, start_note = start_heading(drive, parameters)
    law: SlipLaw = PitchLaw(parameters) if drive.pitch_rad is not None else TwoSegmentLaw(parameters)
    estimator = ScompFilter(parameters, law, start, follows_roll=drive.roll_rad is not None)
    motions = [_motion(drive, parameters, max(index, 1)) for index in range(len(drive.t_s))]
    steps, innovations = _filter(drive, estimator, motions, progress)
    estimates = [step.estimate for step in steps] if online else smooth(steps, ANGLES)
    state, covariance = steps[-1].estimate
    spread = np.sqrt(np.diag(covariance))
    return Result(
        track=_track(drive, estimator, estimates, motions),
        innovations=tuple(innovations),
        learnt=(float(state[FIRST]), float(state[SECOND]), float(spread[FIRST]), float(spread[SECOND])),
        notes=(*notes, *sign_note, *start_note),
    )


def _filter(
    drive: Drive, estimator: ScompFilter, motions: list[Motion], progress: Callable[[int], None]
) -> tuple[list[FilterStep], list[Innovation]]:
    innovations: list[Innovation] = []
    _correct(estimator, drive, 0, innovations)
    steps = [estimator.step]
    for index in range(1, len(drive.t_s)):
        estimator.move(motions[index])
        _correct(estimator, drive, index, innovations)
        steps.append(estimator.step)
        if index % 200 == 0:
            progress(index)
    return steps, innovations


def _track(
    drive: Drive,
    estimator: ScompFilter,
    estimates: list[tuple[Array, Array]],
    motions: list[Motion],
) -> Track:
    states = np.array([state for state, _ in estimates])
    variances = np.array([np.diag(covariance)[:2] for _, covariance in estimates])
    model = estimator.model
    pairs = list(zip(states, motions, strict=True))
    return Track(
        t_s=drive.t_s,
        x_m=states[:, X],
        y_m=states[:, Y],
        heading_rad=np.unwrap(states[:, YAW]),
        slip=np.array([model.slip(state, motion) if motion.wheel_rad else 0.0 for state, motion in pairs]),
        slip_angle_rad=np.array([model.course(state, motion) for state, motion in pairs]),
        sigma_x_m=np.sqrt(variances[:, 0]),
        sigma_y_m=np.sqrt(variances[:, 1]),
    )


def start_heading(drive: Drive, parameters: ScompParameters) -> tuple[StartHeading, tuple[str, ...]]:
    """Return the heading at start, and a note on it.

    The frame of the path is the pose at start, x ahead, unless the parameters are from a truth in another
    frame, or a compass with a known offset contradicts it.
    """
    compass = parameters.compass
    reading = _first(drive.compass_rad)
    if reading is None:
        return StartHeading(heading_rad=0.0, standard_deviation_rad=SCOMP.motion.start_certain_rad), ()
    by_compass = wrap_angle((compass.sign or 1) * reading - (compass.offset_rad or 0.0))
    agrees_rad = START_AGREES_UNCALIBRATED_RAD if compass.offset_rad is None else START_AGREES_RAD
    if parameters.starts_along_x and abs(by_compass) < agrees_rad:
        return StartHeading(heading_rad=0.0, standard_deviation_rad=SCOMP.motion.start_certain_rad), ()
    words = f"the heading at start is that of the compass, {math.degrees(by_compass):.1f} deg"
    return StartHeading(heading_rad=by_compass, standard_deviation_rad=None), (words,)


def _correct(estimator: ScompFilter, drive: Drive, index: int, innovations: list[Innovation]) -> None:
    found: list[Innovation | None] = [estimator.correct_standstill()]
    if drive.compass_rad is not None and math.isfinite(drive.compass_rad[index]):
        found.append(estimator.correct_compass(float(drive.compass_rad[index])))
    if drive.trace_rad is not None and math.isfinite(drive.trace_rad[index]):
        found.append(estimator.correct_trace(float(drive.trace_rad[index])))
    if drive.fix_m is not None and np.isfinite(drive.fix_m[index]).all():
        x_m, y_m = drive.fix_m[index].tolist()
        found.extend(estimator.correct_position(x_m, y_m, drive.fix_sd_m))
    innovations.extend(item for item in found if item is not None)


def _with_smooth_tilt(drive: Drive) -> Drive:
    pitch, roll = (
        None if values is None else smoothed(drive.t_s, values, SCOMP.motion.tilt_memory_s)
        for values in (drive.pitch_rad, drive.roll_rad)
    )
    return replace(drive, pitch_rad=pitch, roll_rad=roll)


def _motion(drive: Drive, parameters: ScompParameters, index: int) -> Motion:
    dt_s = float(drive.t_s[index] - drive.t_s[index - 1])
    rover = parameters.rover
    if drive.gyro_rad_s is not None:
        rate = 0.5 * float(drive.gyro_rad_s[index] + drive.gyro_rad_s[index - 1])
    else:
        turned = float(drive.wheel_yaw_rad[index] - drive.wheel_yaw_rad[index - 1])
        rate = rover.wheel_radius_m * turned / (0.5 * rover.track_m) / dt_s
    pitch = 0.0 if drive.pitch_rad is None else float(drive.pitch_rad[index])
    roll = 0.0 if drive.roll_rad is None else float(drive.roll_rad[index])
    steering = 0.0
    if drive.steering_rad is not None:
        steering = 0.5 * float(drive.steering_rad[index] + drive.steering_rad[index - 1])
    pitch, roll = tilt_along(parameters, pitch, roll, steering)
    return Motion(
        duration_s=dt_s,
        wheel_rad=float(drive.wheel_rad[index] - drive.wheel_rad[index - 1]),
        rate_rad_s=rate,
        is_gyro=drive.gyro_rad_s is not None,
        pitch_rad=pitch,
        expected_drift_rad=expected_drift(parameters, pitch, roll),
        steering_rad=steering,
    )


def _missing(drive: Drive) -> list[str]:
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


def with_compass_sign(drive: Drive, parameters: ScompParameters) -> tuple[ScompParameters, tuple[str, ...]]:
    """Return the parameters with the sign of the compass, found by the gyro where it is unknown."""
    if parameters.compass.sign is not None or drive.compass_rad is None:
        return parameters, ()
    clockwise = drive.gyro_rad_s is not None and _turns_clockwise(drive, drive.gyro_rad_s, drive.compass_rad)
    compass = parameters.compass.model_copy(update={"sign": -1 if clockwise else 1})
    notes = ("the compass turns against the gyro: it is positive clockwise",) if clockwise else ()
    return parameters.model_copy(update={"compass": compass}), notes


def _turns_clockwise(drive: Drive, rate_rad_s: Array, readings_rad: Array) -> bool:
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
