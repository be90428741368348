"""Whether the ground is a surface of the map: an innovation test of the drive force. Plain floats.

The map has for each surface the expected drive force in each direction, its scatter from one half second to
the next, and that of its mean from run to run. Over a few seconds the level of the difference between
measured and expected force, and its scatter, show which surfaces are possible. A force shows no more: in
steady travel it is the resistance of the ground, and the stiffness of the contact, which decides the slip, is
not in it. So firm ground with resistance is possible at any force, unless the user has named the surfaces.
"""

import math
import statistics
from collections import deque
from typing import NamedTuple

from controllers.slip.effort.parameters import EFFORT
from controllers.slip.effort.surface_map import ForceWindow, SurfaceMap, SurfaceModel

FIRM = "firm ground with resistance"


class KnownSurface(NamedTuple):
    """Slip by the surfaces that fit the drive force.

    Attributes:
        slip: Slip ratio of the whole rover, mean of the surfaces that fit.
        drift_rad: Angle from the encoders' course to the true course, positive to the left.
        sd: Standard deviation of the slip.
        reason: Why it is not valid; empty where it is.
    """

    slip: float
    drift_rad: float
    sd: float
    reason: str


class SurfaceRecognition:
    """Compares drive forces with those of the known surfaces.

    A verdict needs `least_windows` half seconds that fit. One that fits no possible surface ends it at once.

    Args:
        surface_map: The known surfaces.
        are_named: Whether the user has named them, so that there are no others.
    """

    def __init__(self, surface_map: SurfaceMap, *, are_named: bool) -> None:
        self._map = surface_map
        self._are_named = are_named
        self._windows: deque[ForceWindow] = deque(maxlen=EFFORT.recognition.windows)
        self._possible = surface_map.surfaces

    def forget(self) -> None:
        """Forget all half seconds: the ground may be another one now."""
        self._windows.clear()
        self._possible = self._map.surfaces

    def step(self, window: ForceWindow) -> KnownSurface:
        """Take the drive force of one half second; return slip and verdict."""
        if window.problem:
            return _unknown(window.problem)
        fitting = [one for one in self._map.surfaces if self._fits_now(one, window)]
        if not any(one in self._possible for one in fitting):
            self._windows.clear()
        self._windows.append(window)
        self._possible = tuple(one for one in self._map.surfaces if self._fits(one))
        if not self._possible:
            return _unknown(
                f"unknown surface: drive force {window.force_n:.1f} N fits none in level and scatter"
            )
        if len(self._windows) < EFFORT.recognition.least_windows:
            return _unknown("surface not yet recognised")
        return self._verdict(window)

    def _verdict(self, window: ForceWindow) -> KnownSurface:
        speeds = [one.held_speed_m_s(window.speed_m_s) for one in self._possible]
        pairs = list(zip(self._possible, speeds, strict=True))
        slips = [one.slip.at(window.direction_rad, speed) for one, speed in pairs]
        drifts = [one.drift_rad.at(window.direction_rad, speed) for one, speed in pairs]
        slip = min(max(statistics.fmean(slips), 0.0), 1.0)
        others = slips if self._are_named else [*slips, 0.0]
        sd = math.hypot(EFFORT.recognition.slip_sd, max(others) - min(others))
        reason = ""
        if sd > EFFORT.recognition.greatest_sd:
            names = [f"{one.name} (slip {each:.2f})" for one, each in zip(self._possible, slips, strict=True)]
            names += [] if self._are_named else [FIRM]
            reason = f"drive force {window.force_n:.1f} N fits {', '.join(names)}"
        return KnownSurface(slip, statistics.fmean(drifts), sd, reason)

    def _fits_now(self, surface: SurfaceModel, window: ForceWindow) -> bool:
        sd_n = math.hypot(surface.force_window_sd_n, surface.force_run_sd_n)
        return abs(_excess_n(surface, window)) <= EFFORT.recognition.deviations * sd_n

    def _fits(self, surface: SurfaceModel) -> bool:
        """Return whether level and scatter of all windows together fit a surface."""
        excess_n = [_excess_n(surface, window) for window in self._windows]
        count = len(excess_n)
        level_sd_n = math.hypot(surface.force_window_sd_n / math.sqrt(count), surface.force_run_sd_n)
        if abs(statistics.fmean(excess_n)) > EFFORT.recognition.deviations * level_sd_n:
            return False
        greatest_n = EFFORT.recognition.scatter * surface.force_window_sd_n
        return count < 2 or statistics.stdev(excess_n) <= greatest_n


def _excess_n(surface: SurfaceModel, window: ForceWindow) -> float:
    expected_n = surface.force_n.at(window.direction_rad, surface.held_speed_m_s(window.speed_m_s))
    return window.force_n - expected_n


def _unknown(reason: str) -> KnownSurface:
    return KnownSurface(0.0, 0.0, 1.0, reason)
