"""The extended Kalman filter of filterpy behind checks: bad input is rejected instead of spoiling the state.

filterpy accepts NaN, wrong shapes and negative time steps silently, and adds K y to an angle without wrapping
it. This is the only module that uses it.
"""

import math
from collections.abc import Callable, Sequence
from statistics import NormalDist
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from controllers.motion.planar import wrap_angle
from drivers.record import record

Array = NDArray[np.float64]


@record(frozen=True, slots=True, kw_only=True)
class Innovation:
    """Innovation of one measurement.

    Attributes:
        name: Name of the measurement.
        residual: Measured minus expected; None when the measurement was not a finite number.
        variance: Expected variance of the residual; None likewise.
        nis: Residual squared over variance (normalised innovation squared); None likewise.
        accepted: False when the measurement was rejected and the estimate left unchanged.
    """

    name: str
    residual: float | None
    variance: float | None
    nis: float | None
    accepted: bool


class _ExtendedKalmanFilter(Protocol):
    """The interface of `filterpy.kalman.ExtendedKalmanFilter`, which has no type information."""

    x: Array
    P: Array

    def update(
        self, z: Array, h_jacobian: Callable[[Array], Array], h: Callable[[Array], Array], r: Array, /
    ) -> None: ...


class GuardedFilter:
    """An extended Kalman filter for measurements with independent errors.

    The update is filterpy's, in Joseph form. The prediction is its equation for the covariance, without the
    copies that filterpy keeps.

    Args:
        state: First estimate.
        variances: Its variances, greater than zero.
        angles: Which states are angles; they stay within [-pi, pi).
        gate_probability: A measurement is rejected when its NIS exceeds this quantile of chi-square.
    """

    def __init__(
        self,
        state: Sequence[float],
        variances: Sequence[float],
        angles: Sequence[int],
        gate_probability: float,
    ) -> None:
        # Imported here because it pulls in scipy.stats: about a second that `--help` must not cost.
        from filterpy.kalman import ExtendedKalmanFilter
        from scipy.linalg.lapack import dpotrf

        self._factorise: Callable[[Array], tuple[Array, int]] = dpotrf
        self._filter: _ExtendedKalmanFilter = ExtendedKalmanFilter(dim_x=len(state), dim_z=1)
        self._filter.x = np.array(state, dtype=float)
        self._filter.P = np.diag(np.array(variances, dtype=float))
        self._angles = tuple(angles)
        self._gate_probability = gate_probability
        # With one degree of freedom the chi-square quantile is that of a normal deviate, squared.
        self._gate = NormalDist().inv_cdf(0.5 * (1.0 + gate_probability)) ** 2

    @property
    def state(self) -> list[float]:
        """The estimate, as a copy."""
        values: list[float] = self._filter.x.tolist()
        return values

    def value(self, index: int) -> float:
        """Return one state of the estimate."""
        return self._filter.x.item(index)

    @property
    def covariance(self) -> list[list[float]]:
        """Its covariance, as a copy."""
        values: list[list[float]] = self._filter.P.tolist()
        return values

    def predict(self, dt_s: float, state: Sequence[float], transition: Array, noise: Array) -> bool:
        """Move the estimate to `state`.

        Args:
            dt_s: Time passed, not negative.
            state: The present estimate moved by the motion model.
            transition: Jacobian of that motion model at the present estimate.
            noise: Covariance added by the motion.

        Returns:
            False when a number is not finite or `dt_s` is negative; the estimate is then unchanged.
        """
        if not 0.0 <= dt_s < math.inf:
            return False
        before = (self._filter.x, self._filter.P)
        self._filter.x = np.array(state, dtype=float)
        with np.errstate(all="ignore"):
            self._filter.P = transition.dot(self._filter.P).dot(transition.T) + noise
        return self._settle(before)

    def update(self, name: str, residual: float, row: Array, variance: float) -> Innovation:
        """Correct the estimate by a scalar measurement.

        Args:
            name: Name of the measurement, for the report.
            residual: Measured minus expected at the present estimate; wrapped by the caller for an angle.
            row: Jacobian of the expected measurement, one number per state.
            variance: Variance of the measurement's own error, greater than zero.
        """
        with np.errstate(all="ignore"):
            total = float(row @ self._filter.P @ row) + variance
        if not (math.isfinite(residual) and 0.0 < variance <= total < math.inf):
            return Innovation(name=name, residual=None, variance=None, nis=None, accepted=False)
        nis = residual * residual / total
        accepted = nis <= self._gate and self._correct(
            np.array([residual]), row.reshape(1, -1), np.array([[variance]])
        )
        return Innovation(name=name, residual=residual, variance=total, nis=nis, accepted=accepted)

    def update_together(
        self, names: Sequence[str], residuals: Array, rows: Array, variances: Array
    ) -> tuple[Innovation, ...]:
        """Correct the estimate by measurements that are accepted or rejected together.

        Args:
            names: Names of the measurements, for the report.
            residuals: As for `update`, shape (n,).
            rows: Jacobians, shape (n, number of states).
            variances: Of the measurements' own errors, shape (n,).
        """
        from scipy.stats import chi2

        with np.errstate(all="ignore"):
            totals = rows @ self._filter.P @ rows.T + np.diag(variances)
        if not (np.isfinite(residuals).all() and np.isfinite(totals).all() and (variances > 0.0).all()):
            return tuple(
                Innovation(name=name, residual=None, variance=None, nis=None, accepted=False)
                for name in names
            )
        nis = float(residuals @ np.linalg.solve(totals, residuals))
        gate = float(chi2.ppf(self._gate_probability, len(names)))
        accepted = nis <= gate and self._correct(residuals, rows, np.diag(variances))
        return tuple(
            Innovation(
                name=name,
                residual=residual,
                variance=total,
                nis=residual * residual / total,
                accepted=accepted,
            )
            for name, residual, total in zip(names, residuals.tolist(), np.diag(totals).tolist(), strict=True)
        )

    def assign(self, index: int, value: float) -> None:
        """Set a state that is unknown so far, so that its first measurement is linearised at its value."""
        self._filter.x[index] = value

    def widen(self, index: int, variance: float) -> None:
        """Increase the variance of a state by a number that is not negative."""
        self._filter.P[index, index] += variance

    def widen_by(self, noise: Array) -> None:
        """Add a covariance; without effect where a number of it is not finite."""
        if math.isfinite(float(noise.sum())):
            self._filter.P = self._filter.P + noise

    def _correct(self, residuals: Array, rows: Array, noise: Array) -> bool:
        before = (self._filter.x, self._filter.P)
        self._filter.update(residuals, lambda _: rows, lambda _: np.zeros(len(rows)), noise)
        return self._settle(before)

    def _settle(self, before: tuple[Array, Array]) -> bool:
        """Wrap angles and make the covariance valid; return to `before` if a number is not finite."""
        state, covariance = self._filter.x, self._filter.P
        if not (math.isfinite(sum(state.tolist())) and math.isfinite(float(covariance.sum()))):
            self._filter.x, self._filter.P = before
            return False
        for index in self._angles:
            state[index] = wrap_angle(float(state[index]))
        covariance = 0.5 * (covariance + covariance.T)
        _, failed_at = self._factorise(covariance)
        self._filter.P = _lift(covariance) if failed_at else covariance
        return True


def _lift(covariance: Array) -> Array:
    """Return the symmetric matrix that rounding made indefinite, its eigenvalues raised above zero."""
    # As correlations, so that a large variance does not drown a small one.
    scale = np.sqrt(np.maximum(np.diag(covariance), np.finfo(float).tiny))
    scales = np.outer(scale, scale)
    values, vectors = np.linalg.eigh(covariance / scales)
    lifted: Array = (vectors * np.maximum(values, np.finfo(float).eps)) @ vectors.T * scales
    return 0.5 * (lifted + lifted.T)
