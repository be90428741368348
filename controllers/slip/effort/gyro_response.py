"""How a gyro follows a turn: gain, delay and first-order lag, as identified by `rover-hil calibrate imu`.

g exp(-s T) / (1 + s tau) with tau = 1 / (2 pi bandwidth). A gyro with a low-pass or a delay and a contact
that slips change a small oscillation in the same way, so the constants must be known before slip is read
from it.
"""

import cmath
import math
from typing import Annotated

from pydantic import Field

from drivers.settings import Settings


class GyroResponse(Settings):
    """Constants of the gyro and their standard deviations.

    Attributes:
        source: The log that they were identified from.
        identified_on: Day of the identification, as 2026-01-31.
        gain: Reading over true yaw rate of slow turns, by the geometry of the wheels; 0.5 to 2.
        gain_sd: Its standard deviation.
        delay_s: From the turn to the time stamp of its reading, beside the lag. Negative where the age of the
            wheels' positions is greater than their device states.
        delay_sd_s: Its standard deviation.
        bandwidth_hz: At which a first-order low-pass has lost 3 dB; greater ones cannot be distinguished from
            none, and are given as 200.
        bandwidth_sd_hz: Its standard deviation.
    """

    source: str
    identified_on: str
    gain: Annotated[float, Field(ge=0.5, le=2.0)] = 1.0
    gain_sd: Annotated[float, Field(ge=0.0, le=1.0)] = 0.0
    delay_s: Annotated[float, Field(ge=-0.1, le=0.3)] = 0.0
    delay_sd_s: Annotated[float, Field(ge=0.0, le=0.3)] = 0.0
    bandwidth_hz: Annotated[float, Field(ge=0.5, le=200.0)] = 200.0
    bandwidth_sd_hz: Annotated[float, Field(ge=0.0, le=200.0)] = 0.0

    def at(self, frequency_hz: float) -> complex:
        """Return reading over true yaw rate of an oscillation, as a complex number."""
        turning = math.tau * frequency_hz
        lag = 1.0 + 1j * frequency_hz / self.bandwidth_hz
        return self.gain * cmath.exp(-1j * turning * self.delay_s) / lag

    def lag_s(self, frequency_hz: float) -> float:
        """Return the time by which the reading of an oscillation is late, delay and low-pass together."""
        low_pass_rad = math.atan2(frequency_hz, self.bandwidth_hz)
        return self.delay_s + low_pass_rad / (math.tau * frequency_hz)
