"""Slip, slip angle and slip law as states of the pose filter."""

import math

import numpy as np
from numpy.typing import NDArray

from controllers.estimation.filter.slip_states import SlipStep
from controllers.estimation.wheels.odometry import BodyIncrement
from controllers.matrices import complex_product, product
from controllers.slip.scomp.motion_model import FIRST, MotionModel, Tilt
from controllers.slip.scomp.parameters import SCOMP, ScompParameters
from controllers.slip.scomp.slip_laws import PitchLaw, TwoSegmentLaw

Array = NDArray[np.float64]


class ScompStates:
    """The states of slip and trace, see `motion_model.STATES`.

    The slip law is linearised anew every `SCOMP.motion.step_s`; it changes slowly and is costly.

    Args:
        parameters: Rover, ground and sensors.
        has_pitch: False where the pitch is never measured: the slip then follows the slip angle alone.
        has_roll: False where the roll is never measured.

    Attributes:
        model: Their motion model.
        needs_tilt: Whether the slip follows the pitch, or the slip angle the roll.
        tilt: For the next linearisation.
        start: Values at the start, shape (7,).
        start_variances: Their variances, shape (7,).
    """

    def __init__(self, parameters: ScompParameters, *, has_pitch: bool = True, has_roll: bool = True) -> None:
        law = PitchLaw(parameters) if has_pitch else TwoSegmentLaw(parameters)
        self.needs_tilt = has_pitch or has_roll
        self.model = MotionModel(parameters, law, follows_roll=has_roll)
        self.start, self.start_variances = self.model.start()
        self.tilt = Tilt()
        self._pending_s = math.inf
        self._pending_m = 0.0
        self._at = self.start
        self._per_m = 1.0 + 0.0j
        self._slopes = np.zeros(len(self.start), dtype=complex)
        self._spread_m2_s = np.zeros((2, 2))
        self._same = (np.eye(len(self.start)), np.zeros((len(self.start),) * 2))

    @property
    def motion_per_m(self) -> complex:
        """Motion of the body for a metre that the wheels roll, relative to their direction."""
        return self._per_m

    def take_tilt(self, pitch_rad: float, expected_drift_rad: float) -> None:
        """Take pitch and expected slip angle for the next linearisation, see `Tilt`."""
        self.tilt = Tilt(pitch_rad=pitch_rad, expected_drift_rad=expected_drift_rad)

    def slip_and_angle(self, values: Array) -> tuple[float, float]:
        """Return slip and slip angle in rad for values of the states."""
        return self.model.slip(values, self.tilt), self.model.drift(values, self.tilt)

    @property
    def expected_drift_rad(self) -> float:
        """The slip angle expected from the roll, for a gain of one."""
        return self.tilt.expected_drift_rad

    def predict(self, values: Array, increment: BodyIncrement) -> SlipStep:
        """Return the motion of the body for an increment of the wheels, see `SlipStates`."""
        rolled_m = complex(increment.x_m, increment.y_m)
        transition, noise = self._same
        if self._pending_s >= SCOMP.motion.step_s:
            transition, noise = self._linearise(values)
        self._pending_s += increment.duration_s
        self._pending_m += abs(rolled_m)
        per_m = self._per_m + complex((self._slopes * (values - self._at)).sum())
        return SlipStep(
            travel_m=rolled_m * per_m,
            slopes_m=complex_product(self._slopes, rolled_m),
            values=product(transition, values),
            transition=transition,
            noise=noise,
            travel_noise_m2=self._travel_noise_m2(rolled_m, increment.duration_s),
        )

    def _travel_noise_m2(self, rolled_m: complex, duration_s: float) -> Array:
        """Return the covariance of the travel in the body frame, turned as the travel by steered wheels."""
        distance_m = abs(rolled_m)
        if distance_m == 0.0:
            return np.zeros((2, 2))
        toward = rolled_m / distance_m
        turned = np.array([[toward.real, -toward.imag], [toward.imag, toward.real]])
        return product(product(turned, self._spread_m2_s), turned.T) * (distance_m**2 / duration_s)

    def _linearise(self, values: Array) -> tuple[Array, Array]:
        """Linearise at values; return transition and noise of the time since the last linearisation."""
        duration_s = self._pending_s if math.isfinite(self._pending_s) else SCOMP.motion.step_s
        prediction = self.model.predict(values, self.tilt, duration_s)
        self._per_m, self._slopes, self._at = prediction.travel, prediction.slopes, values
        self._spread_m2_s = prediction.spread_s
        noise = prediction.noise
        # That of a metre; it grows with the distance.
        noise[FIRST, FIRST] *= self._pending_m
        self._pending_s = self._pending_m = 0.0
        return prediction.transition, noise
