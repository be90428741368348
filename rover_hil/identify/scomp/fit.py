"""Fit the parameters of the odometry to one drive with known truth."""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from pydantic import ValidationError

from controllers.motion.planar import wrap_angle
from controllers.slip.scomp.combined_slip import CombinedSlip
from controllers.slip.scomp.motion_model import expected_drift, tilt_along
from controllers.slip.scomp.parameters import (
    CompassModel,
    DriftFromRoll,
    GyroModel,
    RoverGeometry,
    ScompParameters,
    SlipFromPitch,
    TraceModel,
)
from controllers.slip.scomp.two_segment_slip_law import fit_two_segments
from drivers.errors import ModelError
from rover_hil.drives.arrays import Array, rms
from rover_hil.drives.ground_truth import TruePoses
from rover_hil.identify.scomp.parameters import SCOMP_FIT
from rover_hil.scomp.drive import SensorRows
from rover_hil.scomp.true_slip import LONGEST_TRUTH_GAP_S, WINDOW_S, SlipWindows, cut, smoothed, true_velocity


@dataclass(frozen=True, slots=True, kw_only=True)
class Identification:
    """Parameters, the windows that they were fitted to, and notes for the user.

    Attributes:
        slip_rms: Of the slip by the pitch about the windows; None without pitch.
    """

    parameters: ScompParameters
    windows: SlipWindows
    slip_rms: float | None
    notes: tuple[str, ...]


def identify(drive: SensorRows, truth: TruePoses, rover: RoverGeometry | None = None) -> Identification:
    """Fit the two-segment law, slip from pitch, drift from roll, and the errors of compass, gyro and trace.

    Priors keep what a drive does not determine near the defaults: c_rr 0.06 +- 0.05, C_x within a factor
    of 1.8.

    Raises:
        ModelError: Log and truth overlap too little, or are not of the same drive.
    """
    rover = rover or RoverGeometry()
    windows = cut(drive, truth, rover.wheel_radius_m)
    _check_windows(windows)
    notes: list[str] = []
    if windows.without_truth:
        notes.append(
            f"{windows.without_truth} windows of {WINDOW_S:g} s left out: no true pose for more than "
            f"{LONGEST_TRUTH_GAP_S:g} s"
        )
    pitch, slip_rms = fit_pitch(windows, notes)
    trace, rear_axle_m = fit_trace(drive, truth, rover, notes)
    parameters = ScompParameters(
        starts_along_x=abs(float(truth.yaw_rad[0])) < SCOMP_FIT.check.along_x_rad,
        rover=rover.model_copy(update={"rear_axle_m": rear_axle_m}),
        two_segment_slip=fit_two_segments(
            windows.slip_angle_rad, windows.slip, SCOMP_FIT.pitch.two_segment_range_rad
        ),
        pitch=pitch,
        compass=fit_compass(drive, truth, notes),
        gyro=fit_gyro(drive, truth),
        trace=trace,
    )
    parameters = _checked(parameters.model_copy(update={"roll": fit_roll(windows, parameters, notes)}))
    return Identification(parameters=parameters, windows=windows, slip_rms=slip_rms, notes=tuple(notes))


def _check_windows(windows: SlipWindows) -> None:
    """Reject a truth that cannot be that of the log.

    Raises:
        ModelError: In most windows the rover moves against its own heading, or does not move.
    """
    count = len(windows.t_s)
    astray = np.count_nonzero(np.abs(windows.slip_angle_rad) > SCOMP_FIT.check.slip_angle_rad)
    if astray > SCOMP_FIT.check.astray_share * count:
        raise ModelError(
            f"in the truth the rover moves backwards or sideways in {astray} of {count} windows although its "
            "wheels turn forwards: check that yaw_rad is in rad, counter-clockwise from x, and the axes"
        )
    if float(np.median(windows.slip)) > SCOMP_FIT.check.stuck_slip:
        raise ModelError(
            "the rover does not move in the truth although its wheels turn: use a drive in which it moves"
        )


def _checked(parameters: ScompParameters) -> ScompParameters:
    """Return the parameters if they are valid in a file."""
    try:
        return ScompParameters.model_validate(parameters.model_dump(by_alias=True))
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(str(part) for part in first["loc"])
        raise ModelError(
            f"the fit gives {place} = {first['input']}, out of range: are log and truth of one drive?"
        ) from error


def fit_pitch(windows: SlipWindows, notes: list[str]) -> tuple[SlipFromPitch, float | None]:
    """Fit c_rr and C_x to the slip in the windows, for the sign of the pitch that explains it better."""
    if windows.pitch_rad is None:
        notes.append("no pitch in the log: the slip from the pitch keeps its defaults")
        return SlipFromPitch(), None
    upward, downward = (_fit_pitch_signed(windows, windows.pitch_rad, sign) for sign in (1, -1))
    if downward[1] < SCOMP_FIT.check.inverted_share * upward[1]:
        notes.append("pitch in the log is negative for a raised nose")
        return downward
    return upward


def _fit_pitch_signed(windows: SlipWindows, pitch_rad: Array, sign: int) -> tuple[SlipFromPitch, float]:
    # Imported here because scipy takes a second that `--help` must not cost.
    from scipy.optimize import least_squares

    start = SlipFromPitch().model_copy(update={"pitch_sign": sign})
    if windows.roll_rad is not None:
        steering_rad = windows.steering_rad
        pitch_rad = pitch_rad * np.cos(steering_rad) + sign * windows.roll_rad * np.sin(steering_rad)
    pulls, angles = (sign * np.sin(pitch_rad)).tolist(), windows.slip_angle_rad.tolist()
    log_stiffness = math.log(start.model.c_x_n)
    spread = SCOMP_FIT.pitch.least_fluctuation

    def residual_of(values: Array) -> Array:
        resistance, stiffness_n = float(values[0]), math.exp(float(values[1]))
        trials = zip(pulls, angles, strict=True)
        model = [start.model.slip_at(pull + resistance, angle, stiffness_n) for pull, angle in trials]
        residual: Array = windows.slip - np.array(model)
        return residual

    def misfit(values: Array) -> Array:
        prior = (
            (values[0] - SCOMP_FIT.pitch.resistance_prior[0]) / SCOMP_FIT.pitch.resistance_prior[1],
            (values[1] - log_stiffness) / SCOMP_FIT.pitch.stiffness_prior_sd,
        )
        return np.concatenate([residual_of(values) / spread, prior])

    solution = np.array([SCOMP_FIT.pitch.resistance_prior[0], log_stiffness])
    low, high = SCOMP_FIT.pitch.resistance_range
    reach = SCOMP_FIT.pitch.stiffness_reach
    limits = ((low, log_stiffness - reach), (high, log_stiffness + reach))
    for _ in range(2):
        fit = least_squares(
            misfit, solution, loss="soft_l1", f_scale=SCOMP_FIT.pitch.outlier_sd, bounds=limits
        )
        solution = fit.x
        residual = residual_of(solution)
        size, memory_s = rms(residual), _correlation_time_s(residual)
        # Correlated windows count for less.
        spread = max(size, 0.01) * math.sqrt(max(1.0, 2.0 * memory_s / WINDOW_S))
    covariance = np.linalg.inv(fit.jac.T @ fit.jac)
    fluctuation = {
        "fluctuation": max(size, SCOMP_FIT.pitch.least_fluctuation),
        "fluctuation_time_s": memory_s,
    }
    return start.model_copy(update={**_pitch_update(solution, covariance), **fluctuation}), size


def _pitch_update(solution: Array, covariance: Array) -> dict[str, object]:
    """Return c_rr and C_x with their uncertainties, the latter's given c_rr."""
    follows = float(covariance[0, 1] / covariance[0, 0])
    given = math.sqrt(max(0.0, float(covariance[1, 1]) - follows * float(covariance[0, 1])))
    return {
        "model": CombinedSlip(c_x_n=math.exp(float(solution[1]))),
        "rolling_resistance": float(solution[0]),
        "rolling_resistance_sd": math.sqrt(float(covariance[0, 0])),
        "stiffness_sd": math.hypot(given, SCOMP_FIT.pitch.transfer),
        "stiffness_follows": follows,
    }


def fit_roll(windows: SlipWindows, parameters: ScompParameters, notes: list[str]) -> DriftFromRoll:
    """Fit the share of the drift that the roll explains; the residual gives its uncertainty."""
    beta = windows.slip_angle_rad
    alone, alone_s = _at_least(beta, SCOMP_FIT.roll.least_alone_deg), _smooth_time_s(beta)
    if windows.roll_rad is None or windows.pitch_rad is None:
        return DriftFromRoll(
            gain=0.0, gain_sd=0.0, rest=alone, rest_time_s=alone_s, alone=alone, alone_time_s=alone_s
        )
    tilts = zip(
        windows.pitch_rad.tolist(), windows.roll_rad.tolist(), windows.steering_rad.tolist(), strict=True
    )
    expected = np.array([expected_drift(parameters, *tilt_along(parameters, *tilt)) for tilt in tilts])
    gain, prior_weight = SCOMP_FIT.roll.gain_prior[0], SCOMP_FIT.roll.gain_prior[1] ** -2
    precision = prior_weight
    for _ in range(3):
        weight = 1.0 / (float(np.mean((beta - gain * expected) ** 2)) + 1e-6)
        precision = weight * float(expected @ expected) + prior_weight
        gain = (weight * float(expected @ beta) + SCOMP_FIT.roll.gain_prior[0] * prior_weight) / precision
    residual = beta - gain * expected
    remaining = _at_least(residual, SCOMP_FIT.roll.least_rest_deg)
    if (
        math.degrees(remaining) > SCOMP_FIT.roll.told_rest_deg
        and remaining > SCOMP_FIT.roll.told_share * alone
    ):
        notes.append(
            f"the roll explains little of the drift: {math.degrees(alone):.0f} deg rms, of which "
            f"{math.degrees(remaining):.0f} deg remain; without the wheel's trace the course is not known "
            "better"
        )
    return DriftFromRoll(
        gain=gain,
        gain_sd=math.hypot(precision**-0.5, SCOMP_FIT.roll.transfer * abs(gain)),
        rest=remaining,
        rest_time_s=_smooth_time_s(residual),
        alone=alone,
        alone_time_s=alone_s,
    )


def fit_compass(drive: SensorRows, truth: TruePoses, notes: list[str]) -> CompassModel:
    """Fit sense of rotation, offset and noise of the compass to the lagged true heading."""
    model = CompassModel()
    if drive.compass_rad is None:
        return model
    new = np.isfinite(drive.compass_rad) & (drive.t_s >= truth.t_s[0]) & (drive.t_s <= truth.t_s[-1])
    reading = drive.compass_rad[new]
    if len(reading) < 3:
        return model
    heading = np.interp(drive.t_s, truth.t_s, truth.yaw_rad)
    lagged = smoothed(drive.t_s, heading, model.lag_s)[new]
    errors = {sign: sign * reading - lagged for sign in (1, -1)}
    sign = -1 if float(np.std(errors[-1])) < SCOMP_FIT.check.inverted_share * float(np.std(errors[1])) else 1
    if sign < 0:
        notes.append("the compass is positive clockwise")
    noise_rad = float(np.std(np.diff(errors[sign]))) / math.sqrt(2.0)
    return model.model_copy(
        update={
            "sign": sign,
            "offset_rad": wrap_angle(float(np.mean(errors[sign]))),
            "offset_sd_rad": SCOMP_FIT.compass.transfer_rad,
            "reference_rad": wrap_angle(float(np.mean(lagged))),
            "noise_rad": max(noise_rad, SCOMP_FIT.compass.least_noise_rad),
        }
    )


def fit_gyro(drive: SensorRows, truth: TruePoses) -> GyroModel:
    """Fit the noise of the gyro to its residual about the true rate.

    Where the heading of the truth is noisy, the second differences of the gyro itself are the smaller
    estimate; they hardly contain motion.
    """
    model = GyroModel()
    if drive.gyro_rad_s is None:
        return model
    new = np.diff(drive.gyro_rad_s, prepend=np.nan) != 0.0  # a gyro slower than the log repeats itself
    if np.count_nonzero(new) < SCOMP_FIT.gyro.fewest_readings:
        return model
    t_s, rate_rad_s = drive.t_s[new], drive.gyro_rad_s[new]
    step_s = np.diff(t_s)
    true_rad_s = np.diff(np.interp(t_s, truth.t_s, truth.yaw_rad)) / step_s
    against_truth = np.diff(rate_rad_s[1:] - true_rad_s) / math.sqrt(2.0)
    alone = np.diff(rate_rad_s, 2) / math.sqrt(6.0)
    noise_rad_s = min(float(np.std(against_truth)), float(np.std(alone)))
    walk = noise_rad_s * math.sqrt(float(np.median(step_s)))
    return model.model_copy(update={"walk_rad_sqrt_s": max(walk, SCOMP_FIT.gyro.least_walk_rad_sqrt_s)})


def fit_trace(
    drive: SensorRows, truth: TruePoses, rover: RoverGeometry, notes: list[str]
) -> tuple[TraceModel, float]:
    """Fit sign, offset and noise of the trace angle, and b of eq 2; a prior keeps b near the drawing's."""
    model = TraceModel()
    if drive.trace_rad is None:
        return model, rover.rear_axle_m
    velocity = true_velocity(truth, drive.t_s)
    overlap = (drive.t_s >= truth.t_s[0]) & (drive.t_s <= truth.t_s[-1])
    use = np.isfinite(drive.trace_rad) & (velocity.speed_m_s > SCOMP_FIT.trace.slowest_m_s) & overlap
    if np.count_nonzero(use) < SCOMP_FIT.trace.fewest:
        return model, rover.rear_axle_m
    seen, beta = drive.trace_rad[use], velocity.slip_angle_rad[use]
    straight, mirrored = (float(np.median(np.abs(sign * seen - beta))) for sign in (1, -1))
    sign: Literal[-1, 1] = -1 if mirrored < SCOMP_FIT.trace.inverted_share * straight else 1
    if sign < 0:
        notes.append("the trace angle is positive to the right: its sign is inverted")
    error = sign * seen - beta
    near = np.abs(error) < SCOMP_FIT.trace.greatest_error_rad
    if np.count_nonzero(near) < SCOMP_FIT.trace.fewest:
        notes.append("the trace angles are far from the true ones: their errors keep the defaults")
        return model, rover.rear_axle_m
    turn = (velocity.yaw_rate_rad_s / np.maximum(velocity.speed_m_s, SCOMP_FIT.trace.slowest_m_s))[use]
    step_s = float(np.median(np.diff(drive.t_s[use])))
    update, rear_axle_m = _trace_errors(error[near], turn[near], step_s, rover.rear_axle_m)
    return model.model_copy(update={"sign": sign, **update}), rear_axle_m


def _trace_errors(
    error: Array, turn: Array, step_s: float, rear_axle_m: float
) -> tuple[dict[str, object], float]:
    """Fit eq 2: error = offset - b turn + correlated noise; return the errors, and b."""
    prior_weight = SCOMP_FIT.trace.rear_axle_sd_m**-2
    b, offset, time_s, offset_weight = rear_axle_m, 0.0, TraceModel().noise_time_s, 1.0
    residual = error
    for _ in range(3):
        residual = error + b * turn - offset
        time_s = _memory_s(residual, step_s)
        noise2 = float(np.var(residual)) * max(1.0, 2.0 * time_s / step_s)
        pull = float(turn @ (offset - error)) / noise2
        b = (pull + rear_axle_m * prior_weight) / (float(turn @ turn) / noise2 + prior_weight)
        weight = len(error) / noise2
        offset_weight = weight + SCOMP_FIT.trace.offset_sd_rad**-2
        offset = weight * float(np.mean(error + b * turn)) / offset_weight
    return {
        "offset_rad": offset,
        "offset_sd_rad": offset_weight**-0.5,
        "noise_rad": max(float(np.std(residual)), SCOMP_FIT.trace.least_noise_rad),
        "noise_time_s": min(max(time_s, SCOMP_FIT.trace.time_range_s[0]), SCOMP_FIT.trace.time_range_s[1]),
    }, b


def _at_least(residual: Array, smallest_deg: float) -> float:
    return max(rms(residual), math.radians(smallest_deg))


def _correlation_time_s(residual: Array) -> float:
    """Return the correlation time of the residual in the windows, not below their length."""
    return min(max(_memory_s(residual, WINDOW_S), WINDOW_S), SCOMP_FIT.pitch.longest_memory_s)


def _smooth_time_s(residual: Array) -> float:
    """Return the time of a Matern process of order 3/2 with the same neighbour correlation."""
    times_s = np.geomspace(SCOMP_FIT.roll.shortest_memory_s, SCOMP_FIT.pitch.longest_memory_s, 100)
    paces = math.sqrt(3.0) * WINDOW_S / times_s
    return float(
        times_s[np.argmin(np.abs((1.0 + paces) * np.exp(-paces) - _neighbour_correlation(residual)))]
    )


def _memory_s(residual: Array, step_s: float) -> float:
    """Return the correlation time of exponentially correlated noise, from the correlation of neighbours."""
    return step_s / -math.log(min(max(_neighbour_correlation(residual), 0.01), 0.95))


def _neighbour_correlation(residual: Array) -> float:
    off = residual - residual.mean()
    return float(off[1:] @ off[:-1]) / (float(off @ off) + 1e-30)
