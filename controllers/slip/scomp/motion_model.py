"""Prediction of the filter's state and covariance by one step."""

import cmath
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from controllers.matrices import product
from controllers.motion.planar import wrap_angle
from controllers.slip.scomp.parameters import SCOMP, ScompParameters
from controllers.slip.scomp.slip_laws import SlipLaw, slopes

Array = NDArray[np.float64]

X, Y, YAW, BIAS, LAGGED, OFFSET, DEVIATION = range(7)
RESIDUAL, RESIDUAL_RATE, TRACE_NOISE, TRACE_OFFSET, GAIN, FIRST, SECOND = range(10, 17)
RESIDUALS = slice(RESIDUAL, RESIDUAL_RATE + 1)
STATES = 17
"""x, y, heading; gyro bias; lagged heading, offset and four harmonics of the deviation of the compass;
residual of the slip angle beyond the roll's share, and its rate; correlated and constant error of the trace;
gain of the roll; the two parameters of the slip law."""
ANGLES = (YAW, LAGGED, OFFSET)
CERTAIN = 1e-10


@dataclass(frozen=True, slots=True, kw_only=True)
class Motion:
    """Motion and tilt of the rover during one step.

    Attributes:
        duration_s: Positive.
        wheel_rad: Mean angle turned by the wheels.
        rate_rad_s: Yaw rate: mean of the gyro's readings at both ends, or by the wheels.
        is_gyro: True where the rate is the gyro's.
        pitch_rad: Along the direction in which the wheels roll, with the sign of the log; 0 where unknown.
        expected_drift_rad: Slip angle expected from the roll, see `expected_drift`; 0 where unknown.
        steering_rad: Direction in which the wheels roll, counter-clockwise from the rover's axis.
    """

    duration_s: float
    wheel_rad: float
    rate_rad_s: float
    is_gyro: bool
    pitch_rad: float = 0.0
    expected_drift_rad: float = 0.0
    steering_rad: float = 0.0

    @property
    def rolling(self) -> complex:
        """Unit vector in which the wheels roll: forward as real part, left as imaginary part."""
        return cmath.rect(1.0, self.steering_rad)


@dataclass(frozen=True, slots=True, kw_only=True)
class Prediction:
    """Result of a step.

    Attributes:
        state: State after the step.
        transition: Jacobian over the state before it.
        noise: Covariance added by the step.
        velocity_x_m_s: Eq 15 with the estimator's slip, along the rover's axis.
        yaw_rate_rad_s: Gyro bias removed.
    """

    state: list[float]
    transition: Array
    noise: Array
    velocity_x_m_s: float
    yaw_rate_rad_s: float


def expected_drift(parameters: ScompParameters, pitch_rad: float, roll_rad: float) -> float:
    """Return the slip angle in rad that the combined-slip model gives for the weight of a tilted rover.

    A raised left side pulls the rover to the right: a negative angle, for a positive gain.
    """
    traction = parameters.pitch.pitch_sign * math.sin(pitch_rad) + parameters.pitch.rolling_resistance
    return -parameters.pitch.model.drift_at(traction, math.sin(roll_rad))


def tilt_along(
    parameters: ScompParameters, pitch_rad: float, roll_rad: float, steering_rad: float
) -> tuple[float, float]:
    """Return pitch and roll of a tilted rover along and across the direction in which its wheels roll."""
    cosine, sine = math.cos(steering_rad), math.sin(steering_rad)
    sign = parameters.pitch.pitch_sign
    return (
        pitch_rad * cosine + sign * roll_rad * sine,
        roll_rad * cosine - sign * pitch_rad * sine,
    )


class MotionModel:
    """Eqs 15-17 with slip and slip angle from the state.

    Wheels that are steered roll in the direction `Motion.steering_rad`; slip, slip angle and tilt are then
    those along and across that direction.

    Args:
        parameters: Rover, ground and sensors.
        law: Slip over slip angle and pitch.
        follows_roll: False when there is no roll.
    """

    def __init__(self, parameters: ScompParameters, law: SlipLaw, *, follows_roll: bool) -> None:
        self._parameters = parameters
        self._law = law
        roll = parameters.roll
        self._residual_sd = roll.rest if follows_roll else roll.alone
        self._rate_per_s = math.sqrt(3.0) / (roll.rest_time_s if follows_roll else roll.alone_time_s)

    def start(self, *, follows_roll: bool) -> tuple[Array, Array]:
        """Return the states from `RESIDUAL` on at the start, and their variances."""
        trace, roll, law = self._parameters.trace, self._parameters.roll, self._law
        gain, gain_rad2 = (roll.gain, roll.gain_sd**2) if follows_roll else (0.0, 0.0)
        values = (0.0, 0.0, 0.0, trace.offset_rad, gain, law.first, law.second)
        variances = (
            *self.residual_variances(),
            trace.noise_rad**2,
            trace.offset_sd_rad**2,
            gain_rad2 + CERTAIN,
            law.first_sd**2 + CERTAIN,
            law.second_sd**2 + CERTAIN,
        )
        return np.array(values), np.array(variances)

    def residual_variances(self) -> tuple[float, float]:
        """Return the stationary variances of the slip angle's residual and of its rate."""
        return self._residual_sd**2, (self._residual_sd * self._rate_per_s) ** 2

    def drift(self, state: Array | list[float], motion: Motion) -> float:
        """Return the slip angle of the wheels in rad: the roll's share and the residual."""
        beta = float(state[GAIN]) * motion.expected_drift_rad + float(state[RESIDUAL])
        return min(max(beta, -SCOMP.motion.largest_drift_rad), SCOMP.motion.largest_drift_rad)

    def course(self, state: Array | list[float], motion: Motion) -> float:
        """Return the slip angle of the rover in rad, eq 1: that of its wheels, and their steering."""
        return motion.steering_rad + self.drift(state, motion)

    def slip(self, state: Array | list[float], motion: Motion) -> float:
        """Return the slip ratio of the rover, eq 3, in the direction in which the wheels roll."""
        beta = self.drift(state, motion)
        return self._law.slip_at(beta, motion.pitch_rad, float(state[FIRST]), float(state[SECOND]))

    def predict(self, state: list[float], motion: Motion) -> Prediction:
        """Return the state after a step, with its Jacobian and noise."""
        dt_s = motion.duration_s
        turn = (motion.rate_rad_s - (state[BIAS] if motion.is_gyro else 0.0)) * dt_s
        middle = state[YAW] + 0.5 * turn
        follow = -math.expm1(-dt_s / max(self._parameters.compass.lag_s, 1e-3))
        keep_noise = math.exp(-dt_s / self._parameters.trace.noise_time_s)
        residual = self._residual_transition(dt_s)

        rim_m = self._parameters.rover.wheel_radius_m * motion.wheel_rad
        travel_m, over = self._travel(state, motion, rim_m)
        toward = complex(math.cos(middle), math.sin(middle))
        moved_m = toward * travel_m
        moved = list(state)
        moved[X], moved[Y] = state[X] + moved_m.real, state[Y] + moved_m.imag
        moved[YAW] = state[YAW] + turn
        moved[LAGGED] = state[LAGGED] + follow * wrap_angle(middle - state[LAGGED])
        moved[RESIDUALS] = product(residual, np.array(state[RESIDUALS])).tolist()
        moved[TRACE_NOISE] = keep_noise * state[TRACE_NOISE]

        transition = np.eye(STATES)
        covered_s = dt_s if motion.is_gyro else 0.0
        over |= {YAW: 1j * travel_m, BIAS: -0.5j * covered_s * travel_m}
        for index, slope_m in over.items():
            transition[X, index], transition[Y, index] = (toward * slope_m).real, (toward * slope_m).imag
        transition[YAW, BIAS], transition[LAGGED, BIAS] = -covered_s, -0.5 * covered_s * follow
        transition[LAGGED, LAGGED], transition[LAGGED, YAW] = 1.0 - follow, follow
        transition[RESIDUALS, RESIDUALS] = residual
        transition[TRACE_NOISE, TRACE_NOISE] = keep_noise
        return Prediction(
            state=moved,
            transition=transition,
            noise=self._noise(
                motion, rim_m, toward * motion.rolling * complex(1.0, math.tan(self.drift(state, motion)))
            ),
            velocity_x_m_s=travel_m.real / dt_s,
            yaw_rate_rad_s=turn / dt_s,
        )

    def _travel(self, state: list[float], motion: Motion, rim_m: float) -> tuple[complex, dict[int, complex]]:
        """Return the travel in the body frame, left as imaginary part, and its slopes over the states."""
        beta = self.drift(state, motion)
        slip, over_beta, over_first, over_second = slopes(
            self._law, beta, motion.pitch_rad, state[FIRST], state[SECOND]
        )
        direction = motion.rolling * complex(1.0, math.tan(beta))
        across = motion.rolling * 1j * rim_m * (1.0 - slip) * (1.0 + math.tan(beta) ** 2)
        by_beta = -rim_m * over_beta * direction + across
        return rim_m * (1.0 - slip) * direction, {
            RESIDUAL: by_beta,
            GAIN: by_beta * motion.expected_drift_rad,
            FIRST: -rim_m * over_first * direction,
            SECOND: -rim_m * over_second * direction,
        }

    def _residual_transition(self, dt_s: float) -> Array:
        """Return the transition of the residual and its rate: a Matern process of order 3/2."""
        rate = self._rate_per_s
        return math.exp(-rate * dt_s) * np.array(
            [[1.0 + rate * dt_s, dt_s], [-(rate**2) * dt_s, 1.0 - rate * dt_s]]
        )

    def _noise(self, motion: Motion, rim_m: float, along: complex) -> Array:
        parameters, dt_s = self._parameters, motion.duration_s
        noise = np.zeros((STATES, STATES))
        # The slip fluctuates fast against the drive: white noise with the same effect on the position.
        size, time_s = self._law.fluctuation
        direction = np.array([along.real, along.imag])
        noise[:2, :2] = (rim_m * size) ** 2 * 2.0 * time_s / dt_s * np.outer(direction, direction)
        walk = parameters.gyro.walk_rad_sqrt_s if motion.is_gyro else SCOMP.motion.wheel_walk_rad_sqrt_s
        noise[YAW, YAW] = walk**2 * dt_s
        noise[BIAS, BIAS] = parameters.gyro.bias_walk_rad_s_sqrt_s**2 * dt_s
        spread, residual = np.diag(self.residual_variances()), self._residual_transition(dt_s)
        noise[RESIDUALS, RESIDUALS] = spread - product(product(residual, spread), residual.T)
        trace = parameters.trace
        noise[TRACE_NOISE, TRACE_NOISE] = trace.noise_rad**2 * -math.expm1(-2.0 * dt_s / trace.noise_time_s)
        noise[FIRST, FIRST] = SCOMP.motion.first_walk_sqrt_m**2 * abs(rim_m)
        return noise
