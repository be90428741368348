"""Paths of a recorded drive: plain, with the compass, sComp as in paper 000, by the pose estimator."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from controllers.estimation.guarded_filter import Innovation
from controllers.motion.planar import wrap_angle
from controllers.slip.scomp.filter import START_CERTAIN_RAD, FilterStep, PoseEstimator, StartHeading
from controllers.slip.scomp.motion_model import ANGLES, FIRST, SECOND, YAW, Motion, X, Y, expected_drift
from controllers.slip.scomp.parameters import ScompParameters
from controllers.slip.scomp.slip_laws import HingeLaw, PitchLaw, SlipLaw
from drivers.errors import ModelError
from rover_hil.datasets.arrays import Array
from rover_hil.scomp.drive import Drive, Track
from rover_hil.scomp.smoother import smooth
from rover_hil.scomp.windows import smoothed

START_AGREES_RAD = math.radians(4.0)
START_AGREES_UNCALIBRATED_RAD = math.radians(10.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Result:
    """A path by the pose estimator.

    Attributes:
        innovations: Of every correction, in order.
        learnt: First and second parameter of the slip law at the end, and their standard deviations.
        notes: What was done without, and what was decided, one sentence each.
    """

    track: Track
    innovations: tuple[Innovation, ...]
    learnt: tuple[float, float, float, float]
    notes: tuple[str, ...] = field(default=())


def plain_track(drive: Drive, parameters: ScompParameters) -> Track:
    """Return wheel odometry: no slip, heading by the difference of the wheels."""
    rover = parameters.rover
    heading = rover.wheel_radius_m * drive.wheel_yaw_rad / (0.5 * rover.track_m)
    return _integrate(drive, parameters, heading - heading[0], np.zeros_like(heading), None)


def compass_track(drive: Drive, parameters: ScompParameters) -> Track:
    """Return wheel odometry turned by the compass, the paper's "enhanced odometry"."""
    heading = _compass_heading(drive, parameters)
    return _integrate(drive, parameters, heading, np.zeros_like(heading), None)


def paper_track(drive: Drive, parameters: ScompParameters) -> Track:
    """Return sComp as the paper has it, with eq 15 corrected: V_x = r w (1 - s_x0 - k (|beta| - beta0)).

    The slip angle is the trace's, the last one held; the heading is the compass', unfiltered.

    Raises:
        ModelError: The drive has no trace or no compass.
    """
    if drive.trace_rad is None:
        msg = "sComp as in the paper needs trace angles, and the drive has none: use the pose estimator"
        raise ModelError(msg)
    beta = parameters.trace.sign * _held(drive.trace_rad)
    return _integrate(drive, parameters, _compass_heading(drive, parameters), beta, parameters.hinge.slip_at)


def estimate_track(
    drive: Drive,
    parameters: ScompParameters,
    progress: Callable[[int], None] = lambda _: None,
    *,
    online: bool = False,
) -> Result:
    """Return the path by the pose estimator, one estimate for each row of the drive.

    Args:
        drive: The log; sensors may be missing.
        parameters: Rover, ground and sensors.
        progress: Called now and then with the number of rows done.
        online: Each row as the rover knew it then, instead of by the whole drive. The last row is the same.

    Raises:
        ModelError: Fewer than two rows.
    """
    if len(drive.t_s) < 2:
        msg = f"an odometry needs at least two rows, the drive has {len(drive.t_s)}: give a longer log"
        raise ModelError(msg)
    notes = _missing(drive)
    drive = _with_smooth_tilt(drive)
    parameters, sign_note = _with_compass_sign(drive, parameters)
    start, start_note = start_heading(drive, parameters)
    law: SlipLaw = PitchLaw(parameters) if drive.pitch_rad is not None else HingeLaw(parameters)
    estimator = PoseEstimator(parameters, law, start, follows_roll=drive.roll_rad is not None)
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
    drive: Drive, estimator: PoseEstimator, motions: list[Motion], progress: Callable[[int], None]
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
    estimator: PoseEstimator,
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
        slip_angle_rad=np.array([model.drift(state, motion) for state, motion in pairs]),
        sigma_x_m=np.sqrt(variances[:, 0]),
        sigma_y_m=np.sqrt(variances[:, 1]),
    )


def start_heading(drive: Drive, parameters: ScompParameters) -> tuple[StartHeading, tuple[str, ...]]:
    """Return what is known of the heading at start, and a note on it.

    The frame of the path is that of the pose at start, x ahead, unless the parameters come from a truth in
    another frame, or the compass, whose offset they know, contradicts it.
    """
    compass = parameters.compass
    reading = _first(drive.compass_rad)
    if reading is None:
        return StartHeading(heading_rad=0.0, standard_deviation_rad=START_CERTAIN_RAD), ()
    by_compass = wrap_angle((compass.sign or 1) * reading - (compass.offset_rad or 0.0))
    agrees_rad = START_AGREES_UNCALIBRATED_RAD if compass.offset_rad is None else START_AGREES_RAD
    if parameters.starts_along_x and abs(by_compass) < agrees_rad:
        return StartHeading(heading_rad=0.0, standard_deviation_rad=START_CERTAIN_RAD), ()
    words = f"the heading at start is the compass', {math.degrees(by_compass):.1f} deg"
    return StartHeading(heading_rad=by_compass, standard_deviation_rad=None), (words,)


def _correct(estimator: PoseEstimator, drive: Drive, index: int, innovations: list[Innovation]) -> None:
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
        None if values is None else smoothed(drive.t_s, values)
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
    return Motion(
        duration_s=dt_s,
        wheel_rad=float(drive.wheel_rad[index] - drive.wheel_rad[index - 1]),
        rate_rad_s=rate,
        is_gyro=drive.gyro_rad_s is not None,
        pitch_rad=pitch,
        expected_drift_rad=expected_drift(parameters, pitch, roll),
    )


def _missing(drive: Drive) -> list[str]:
    """Return notes on missing sensors and what replaces them."""
    notes: list[str] = []
    if drive.gyro_rad_s is None and drive.compass_rad is None:
        notes.append("no gyro and no compass: the heading turns with the difference of the wheels alone")
    elif drive.gyro_rad_s is None:
        notes.append("no gyro: the heading turns with the wheels and follows the compass")
    elif drive.compass_rad is None:
        notes.append("no compass: the heading is the gyro's, and drifts with its bias")
    if drive.pitch_rad is None:
        notes.append("no pitch: the slip is the hinge's, the same on every slope")
    if drive.roll_rad is None:
        notes.append("no roll: nothing is expected of the slip angle, it is the trace's")
    if drive.trace_rad is None and drive.roll_rad is None:
        notes.append("no trace either: the slip angle is taken for zero")
    elif drive.trace_rad is None:
        notes.append("no trace: the slip angle is what the roll makes expect")
    return notes


def _compass_heading(drive: Drive, parameters: ScompParameters) -> Array:
    """Return the heading by the unfiltered compass.

    Raises:
        ModelError: The drive has no compass.
    """
    if drive.compass_rad is None:
        msg = "compass-enhanced odometry needs a compass, and the drive has none: use plain odometry"
        raise ModelError(msg)
    parameters, _ = _with_compass_sign(drive, parameters)
    compass = parameters.compass
    heading: Array = (compass.sign or 1) * _held(drive.compass_rad) - (compass.offset_rad or 0.0)
    return heading


def _with_compass_sign(drive: Drive, parameters: ScompParameters) -> tuple[ScompParameters, tuple[str, ...]]:
    """Return the parameters with the compass' sense of rotation, by the gyro where they lack it."""
    if parameters.compass.sign is not None or drive.compass_rad is None:
        return parameters, ()
    clockwise = drive.gyro_rad_s is not None and _turns_clockwise(drive, drive.gyro_rad_s, drive.compass_rad)
    compass = parameters.compass.model_copy(update={"sign": -1 if clockwise else 1})
    notes = ("the compass turns against the gyro: it is read as clockwise",) if clockwise else ()
    return parameters.model_copy(update={"compass": compass}), notes


def _turns_clockwise(drive: Drive, rate_rad_s: Array, readings_rad: Array) -> bool:
    """Return whether minus the compass agrees with the gyro better; both may drift by a constant rate."""
    new = np.isfinite(readings_rad)
    steps = np.diff(drive.t_s, prepend=drive.t_s[0]) * rate_rad_s
    turned, t_s, compass = np.cumsum(steps)[new], drive.t_s[new], readings_rad[new]
    if len(t_s) < 3:
        return False
    trend = np.column_stack([np.ones_like(t_s), t_s])
    turned = turned - trend @ np.linalg.lstsq(trend, turned, rcond=None)[0]
    compass = compass - trend @ np.linalg.lstsq(trend, compass, rcond=None)[0]
    likeness = float(turned @ compass) / math.sqrt(float(turned @ turned) * float(compass @ compass) + 1e-30)
    return likeness < -0.5


def _first(values: Array | None) -> float | None:
    """Return the first number."""
    if values is None:
        return None
    finite = values[np.isfinite(values)]
    return float(finite[0]) if len(finite) else None


def _held(values: Array) -> Array:
    """Return each value until the next; before the first there is zero."""
    index = np.maximum.accumulate(np.where(np.isfinite(values), np.arange(len(values)), -1))
    return np.where(index >= 0, values[np.maximum(index, 0)], 0.0)


def _integrate(
    drive: Drive,
    parameters: ScompParameters,
    heading_rad: Array,
    slip_angle_rad: Array,
    slip_at: Callable[[float], float] | None,
) -> Track:
    """Integrate eqs 15-17; every row moves by the means of its two ends."""
    slip = np.zeros_like(heading_rad)
    if slip_at is not None:
        slip = np.array([slip_at(beta) for beta in slip_angle_rad.tolist()])
    rim_m = parameters.rover.wheel_radius_m * np.diff(drive.wheel_rad)
    along = rim_m * (1.0 - slip[1:])
    across = along * np.tan(slip_angle_rad[1:])
    middle = 0.5 * (heading_rad[1:] + heading_rad[:-1])
    x_m = np.concatenate(([0.0], np.cumsum(np.cos(middle) * along - np.sin(middle) * across)))
    y_m = np.concatenate(([0.0], np.cumsum(np.sin(middle) * along + np.cos(middle) * across)))
    unknown = np.full_like(heading_rad, np.nan)
    return Track(
        t_s=drive.t_s,
        x_m=x_m,
        y_m=y_m,
        heading_rad=heading_rad,
        slip=slip,
        slip_angle_rad=slip_angle_rad,
        sigma_x_m=unknown,
        sigma_y_m=unknown,
    )
