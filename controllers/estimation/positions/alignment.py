"""Turns the axes of positions without yaw onto the path of the rover."""

import cmath
import math

LEAST_SPREAD_SD = 10.0
"""Root of the sum of squares of the spread, in standard deviations: the angle is known to 6 deg."""
LEAST_COHERENCE = 0.9
"""Square of the correlation of positions and path: noise, another drive or a wrong path has less."""
GREATEST_STRETCH = 1.5
"""Slip makes the path longer than the positions, by at most so much."""


class PathAlignment:
    """Least squares of positions and of the places on the path at the same times.

    Assumes errors of the path that grow slowly against its spread. Source: the complex form of the alignment
    of two sets of points (Umeyama 1991) without a scale.
    """

    def __init__(self) -> None:
        # Counted from the first ones: coordinates of a map are large.
        self._first: tuple[complex, complex] | None = None
        self._weight = 0.0
        self._places = self._path = self._product = 0j
        self._places2 = self._path2 = 0.0

    def take(self, place_m: complex, path_m: complex, std_m: float) -> None:
        """Take a position and the place on the path, in m; `std_m` is positive."""
        first = self._first = self._first or (place_m, path_m)
        place_m, path_m, weight = place_m - first[0], path_m - first[1], std_m**-2
        self._weight += weight
        self._places += weight * place_m
        self._path += weight * path_m
        self._product += weight * path_m.conjugate() * place_m
        self._places2 += weight * abs(place_m) ** 2
        self._path2 += weight * abs(path_m) ** 2

    @property
    def is_known(self) -> bool:
        """Whether the angle is known, and positions and path are of one shape."""
        places2, path2 = self._spread2
        least2 = LEAST_SPREAD_SD**2
        if min(places2, path2) < least2 or path2 > GREATEST_STRETCH**2 * places2:
            return False
        return (
            places2 <= GREATEST_STRETCH**2 * path2
            and abs(self._centred) ** 2 >= LEAST_COHERENCE * places2 * path2
        )

    @property
    def turned_rad(self) -> float:
        """Angle by which the axes of the positions are turned."""
        return cmath.phase(self._centred)

    @property
    def turned_sd_rad(self) -> float:
        """Standard deviation of that angle, from the noise of the positions; infinite without a spread."""
        spread2 = min(self._spread2)
        return spread2**-0.5 if spread2 > 0.0 else math.inf

    @property
    def origin_m(self) -> complex:
        """Where the origin of the path lies, as a position."""
        first, turn = self._first or (0j, 0j), cmath.rect(1.0, self.turned_rad)
        return first[0] + self._places / self._weight - (first[1] + self._path / self._weight) * turn

    @property
    def _spread2(self) -> tuple[float, float]:
        """Squared spread of the positions and of the path, in standard deviations."""
        return (
            self._places2 - abs(self._places) ** 2 / self._weight,
            self._path2 - abs(self._path) ** 2 / self._weight,
        )

    @property
    def _centred(self) -> complex:
        return self._product - self._path.conjugate() * self._places / self._weight
