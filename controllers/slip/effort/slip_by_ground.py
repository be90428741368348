"""Slip of the rover by the motion over the ground that a camera has measured."""

import cmath
import math

from controllers.estimation.ground.travel import GroundPair
from controllers.slip.effort.parameters import EFFORT
from controllers.slip.effort.slip_by_fixes import SlipAtForce


class SlipByGround:
    """Joins successive pairs until their travel makes the noise small.

    Travel is added up in the body frame, so a curve is no slip. A gap or a pair that contradicts the wheels
    begins anew. The error of the camera's rig is in the deviation, though it is the same in all labels.
    """

    def __init__(self) -> None:
        self._begin_anew()

    def _begin_anew(self) -> None:
        self._from_ns: int | None = None
        self._to_ns = 0
        self._rolled_m = self._ground_m = 0j
        self._travel_m = self._noise_m2 = self._scale_sd = 0.0

    def take(self, pair: GroundPair) -> SlipAtForce | None:
        """Take a pair; return the slip since the begin, None where the travel is too short."""
        is_valid = pair.fault is None and pair.motion.is_valid
        if self._from_ns is None or pair.motion.from_ns != self._to_ns or not is_valid:
            self._begin_anew()
        if not is_valid:
            return None
        self._from_ns = pair.motion.from_ns if self._from_ns is None else self._from_ns
        self._to_ns = pair.motion.to_ns
        self._rolled_m += pair.rolled_m
        self._ground_m += pair.ground_m
        self._travel_m += abs(pair.rolled_m)
        self._noise_m2 += pair.sd_m**2
        self._scale_sd = pair.motion.scale_sd
        numbers, noise_m = EFFORT.fixes, math.sqrt(self._noise_m2)
        if self._travel_m < max(EFFORT.free.window_m, noise_m / numbers.greatest_sd):
            return None
        slip = self._slip(noise_m)
        self._begin_anew()
        return slip

    def _slip(self, noise_m: float) -> SlipAtForce | None:
        straight_m = abs(self._rolled_m)
        if self._from_ns is None or straight_m < EFFORT.fixes.straightness * self._travel_m:
            return None
        moved = self._ground_m / self._rolled_m
        beyond = EFFORT.fixes.deviations * EFFORT.fixes.greatest_sd
        if not -beyond <= 1.0 - abs(moved) <= 1.0:
            return None
        return SlipAtForce(
            force_n=None,
            slip=min(max(1.0 - abs(moved), 0.0), 1.0),
            slip_sd=math.hypot(noise_m / straight_m, self._scale_sd * abs(moved)),
            from_ns=self._from_ns,
            to_ns=self._to_ns,
            travel_m=self._travel_m,
            drift_rad=cmath.phase(moved) if abs(self._ground_m) > EFFORT.fixes.deviations * noise_m else None,
        )
