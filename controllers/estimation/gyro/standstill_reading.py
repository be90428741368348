"""Reading of the gyro while the rover is at standstill."""

from dataclasses import dataclass

import numpy as np

from controllers.estimation.filter.measurement_model import Array, Expected, Measured
from controllers.estimation.filter.state_layout import BIAS


@dataclass(frozen=True, slots=True, kw_only=True)
class GyroAtStandstill:
    """Yaw rate of a rover at standstill.

        r = b

    with the bias b of the gyro.

    Attributes:
        device: Name of the gyro.
        sd_rad_s: Standard deviation of a reading.
    """

    device: str
    sd_rad_s: float

    @property
    def names(self) -> tuple[Measured, ...]:
        """Of the rate."""
        return (Measured(self.device, "standstill"),)

    @property
    def angles(self) -> tuple[int, ...]:
        """None."""
        return ()

    def predict(self, state: Array) -> Expected:
        """Return the expected rate."""
        row = np.zeros((1, len(state)))
        row[0, BIAS] = 1.0
        return Expected(state[BIAS : BIAS + 1].copy(), row, np.array([self.sd_rad_s**2]))
