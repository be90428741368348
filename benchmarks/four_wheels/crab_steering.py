"""Keeps a rover with four steered wheels on its line by crabbing against the slip angle."""

import math
from dataclasses import dataclass

STEEPEST_RETURN_RAD = 0.3


@dataclass(frozen=True, slots=True, kw_only=True)
class CrabGains:
    """How it steers.

    Attributes:
        return_rad_m: Course back to the line per distance from it.
        drift_time_s: Time constant of the filter on the slip angle of the wheels.
        greatest_steer_rad: Limit of the steering angle.
    """

    return_rad_m: float = 0.8
    drift_time_s: float = 1.0
    greatest_steer_rad: float = 0.6


class CrabSteering:
    """Finds the one angle by which all wheels are steered.

    The course over ground is heading + steering angle + drift of the steered wheels (eq 1 of paper 000, for
    wheels that are steered alike). The drift is the seen direction of travel less the steering angle; course
    times speed gives the distance from the line, so that an error of the past is driven off.

    Args:
        gains: How it steers.
    """

    def __init__(self, gains: CrabGains) -> None:
        self._gains = gains
        self._drift_rad = 0.0
        self._steer_rad = 0.0
        self._left_of_line_m = 0.0

    @property
    def left_of_line_m(self) -> float:
        """Estimated distance from the line, positive to the left."""
        return self._left_of_line_m

    def step(
        self, duration_s: float, speed_m_s: float, heading_rad: float, travel_rad: float | None
    ) -> float:
        """Return the steering angle for all wheels in rad, counter-clockwise.

        Args:
            duration_s: Since the last call, above 0.
            speed_m_s: Over ground, slip taken off.
            heading_rad: Of the body against the line.
            travel_rad: Direction of the centre's velocity against the body; None where nothing shows it, and
                the drift seen last stays.
        """
        gains = self._gains
        if travel_rad is not None and speed_m_s > 0.0:
            share = 1.0 - math.exp(-duration_s / gains.drift_time_s)
            self._drift_rad += share * (travel_rad - self._steer_rad - self._drift_rad)
        course_rad = heading_rad + (self._steer_rad + self._drift_rad if travel_rad is None else travel_rad)
        self._left_of_line_m += duration_s * speed_m_s * math.sin(course_rad)
        wanted_rad = -gains.return_rad_m * self._left_of_line_m
        wanted_rad = min(max(wanted_rad, -STEEPEST_RETURN_RAD), STEEPEST_RETURN_RAD)
        steer_rad = wanted_rad - heading_rad - self._drift_rad
        self._steer_rad = min(max(steer_rad, -gains.greatest_steer_rad), gains.greatest_steer_rad)
        return self._steer_rad
