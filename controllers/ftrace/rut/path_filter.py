"""The path that the wheel travelled, remembered: a Kalman filter over the curve behind the contact.

In the wheel's axes, with s the distance behind the contact and y the distance to the left, the state is [b,
k, c, y_1 .. y_n]: slope b = dy/ds and curvature k = d2y/ds2 at the contact, the distance c by which the
trace seems to lie beside the path (one wall is seen better than the other; the rig is a little off), and
the places y_i of points passed at s_i. The path passes through the contact: y(0) = 0. The angle of the
current velocity is -atan(b): not that of a chord, because k is estimated with it. Curvature is a first-
order Gauss-Markov process over distance, c a slow random walk.
"""

import numpy as np

from controllers.ftrace.rig_geometry import Floats

NODE_M = 0.012
SUBSTEP_M = 0.02
SLOPE_SD = 0.2
CURVATURE_SD = 0.7
"""rad/m: what a slip angle of 10 deg that comes and goes within half a metre does."""
CURVATURE_LENGTH_M = 0.25
ROW_SD_M = 0.0005
BESIDE_SD_M = 0.006
PLACES = 3
"""Index of y_1."""


class PathMemory:
    """What is known about the path behind the wheel.

    Args:
        length_m: How far back the path is remembered.
    """

    def __init__(self, length_m: float) -> None:
        self._length_m = length_m
        self.reset()

    def reset(self) -> None:
        """Forget everything: any direction, any likely curve."""
        count = int(self._length_m / SUBSTEP_M)
        self._s = (np.arange(count) + 1) * SUBSTEP_M
        steps = np.tril(np.ones((count, count)))
        distance = np.abs(np.subtract.outer(self._s, self._s))
        curvature = CURVATURE_SD**2 * np.exp(-distance / CURVATURE_LENGTH_M)
        to_place = steps @ steps * SUBSTEP_M**2
        whole = np.zeros((count + PLACES, count + PLACES))
        head = CURVATURE_SD**2 * np.exp(-self._s / CURVATURE_LENGTH_M)
        whole[0, 0] = SLOPE_SD**2
        whole[1, 1] = CURVATURE_SD**2
        whole[2, 2] = BESIDE_SD_M**2
        whole[1, PLACES:] = whole[PLACES:, 1] = to_place @ head
        whole[0, PLACES:] = whole[PLACES:, 0] = SLOPE_SD**2 * self._s
        whole[PLACES:, PLACES:] = to_place @ curvature @ to_place.T + SLOPE_SD**2 * np.outer(self._s, self._s)
        self._x = np.zeros(count + PLACES)
        self._p = whole + ROW_SD_M**2 * np.diag(np.r_[np.zeros(PLACES), np.ones(count)])

    @property
    def theta_rad(self) -> float:
        """Angle of the current velocity from the wheel's axis, counter-clockwise."""
        return float(-np.arctan(self._x[0]))

    @property
    def theta_sd_rad(self) -> float:
        """Standard deviation of `theta_rad`."""
        return float(np.sqrt(self._p[0, 0]) / (1 + self._x[0] ** 2))

    @property
    def slope_and_curvature(self) -> tuple[float, float]:
        """Slope and curvature (1/m) at the contact."""
        return float(self._x[0]), float(self._x[1])

    def advance(self, distance_m: float, turn_rad: float, turn_sd_rad: float) -> None:
        """Move on by `distance_m` along the path, turning by `turn_rad` counter-clockwise meanwhile."""
        count = max(1, int(np.ceil(distance_m / SUBSTEP_M)))
        for _ in range(count):
            self._step(distance_m / count, turn_rad / count, turn_sd_rad / np.sqrt(count))

    def observe_trace(
        self, s_m: Floats, y_m: Floats, sd_m: Floats, offset_sd_m: float, slope_sd: float
    ) -> None:
        """Take in points of the trace, wrong together by an offset and a slope of these deviations."""
        rows = self._rows(s_m)
        rows[:, 2] = 1.0
        noise = np.diag(sd_m**2) + offset_sd_m**2 + slope_sd**2 * np.outer(s_m, s_m)
        self._update(rows, y_m - rows @ self._x, noise)

    def observe_motion(self, s_m: float, y_m: float, sd_m: float) -> None:
        """Take in where the contact of the last step is now."""
        rows = self._rows(np.array([s_m]))
        self._update(rows, np.array([y_m]) - rows @ self._x, np.array([[sd_m**2]]))

    def curve(self, s_m: Floats) -> Floats:
        """Return y at `s_m`."""
        return np.asarray(self._rows(s_m) @ self._x)

    def trace(self, s_m: Floats) -> tuple[Floats, Floats]:
        """Return where the trace should be seen at `s_m`, and the covariance."""
        rows = self._rows(s_m)
        rows[:, 2] = 1.0
        return rows @ self._x, rows @ self._p @ rows.T

    def _step(self, ds: float, turn: float, turn_sd: float) -> None:
        b, size = self._x[0], len(self._x)
        forward = ds / np.sqrt(1 + b * b)
        decay = np.exp(-forward / CURVATURE_LENGTH_M)
        f = np.eye(size)
        f[0, 0] += 2 * b * turn
        f[0, 1] = -forward
        f[1, 1] = decay
        f[2, 2] = np.exp(-forward / 1.0)
        f[PLACES:, 0] = forward
        f[PLACES:, 1] = -(forward**2) / 2
        old_head = np.array([forward, -(forward**2) / 2])
        x = f @ self._x
        x[0] += turn * (1 - b * b)
        x[PLACES:] += turn * (self._s + forward)
        noise = np.zeros(size)
        noise[1] = CURVATURE_SD**2 * (1 - decay**2)
        noise[2] = BESIDE_SD_M**2 * (1 - f[2, 2] ** 2)
        turning = np.r_[1 + b * b, 0.0, 0.0, self._s + forward]
        s = self._s + forward - turn * x[PLACES:]
        if s[0] - forward >= NODE_M or forward >= NODE_M:
            row = np.zeros((1, size))
            row[0, :2] = old_head
            f = np.insert(f, PLACES, row, axis=0)
            x = np.insert(x, PLACES, float(row[0] @ self._x) + turn * forward)
            s = np.insert(s, 0, forward)
            noise = np.insert(noise, PLACES, 0.0)
            turning = np.insert(turning, PLACES, forward)
        self._p = f @ self._p @ f.T + np.diag(noise) + turn_sd**2 * np.outer(turning, turning)
        self._x, self._s = x, s
        keep = np.r_[True, True, True, s <= self._length_m + SUBSTEP_M]
        if not keep.all():
            self._x, self._s = x[keep], s[keep[PLACES:]]
            self._p = self._p[np.ix_(keep, keep)]

    def _rows(self, s_m: Floats) -> Floats:
        """Return what of the state gives y at `s_m`: between points linearly, beyond the last straight on."""
        s = np.r_[0.0, self._s]
        place = np.clip(np.searchsorted(s, s_m) - 1, 0, len(s) - 2)
        share = (s_m - s[place]) / (s[place + 1] - s[place])
        rows = np.zeros((len(s_m), len(self._x)))
        rows[np.arange(len(s_m)), place + PLACES] = share
        at_head = place == 0
        rows[np.arange(len(s_m))[~at_head], place[~at_head] + PLACES - 1] = 1 - share[~at_head]
        return rows

    def _update(self, rows: Floats, innovation: Floats, noise: Floats) -> None:
        cross = self._p @ rows.T
        gain = np.linalg.solve(rows @ cross + noise, cross.T).T
        self._x = self._x + gain @ innovation
        self._p = self._p - gain @ cross.T
        self._p = (self._p + self._p.T) / 2
