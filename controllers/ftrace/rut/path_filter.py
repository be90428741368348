"""Kalman filter of the path that the wheel travelled: the curve behind its contact.

In the wheel's axes, with s the distance behind the contact and y the distance to the left, the state is [b,
k, c, y_1 .. y_n]: slope b = dy/ds and curvature k = d2y/ds2 at the contact, the offset c of the trace from
the path (one wall is seen better than the other; the calibration has a small error), and the places y_i of
points passed at s_i. The path passes through the contact: y(0) = 0. The angle of the current velocity is
-atan(b), not that of a chord, because k is estimated with it. Curvature and c are first-order Gauss-Markov
processes over distance.
"""

import numpy as np

from controllers.ftrace.parameters import PathParameters
from controllers.ground_motion.ground_patch import Floats

PLACES = 3
"""Index of y_1."""


class PathFilter:
    """Estimates the path behind the wheel.

    Args:
        length_m: Length of the path that is kept.
        parameters: Noise and step lengths.
    """

    def __init__(self, length_m: float, parameters: PathParameters) -> None:
        self._length_m = length_m
        self._parameters = parameters
        self.reset()

    def reset(self) -> None:
        """Return to the prior: any direction, any likely curve."""
        prior = self._parameters
        count = int(self._length_m / prior.substep_m)
        self._s = (np.arange(count) + 1) * prior.substep_m
        steps = np.tril(np.ones((count, count)))
        distance = np.abs(np.subtract.outer(self._s, self._s))
        curvature = prior.curvature_sd_1_m**2 * np.exp(-distance / prior.curvature_length_m)
        to_place = steps @ steps * prior.substep_m**2
        whole = np.zeros((count + PLACES, count + PLACES))
        head = prior.curvature_sd_1_m**2 * np.exp(-self._s / prior.curvature_length_m)
        whole[0, 0] = prior.slope_sd**2
        whole[1, 1] = prior.curvature_sd_1_m**2
        whole[2, 2] = prior.beside_sd_m**2
        whole[1, PLACES:] = whole[PLACES:, 1] = to_place @ head
        whole[0, PLACES:] = whole[PLACES:, 0] = prior.slope_sd**2 * self._s
        whole[PLACES:, PLACES:] = to_place @ curvature @ to_place.T + prior.slope_sd**2 * np.outer(
            self._s, self._s
        )
        self._state = np.zeros(count + PLACES)
        self._covariance = whole + prior.row_sd_m**2 * np.diag(np.r_[np.zeros(PLACES), np.ones(count)])

    @property
    def theta_rad(self) -> float:
        """Angle of the current velocity from the wheel's axis, counter-clockwise."""
        return float(-np.arctan(self._state[0]))

    @property
    def theta_sd_rad(self) -> float:
        """Standard deviation of `theta_rad` by the noise assumed."""
        return float(np.sqrt(max(self._covariance[0, 0], 0.0)) / (1 + self._state[0] ** 2))

    @property
    def slope(self) -> float:
        """Slope dy/ds at the contact."""
        return float(self._state[0])

    def advance(self, distance_m: float, turn_rad: float, turn_sd_rad: float) -> None:
        """Predict after `distance_m` along the path with a turn of `turn_rad`, counter-clockwise."""
        count = max(1, int(np.ceil(distance_m / self._parameters.substep_m)))
        for _ in range(count):
            self._step(distance_m / count, turn_rad / count, turn_sd_rad / np.sqrt(count))

    def observe_trace(
        self, s_m: Floats, y_m: Floats, sd_m: Floats, offset_sd_m: float, slope_sd: float
    ) -> None:
        """Correct by points of the trace, with a common offset and slope of these standard deviations."""
        rows = self._rows(s_m)
        rows[:, 2] = 1.0
        noise = np.diag(sd_m**2) + offset_sd_m**2 + slope_sd**2 * np.outer(s_m, s_m)
        self._update(rows, y_m - rows @ self._state, noise)

    def observe_motion(self, s_m: float, y_m: float, sd_m: float, gate_sd: float) -> float:
        """Correct by the present place of the last step's contact, unless it is off by `gate_sd` deviations.

        Returns:
            The squared difference over its variance; 1 in the mean where the noise is as assumed.
        """
        rows = self._rows(np.array([s_m]))
        innovation = np.array([y_m]) - rows @ self._state
        variance = float((rows @ self._covariance @ rows.T)[0, 0]) + sd_m**2
        ratio = float(innovation[0]) ** 2 / variance
        if ratio <= gate_sd**2:
            self._update(rows, innovation, np.array([[sd_m**2]]))
        return ratio

    def curve(self, s_m: Floats) -> Floats:
        """Return y at `s_m`."""
        return np.asarray(self._rows(s_m) @ self._state)

    def trace(self, s_m: Floats) -> tuple[Floats, Floats]:
        """Return the expected places of the trace at `s_m`, and their covariance."""
        rows = self._rows(s_m)
        rows[:, 2] = 1.0
        return rows @ self._state, rows @ self._covariance @ rows.T

    def _step(self, ds: float, turn: float, turn_sd: float) -> None:
        b, size = self._state[0], len(self._state)
        forward = ds / np.sqrt(1 + b * b)
        decay = np.exp(-forward / self._parameters.curvature_length_m)
        f = np.eye(size)
        f[0, 0] += 2 * b * turn
        f[0, 1] = -forward
        f[1, 1] = decay
        f[2, 2] = np.exp(-forward / self._parameters.beside_length_m)
        f[PLACES:, 0] = forward
        f[PLACES:, 1] = -(forward**2) / 2
        old_head = np.array([forward, -(forward**2) / 2])
        x = f @ self._state
        x[0] += turn * (1 - b * b)
        x[PLACES:] += turn * (self._s + forward)
        noise = np.zeros(size)
        noise[1] = self._parameters.curvature_sd_1_m**2 * (1 - decay**2)
        noise[2] = self._parameters.beside_sd_m**2 * (1 - f[2, 2] ** 2)
        turning = np.r_[1 + b * b, 0.0, 0.0, self._s + forward]
        s = self._s + forward - turn * x[PLACES:]
        if s[0] - forward >= self._parameters.node_m or forward >= self._parameters.node_m:
            row = np.zeros((1, size))
            row[0, :2] = old_head
            f = np.insert(f, PLACES, row, axis=0)
            x = np.insert(x, PLACES, float(row[0] @ self._state) + turn * forward)
            s = np.insert(s, 0, forward)
            noise = np.insert(noise, PLACES, 0.0)
            turning = np.insert(turning, PLACES, forward)
        self._covariance = (
            f @ self._covariance @ f.T + np.diag(noise) + turn_sd**2 * np.outer(turning, turning)
        )
        self._state, self._s = x, s
        keep = np.r_[True, True, True, s <= self._length_m + self._parameters.substep_m]
        if not keep.all():
            self._state, self._s = x[keep], s[keep[PLACES:]]
            self._covariance = self._covariance[np.ix_(keep, keep)]

    def _rows(self, s_m: Floats) -> Floats:
        """Return the rows that map the state to y at `s_m`: linear between points, and beyond the last."""
        s = np.r_[0.0, self._s]
        place = np.clip(np.searchsorted(s, s_m) - 1, 0, len(s) - 2)
        share = (s_m - s[place]) / (s[place + 1] - s[place])
        rows = np.zeros((len(s_m), len(self._state)))
        rows[np.arange(len(s_m)), place + PLACES] = share
        at_head = place == 0
        rows[np.arange(len(s_m))[~at_head], place[~at_head] + PLACES - 1] = 1 - share[~at_head]
        return rows

    def _update(self, rows: Floats, innovation: Floats, noise: Floats) -> None:
        cross = self._covariance @ rows.T
        gain = np.linalg.solve(rows @ cross + noise, cross.T).T
        self._state = self._state + gain @ innovation
        self._covariance = self._covariance - gain @ cross.T
        self._covariance = (self._covariance + self._covariance.T) / 2
