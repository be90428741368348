"""Relation of the positions by a device to dead reckoning: do both move alike?"""

import cmath
import math
from collections import deque

from controllers.estimation.settings import FilterSettings
from controllers.estimation.slip_prior import UNKNOWN, SlipPrior
from drivers.record import record

WINDOW = 8.0
"""Positions are compared with those on a path behind them: so many times the distance of the slip."""

SPACING = 0.2
"""Of it between two that are kept."""

NOISE_SD = 2.0
"""A difference of so many deviations of two positions is noise, and not doubted."""

EXPECTED_SD = 1.645
"""A difference within so many deviations of slip and noise is no conflict: nine in ten along the travel."""

UNEXPECTED_SD = math.sqrt(-2.0 * math.log(0.05))
"""One beyond so many of the slip and beyond the noise is reported: outside the 95 % region of both."""

ALIKE = math.cos(math.pi / 4.0)
"""Only travel within 45 deg of the direction of a doubt, or of the opposite one, ends it."""

APART_SD = 2.0
"""The other place is so many standard deviations off the estimate: in the 95 % region, which reaches 2.4."""


FAR_SPACING_M = 0.1
"""Path between the newest two places that are kept for `PositionRelation.compare`."""

FAR_SHARE = 0.2
"""Path between two of them that are older, as a share of the path since then."""


@record(frozen=True, slots=True, kw_only=True)
class _Place:
    """Where the device was, by itself and by dead reckoning.

    Attributes:
        place_m: By itself, on its own axes.
        reckoned_m: By dead reckoning, in the local frame.
        std_m: Deviation of a position, per axis.
        path_m: Rolled by the wheels until then, and what was not measured.
    """

    place_m: complex
    reckoned_m: complex
    std_m: float
    path_m: float


@record(frozen=True, slots=True, kw_only=True)
class _Axes:
    """Turns the axes of a device onto those of the local frame.

    Attributes:
        turn: As a number of magnitude 1.
        sd_rad: Standard deviation of its angle.
    """

    turn: complex
    sd_rad: float

    def apart_m(self, now: _Place, before: _Place) -> complex:
        """Return the way by the device less that by dead reckoning, in the local frame."""
        return self.turn * (now.place_m - before.place_m) - (now.reckoned_m - before.reckoned_m)


class PositionRelation:
    """Compares the motion by positions with that by wheels and gyro, over a path.

    Assumed: the wheels slip by a share of their travel that changes slowly, as the filter assumes, and not
    backwards; the noise of the positions is known; the yaw is as uncertain as the filter says. A difference
    that this slip does not explain has two explanations: more slip, or wrong positions. Until both move alike
    again along the difference, the positions may be wrong by all of it. Wheels that slip by more than the
    filter expects all the time so leave the region as large as what they have lost.

    Slip never moves the rover farther than the wheels roll: beyond that the positions are wrong, or the rover
    was carried. Of positions with a yaw only that is doubted, until the rover has driven on.

    Args:
        settings: Distance over which places are compared.
        gate_sd: Noise is smaller than so many of its standard deviations.
        prior: Slip that is expected.

    Attributes:
        doubted_m: By how much the positions may be wrong, in the local frame; 0 without a conflict.
        grown_m2: Square of its change with the newest place, beyond what the wheels rolled, and the noise.
        impossible_m: Difference of the newest place where it is larger than the way that the wheels rolled;
            else 0.
        is_unexpected: Whether the difference is larger than the expected slip makes it.
        apart_m: Difference of the travel that `compare` has found.
        apart_path_m: Path over which it is.
    """

    def __init__(self, settings: FilterSettings, gate_sd: float, prior: SlipPrior = UNKNOWN) -> None:
        self._prior, self._slip_distance_m = prior, settings.slip_distance_m
        self._gate_sd = gate_sd
        self._far: list[_Place] = []
        self.apart_m = self.apart_path_m = 0.0
        self._axes = _Axes(turn=1.0 + 0j, sd_rad=math.pi)
        self._places: deque[_Place] = deque()
        self._begin: _Place | None = None
        self._newest: _Place | None = None
        self._impossible_path_m = 0.0
        self.doubted_m = self.impossible_m = 0j
        self.grown_m2 = 0.0
        self.is_unexpected = False

    def take(
        self,
        place_m: complex,
        reckoned_m: complex,
        std_m: float,
        path_m: float,
        *,
        axes: complex,
        yaw_sd_rad: float,
        has_yaw: bool,
    ) -> None:
        """Take a position; one that is not finite has no effect.

        Args:
            place_m: By the device, on its own axes.
            reckoned_m: Of the same place by dead reckoning, without a correction of the place.
            std_m: Deviation of the position alone, per axis.
            path_m: Rolled by the wheels until then, and what was not measured.
            axes: Turns the axes of the device onto those of the local frame.
            yaw_sd_rad: Standard deviation of this angle and of the yaw together.
            has_yaw: Whether the yaw was measured, too.
        """
        self.impossible_m, self.grown_m2 = 0j, 0.0
        if not (cmath.isfinite(place_m) and math.isfinite(std_m)):
            return  # the filter rejects it, too
        rolled_m = 0.0 if self._newest is None else path_m - self._newest.path_m
        now = self._newest = _Place(place_m=place_m, reckoned_m=reckoned_m, std_m=std_m, path_m=path_m)
        turned = self._axes = _Axes(turn=axes, sd_rad=yaw_sd_rad)
        while self._places and path_m - self._places[0].path_m > WINDOW * self._slip_distance_m:
            self._places.popleft()
        apart_m = (
            turned.apart_m(now, each) for each in self._places if self._is_impossible(now, each, turned)
        )
        self.impossible_m = max(apart_m, key=abs, default=0j)
        if has_yaw:
            self._doubt_impossible(path_m)
        else:
            self._doubt(now, turned, rolled_m)

    def keep(self) -> None:
        """Compare later places with the newest, too: it was used."""
        now, places = self._newest, self._places
        spacing_m = SPACING * self._slip_distance_m
        if now is not None and not (places and now.path_m - places[-1].path_m < max(spacing_m, now.std_m)):
            places.append(now)

    def jump(self, jumped_m: complex, axes: complex) -> None:
        """Compare later places with the newest only: the positions have jumped to it; a doubt stays."""
        self._places.clear()
        self.keep()
        if self._begin is not None:
            shift_m = jumped_m * axes.conjugate()
            self._begin = _Place(
                place_m=self._begin.place_m + shift_m,
                reckoned_m=self._begin.reckoned_m,
                std_m=self._begin.std_m,
                path_m=self._begin.path_m,
            )

    def compare(self, prior: SlipPrior) -> tuple[float, float]:
        """Return how far the newest place is off, by the places at ever greater distances behind it.

        Args:
            prior: Slip that is assumed.

        Returns:
            Greatest difference of the travel in standard deviations, and this difference in m.
        """
        now = self._newest
        if now is None:
            return 0.0, 0.0
        found = (
            (
                self._deviations(now, far, self._axes, prior),
                abs(self._axes.apart_m(now, far)),
                now.path_m - far.path_m,
            )
            for far in self._far
        )
        deviations, self.apart_m, self.apart_path_m = max(found, default=(0.0, 0.0, 0.0))
        if not self._far or now.path_m - self._far[-1].path_m > max(FAR_SPACING_M, now.std_m):
            self._far = [*_thinned(self._far, now.path_m), now]
        return deviations, self.apart_m

    def _doubt_impossible(self, path_m: float) -> None:
        if self.impossible_m:
            self._impossible_path_m = path_m
            self.doubted_m = max(self.doubted_m, self.impossible_m, key=abs)
        elif path_m - self._impossible_path_m > self._least_m:
            self.doubted_m = 0j

    def _doubt(self, now: _Place, axes: _Axes, rolled_m: float) -> None:
        before_m = self.doubted_m
        if self._begin is None:
            self._begin = self._find_conflict(now, axes)
        elif self._moves_alike(now, self._begin, axes):
            self._begin, self.doubted_m, self.is_unexpected = None, 0j, False
        if self._begin is None:
            return
        self.doubted_m = axes.apart_m(now, self._begin) * self._beyond(now, self._begin, axes, NOISE_SD)
        grown_m = max(0.0, abs(self.doubted_m - before_m) - rolled_m)
        self.grown_m2 = max(0.0, grown_m**2 - 2.0 * now.std_m**2)
        places = (self._begin, *self._places)
        self.is_unexpected |= any(self._is_unexpected(now, each, axes) for each in places)

    def _find_conflict(self, now: _Place, axes: _Axes) -> _Place | None:
        """Return the place since which the difference is least expected; None where slip explains it."""
        found = [(self._deviations(now, before, axes, self._prior), before) for before in self._places]
        deviations, worst = max(found, key=lambda each: each[0], default=(0.0, None))
        return worst if deviations > EXPECTED_SD else None

    def _moves_alike(self, now: _Place, begin: _Place, axes: _Axes) -> bool:
        """Return whether the newest travel, twice the distance of the slip, agrees along the doubt."""
        newest = (each for each in reversed(self._places) if now.path_m - each.path_m >= self._least_m)
        before = next(newest, None)
        if before is None or before.path_m < begin.path_m:
            return False
        travel_m = now.reckoned_m - before.reckoned_m
        along_m2 = abs((travel_m * self.doubted_m.conjugate()).real)
        is_along = along_m2 >= ALIKE * abs(travel_m) * abs(self.doubted_m)
        return is_along and self._deviations(now, before, axes, self._prior) < EXPECTED_SD

    @property
    def _least_m(self) -> float:
        return 2.0 * self._slip_distance_m

    def _is_impossible(self, now: _Place, before: _Place, axes: _Axes) -> bool:
        noise_m = self._gate_sd * math.hypot(now.std_m, before.std_m)
        return abs(axes.apart_m(now, before)) > now.path_m - before.path_m + noise_m

    def _is_unexpected(self, now: _Place, before: _Place, axes: _Axes) -> bool:
        share = self._beyond(now, before, axes, self._gate_sd)
        return self._deviations(now, before, axes, self._prior, share) > UNEXPECTED_SD

    def _beyond(self, now: _Place, before: _Place, axes: _Axes, noise_sd: float) -> float:
        """Return the share of a difference beyond so many deviations of the noise, 0 to 1."""
        apart_m = abs(axes.apart_m(now, before))
        return max(0.0, 1.0 - noise_sd * math.hypot(now.std_m, before.std_m) / apart_m) if apart_m else 0.0

    def _deviations(
        self, now: _Place, before: _Place, axes: _Axes, prior: SlipPrior, share: float = 1.0
    ) -> float:
        """Return a share of the difference over what is expected: the root of squares along and across.

        Only across the travel a wrong yaw shifts the place.
        """
        travel_m = now.reckoned_m - before.reckoned_m
        path_m = now.path_m - before.path_m
        ways_m2 = _integrated_m2(path_m, prior.distance_m)
        local_m2 = _integrated_m2(path_m, self._slip_distance_m)
        noise_m2 = now.std_m**2 + before.std_m**2 + (prior.noise_m_sqrt_m or 0.0) ** 2 * path_m
        along_m2 = prior.sd**2 * ways_m2 + prior.local_sd**2 * local_m2 + noise_m2
        slip_m2 = prior.cross_sd**2 * ways_m2 + prior.local_cross_sd**2 * local_m2
        across_m2 = slip_m2 + noise_m2 + (axes.sd_rad * abs(travel_m)) ** 2
        apart_m = share * axes.apart_m(now, before)
        if travel_m:
            apart_m *= travel_m.conjugate() / abs(travel_m)
        return math.sqrt(apart_m.real**2 / along_m2 + apart_m.imag**2 / across_m2)


def _integrated_m2(path_m: float, distance_m: float) -> float:
    """Return the variance of the integral of a Gauss-Markov process of variance 1 over a path."""
    share = path_m / distance_m
    return 2.0 * distance_m**2 * (share + math.expm1(-share))


def _thinned(places: list[_Place], path_m: float) -> list[_Place]:
    """Return places without those that are close to each other, measured by the path since them."""
    kept = places[:1]
    for place, following in zip(places[1:], [*places[2:], None], strict=False):
        is_close = following is not None and following.path_m - kept[-1].path_m < FAR_SHARE * (
            path_m - following.path_m
        )
        if not is_close:
            kept.append(place)
    return kept
