"""Slip, slip angle and slip law of a rover, and the errors of its trace, as states."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from controllers.matrices import product
from controllers.slip.scomp.parameters import SCOMP, ScompParameters
from controllers.slip.scomp.slip_laws import SlipLaw, slopes

Array = NDArray[np.float64]

RESIDUAL, RESIDUAL_RATE, TRACE_NOISE, TRACE_OFFSET, GAIN, FIRST, SECOND = range(7)
RESIDUALS = slice(RESIDUAL, RESIDUAL_RATE + 1)
STATES = 7
"""Residual of the slip angle beyond the roll's share, and its rate; correlated and constant error of the
trace; gain of the roll; the two parameters of the slip law."""
CERTAIN = 1e-10


@dataclass(frozen=True, slots=True, kw_only=True)
class Tilt:
    """Tilt of a rover whose wheels roll.

    Attributes:
        pitch_rad: Along the direction in which the wheels roll, with the sign of the log; 0 where unknown.
        expected_drift_rad: Slip angle expected from the roll, see `expected_drift`; 0 where unknown.
    """

    pitch_rad: float = 0.0
    expected_drift_rad: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Prediction:
    """The states after a time, and the motion for a metre that the wheels roll.

    Attributes:
        travel: Of the body relative to the direction in which the wheels roll, left as imaginary part.
        slopes: Its derivatives over the states, complex, shape (7,).
        spread_s: Its covariance times the time over which the metre is rolled, shape (2, 2).
        transition: Of the states, shape (7, 7).
        noise: Covariance added to them; that of the slip law's first parameter per metre.
    """

    travel: complex
    slopes: NDArray[np.complex128]
    spread_s: Array
    transition: Array
    noise: Array


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
    """Eqs 15-17 with slip and slip angle from the states.

    Wheels that are steered roll in one direction; slip, slip angle and tilt are those along and across it.

    Args:
        parameters: Rover, ground and sensors.
        law: Slip over slip angle and pitch.
        follows_roll: False when there is no roll.
    """

    def __init__(self, parameters: ScompParameters, law: SlipLaw, *, follows_roll: bool) -> None:
        self._parameters = parameters
        self._law = law
        self._follows_roll = follows_roll
        roll = parameters.roll
        self._residual_sd = roll.rest if follows_roll else roll.alone
        self._rate_per_s = math.sqrt(3.0) / (roll.rest_time_s if follows_roll else roll.alone_time_s)

    def start(self) -> tuple[Array, Array]:
        """Return the states at the start, and their variances."""
        trace, roll, law = self._parameters.trace, self._parameters.roll, self._law
        gain, gain_rad2 = (roll.gain, roll.gain_sd**2) if self._follows_roll else (0.0, 0.0)
        values = (0.0, 0.0, 0.0, trace.offset_rad, gain, law.first, law.second)
        variances = (
            *self._residual_variances(),
            trace.noise_rad**2,
            trace.offset_sd_rad**2,
            gain_rad2 + CERTAIN,
            law.first_sd**2 + CERTAIN,
            law.second_sd**2 + CERTAIN,
        )
        return np.array(values), np.array(variances)

    def _residual_variances(self) -> tuple[float, float]:
        """Return the stationary variances of the slip angle's residual and of its rate."""
        return self._residual_sd**2, (self._residual_sd * self._rate_per_s) ** 2

    def drift(self, values: Array, tilt: Tilt) -> float:
        """Return the slip angle of the wheels in rad: the roll's share and the residual."""
        beta = float(values[GAIN]) * tilt.expected_drift_rad + float(values[RESIDUAL])
        return min(max(beta, -SCOMP.motion.largest_drift_rad), SCOMP.motion.largest_drift_rad)

    def slip(self, values: Array, tilt: Tilt) -> float:
        """Return the slip ratio of the rover, eq 3, in the direction in which the wheels roll."""
        beta = self.drift(values, tilt)
        return self._law.slip_at(beta, tilt.pitch_rad, float(values[FIRST]), float(values[SECOND]))

    def predict(self, values: Array, tilt: Tilt, duration_s: float) -> Prediction:
        """Return the states after a time, and the motion for a metre of the wheels."""
        beta = self.drift(values, tilt)
        travel, over = self._travel(values, tilt)
        by_state = np.zeros(STATES, dtype=complex)
        for index, slope in over.items():
            by_state[index] = slope
        trace_time_s = self._parameters.trace.noise_time_s
        residual = self._residual_transition(duration_s)
        transition = np.eye(STATES)
        transition[RESIDUALS, RESIDUALS] = residual
        transition[TRACE_NOISE, TRACE_NOISE] = math.exp(-duration_s / trace_time_s)
        noise = np.zeros((STATES, STATES))
        spread = np.diag(self._residual_variances())
        noise[RESIDUALS, RESIDUALS] = spread - product(product(residual, spread), residual.T)
        trace_rad2 = self._parameters.trace.noise_rad**2
        noise[TRACE_NOISE, TRACE_NOISE] = trace_rad2 * -math.expm1(-2.0 * duration_s / trace_time_s)
        noise[FIRST, FIRST] = SCOMP.motion.first_walk_sqrt_m**2
        # The slip fluctuates fast against the drive: white noise with the same effect on the position.
        size, time_s = self._law.fluctuation
        direction = np.array([1.0, math.tan(beta)])
        return Prediction(
            travel=travel,
            slopes=by_state,
            spread_s=size**2 * 2.0 * time_s * np.outer(direction, direction),
            transition=transition,
            noise=noise,
        )

    def _travel(self, values: Array, tilt: Tilt) -> tuple[complex, dict[int, complex]]:
        """Return the travel for a metre, and its slopes over the states."""
        beta = self.drift(values, tilt)
        slip, over_beta, over_first, over_second = slopes(
            self._law, beta, tilt.pitch_rad, float(values[FIRST]), float(values[SECOND])
        )
        direction = complex(1.0, math.tan(beta))
        by_beta = -over_beta * direction + 1j * (1.0 - slip) * (1.0 + math.tan(beta) ** 2)
        return (1.0 - slip) * direction, {
            RESIDUAL: by_beta,
            GAIN: by_beta * tilt.expected_drift_rad,
            FIRST: -over_first * direction,
            SECOND: -over_second * direction,
        }

    def _residual_transition(self, dt_s: float) -> Array:
        """Return the transition of the residual and its rate: a Matern process of order 3/2."""
        rate = self._rate_per_s
        return math.exp(-rate * dt_s) * np.array(
            [[1.0 + rate * dt_s, dt_s], [-(rate**2) * dt_s, 1.0 - rate * dt_s]]
        )
