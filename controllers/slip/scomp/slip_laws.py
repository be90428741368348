"""Slip of the rover: from its pitch by the combined-slip model, or by the two-segment law alone."""

import math
from typing import Protocol

from controllers.slip.scomp.parameters import ScompParameters

STEP = 1e-5


class SlipLaw(Protocol):
    """Slip as a function of slip angle and pitch, with two parameters that can be adapted while driving.

    Attributes:
        first: First parameter at start.
        first_sd: Its standard deviation.
        second: Second parameter at start.
        second_sd: Its standard deviation.
        fluctuation: Standard deviation of the slip about the law, and its correlation time in s.
    """

    first: float
    first_sd: float
    second: float
    second_sd: float
    fluctuation: tuple[float, float]

    def slip_at(self, slip_angle_rad: float, pitch_rad: float, first: float, second: float) -> float:
        """Return the slip ratio."""
        ...


class PitchLaw:
    """R_x / W = sin(pitch) + c_rr, eqs 7-8 solved for the slip.

    Adapts c_rr, and the logarithm of C_x beyond what follows from c_rr by `stiffness_follows`.
    """

    def __init__(self, parameters: ScompParameters) -> None:
        settings = parameters.pitch
        self._model = settings.model
        self._sign = settings.pitch_sign
        self.first, self.first_sd = settings.rolling_resistance, settings.rolling_resistance_sd
        self.second, self.second_sd = math.log(settings.model.c_x_n), settings.stiffness_sd
        self._follows = settings.stiffness_follows
        self.fluctuation = (settings.fluctuation, settings.fluctuation_time_s)

    def slip_at(self, slip_angle_rad: float, pitch_rad: float, first: float, second: float) -> float:
        """Return the slip ratio at which the wheels pull the rover's weight and overcome its resistance."""
        traction = self._sign * math.sin(pitch_rad) + first
        stiffness_n = math.exp(second + self._follows * (first - self.first))
        return self._model.slip_at(traction, slip_angle_rad, stiffness_n)


class TwoSegmentLaw:
    """Eq 12 with |beta|; adapts s_x0 and k. The fluctuation covers the unknown effect of the pitch."""

    def __init__(self, parameters: ScompParameters) -> None:
        law = parameters.two_segment_slip
        self._corner_rad = law.beta_0_rad
        self.first, self.first_sd = law.slip_0, 0.05
        self.second, self.second_sd = law.k_per_rad, 0.2
        self.fluctuation = (max(law.rms, 0.05), parameters.pitch.fluctuation_time_s)

    def slip_at(self, slip_angle_rad: float, pitch_rad: float, first: float, second: float) -> float:
        """Return the slip ratio; the pitch has no effect."""
        return min(1.0, first + second * max(0.0, abs(slip_angle_rad) - self._corner_rad))


def slopes(
    law: SlipLaw, slip_angle_rad: float, pitch_rad: float, first: float, second: float
) -> tuple[float, float, float, float]:
    """Return the slip, and its slopes over slip angle, first and second parameter."""
    slip = law.slip_at(slip_angle_rad, pitch_rad, first, second)
    return (
        slip,
        (law.slip_at(slip_angle_rad + STEP, pitch_rad, first, second) - slip) / STEP,
        (law.slip_at(slip_angle_rad, pitch_rad, first + STEP, second) - slip) / STEP,
        (law.slip_at(slip_angle_rad, pitch_rad, first, second + STEP) - slip) / STEP,
    )
