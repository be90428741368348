"""Jumps of a device that gives places: more than the rover can have moved meanwhile."""

import math

from drivers.record import record


@record(frozen=True, slots=True, kw_only=True)
class _Agreed:
    """A fix that agreed: what it left of its difference, its deviation, the path until then."""

    residual_m: complex
    std_m: float
    path_m: float


class PositionJumps:
    """Distinguishes a jump of the positions by one device from motion that the wheels did not measure.

    Wheels that slip wholly move the rover by their way at most. A place that changes from one fix to the next
    by more than that way and the noise of both has jumped: the receiver, by a reflection or another solution,
    or somebody has carried the rover. That later places move as the wheels do says that the receiver
    agrees with itself. It does not say which place is true.

    Places that move slowly while the wheels stand are no jump from one fix to the next, and the estimate
    would follow them. So they are compared with the first place after the wheels last rolled farther than its
    noise, too: a receiver drifts, or the rover slides or is towed.

    Args:
        gate_sd: Noise is smaller than so many of its standard deviations.

    Attributes:
        offset_m: By how much the places have jumped in the local frame since they last agreed with the
            estimate; 0 while they do. Where the rover was carried, it is this far from the estimate.
    """

    def __init__(self, gate_sd: float) -> None:
        self._gate_sd = gate_sd
        self._agreed: _Agreed | None = None
        self._stood: _Agreed | None = None
        self._residual_m: complex | None = None
        self._followed_m = 0j
        self._off_m: complex | None = None
        self._left_m = 0j
        self.offset_m = 0j

    def agree(self, residual_m: complex, std_m: float, path_m: float) -> None:
        """Take a fix that was used, as the estimate is after it; see `is_off`."""
        agreed = self._agreed = _Agreed(residual_m=residual_m, std_m=std_m, path_m=path_m)
        self._off_m = None
        if self._residual_m is not None:
            self._followed_m += self._residual_m - residual_m
        if self._stood is None or path_m - self._stood.path_m > self._gate_sd * std_m:
            self._stood, self._followed_m = agreed, 0j

    def is_off(self, residual_m: complex, std_m: float, path_m: float) -> bool:
        """Return whether a fix is off the one that agreed by more than the rover can have moved.

        After the first that is off the rover may have driven on: the next ones are off, too, while they are
        nearer to that one.

        Args:
            residual_m: Measured less expected place.
            std_m: Deviation of the fix alone, per axis.
            path_m: What the wheels have rolled until now, and what was not measured.
        """
        before, self._residual_m = self._agreed, residual_m
        if before is None:
            return False
        if self._off_m is not None:
            return abs(residual_m - self._off_m) < abs(residual_m - self._left_m)
        references = [(before, before.residual_m)]
        if self._stood is not None:
            references.append((self._stood, self._stood.residual_m - self._followed_m))
        for reference, left_m in references:
            reach_m = path_m - reference.path_m + self._gate_sd * math.hypot(std_m, reference.std_m)
            if abs(residual_m - left_m) > reach_m:
                self._off_m, self._left_m = residual_m, left_m
                return True
        self._off_m = None
        return False

    def jump(self, offset_m: complex, std_m: float) -> None:
        """Add a jump in the local frame; one that leads back within the noise ends it."""
        self._stood = None
        self.offset_m += offset_m
        if abs(self.offset_m) <= self._gate_sd * math.sqrt(2.0) * std_m:
            self.offset_m = 0j
