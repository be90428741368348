"""What is known of the slip on the present ground without the excitation: by the map, or learned."""

import statistics
from dataclasses import dataclass
from enum import StrEnum

from controllers.slip.effort.learned_curve import LearnedCurve
from controllers.slip.effort.parameters import EFFORT
from controllers.slip.effort.surface_map import ForceWindow, SurfaceMap
from controllers.slip.effort.surface_recognition import SurfaceRecognition

GYRO_WAS_WRONG = "the gyro was wrong"
NO_FORCE = "drive force unknown for too long"


class SlipSource(StrEnum):
    """Where the slip in use comes from, in the order of preference."""

    GROUND = "ground motion"
    EXCITATION = "excitation"
    MAP = "map"
    LEARNED = "learned"
    HELD = "held"
    UNKNOWN = "unknown"
    ENCODERS = "encoders"


@dataclass(frozen=True, slots=True, kw_only=True)
class KnownSlip:
    """Slip by the drive force.

    Attributes:
        slip: Slip ratio of the whole rover, 0 to 1.
        drift_rad: Angle from the encoders' course to the true course, positive to the left.
        sd: Standard deviation of the slip; 1 where it is not valid.
        source: `MAP` or `LEARNED`; `ENCODERS` where it is not valid.
        reason: Why it is not valid; empty where it is.
    """

    slip: float
    drift_rad: float
    sd: float
    source: SlipSource
    reason: str


class GroundKnowledge:
    """Recognises the surfaces of the map, and learns the slip over force of the ground where asked to.

    A surface counts as recognised only while it agrees with what was learned here.

    Args:
        surfaces: The known surfaces.
        are_named: Whether the user has named them, so that there are no others.
        learns: Whether slip over force is learned.
    """

    def __init__(self, surfaces: SurfaceMap, *, are_named: bool, learns: bool) -> None:
        self._recognition = SurfaceRecognition(surfaces, are_named=are_named)
        scatter_n = statistics.fmean(one.force_window_sd_n for one in surfaces.surfaces)
        self._curve = LearnedCurve(EFFORT.learning.jump_deviations * scatter_n) if learns else None
        self._window: ForceWindow | None = None
        self._age_s = 0.0
        self._usable_age_s = 0.0  # of the newest half second that showed the ground
        self._known = _unknown("too little way so far")

    @property
    def known(self) -> KnownSlip:
        """Slip by the newest drive force, unless that is too old."""
        if self._known.reason or self._age_s <= EFFORT.surface.greatest_age_s:
            return self._known
        return _unknown(NO_FORCE)

    def move(self, elapsed_s: float, distance_m: float) -> None:
        """Take a time and the distance that the wheels travelled in it."""
        self._age_s += elapsed_s
        self._usable_age_s += elapsed_s
        if self._usable_age_s > EFFORT.surface.greatest_age_s:
            self._recognition.forget()
        if self._curve is not None:
            self._curve.move(distance_m)

    def forget_gyro(self) -> None:
        """Forget the learned curve: the excitation that taught it is read from the gyro."""
        if self._curve is not None:
            self._curve.forget()
        if self._known.source is SlipSource.LEARNED:
            self._known = _unknown(GYRO_WAS_WRONG)

    def learn(self, slip: float, force_n: float | None = None) -> None:
        """Take a slip that was measured otherwise.

        Args:
            slip: Slip ratio of the rover.
            force_n: Drive force during it; None for that of the newest half second.
        """
        if force_n is None and self._age_s < EFFORT.surface.window_s and self._window is not None:
            force_n = None if self._window.problem else self._window.force_n
        if self._curve is not None and force_n is not None:
            self._curve.learn(force_n, slip)

    def step(self, window: ForceWindow) -> KnownSlip:
        """Take the drive force of one half second; return the slip."""
        self._window, self._age_s = window, 0.0
        if not window.problem:
            self._usable_age_s = 0.0
        recognised = self._recognition.step(window)
        by_map = KnownSlip(
            slip=recognised.slip,
            drift_rad=recognised.drift_rad,
            sd=recognised.sd,
            source=SlipSource.MAP,
            reason=recognised.reason,
        )
        self._known = self._choose(by_map, window)
        return self._known

    def _choose(self, by_map: KnownSlip, window: ForceWindow) -> KnownSlip:
        if self._curve is None or window.problem:
            return _unknown(by_map.reason) if by_map.reason else by_map
        learned = self._curve.at(window.force_n)
        if learned.reason:
            return _unknown(by_map.reason) if by_map.reason else by_map
        if not by_map.reason and abs(by_map.slip - learned.slip) <= max(
            EFFORT.recognition.contradiction, learned.sd
        ):
            return by_map
        return KnownSlip(
            slip=learned.slip, drift_rad=0.0, sd=learned.sd, source=SlipSource.LEARNED, reason=""
        )


def _unknown(reason: str) -> KnownSlip:
    return KnownSlip(slip=0.0, drift_rad=0.0, sd=1.0, source=SlipSource.ENCODERS, reason=reason)
