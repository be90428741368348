"""States of slip that a compensator adds to those of the pose filter."""

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from controllers.estimation.wheels.odometry import BodyIncrement

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SlipStep:
    """Motion of the body during an increment of the wheels, by n states of slip.

    Attributes:
        travel_m: In the body frame, to the left as imaginary part.
        slopes_m: Its derivatives over the states, complex, shape (n,).
        values: States after the increment, shape (n,).
        transition: Their Jacobian over the states before it, shape (n, n).
        noise: Covariance added to them, shape (n, n).
        travel_noise_m2: Covariance added to the travel, in the body frame, shape (2, 2).
    """

    travel_m: complex
    slopes_m: NDArray[np.complex128]
    values: Array
    transition: Array
    noise: Array
    travel_noise_m2: Array

    def without_travel(self, travel_m: complex) -> "SlipStep":
        """Return the step of the states alone, beside a travel on which they have no effect."""
        return replace(
            self,
            travel_m=travel_m,
            slopes_m=np.zeros_like(self.slopes_m),
            travel_noise_m2=np.zeros_like(self.travel_noise_m2),
        )


class SlipStates(Protocol):
    """States of slip, as part of the pose filter.

    Attributes:
        start: Their values at the start, shape (n,).
        start_variances: Variances of these, shape (n,).
    """

    start: Array
    start_variances: Array

    def predict(self, values: Array, increment: BodyIncrement) -> SlipStep:
        """Return the motion of the body for an increment of the wheels, and what becomes of the states."""
        ...


class SlipEstimate(Protocol):
    """What a compensator sees of the pose filter."""

    @property
    def slip_values(self) -> Array:
        """The estimated states of slip."""
        ...

    @property
    def gyro_bias_rad_s(self) -> float:
        """The estimated bias of the gyro."""
        ...
