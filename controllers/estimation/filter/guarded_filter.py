"""An extended Kalman filter behind checks: bad input is rejected instead of spoiling the state.

Its equations are those of filterpy, with which tests compare every prediction and update. They are written
out here because filterpy gives its products to BLAS, whose last bits depend on the processor; and because it
accepts NaN and negative time steps silently, and adds K y to an angle without wrapping it.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from controllers.estimation.filter.measurement_model import Measured, MeasurementModel
from controllers.matrices import is_positive_definite, product
from controllers.motion.planar import wrap_angle
from drivers.record import record

Array = NDArray[np.float64]


class Outcome(StrEnum):
    """What became of a measurement.

    ACCEPTED: It has corrected the estimate, or would have.
    REJECTED: Beyond the gate, or not a finite number.
    LATE: Older than the recorded motion: it could not be compared.
    CONTRADICTING: Left out before the filter: it contradicts what the rover can have done.
    """

    ACCEPTED = "accepted"
    REJECTED = "rejected"
    LATE = "late"
    CONTRADICTING = "contradicting"


@record(frozen=True, slots=True, kw_only=True)
class Innovation:
    """What became of one measurement, of any sensor.

    Attributes:
        measured: What was measured.
        outcome: What became of it; unless it was accepted, the estimate is unchanged.
        residual: Measured minus expected; None where that is not a finite number.
        variance: Expected variance of the residual; None where there is none.
        nis: Residual squared over variance (normalised innovation squared); None likewise. The quantities of
            one measurement are accepted or rejected together, by the sum of theirs.
        gate: Greatest sum that is accepted; None where nothing was compared with it.
    """

    measured: Measured
    outcome: Outcome
    residual: float | None = None
    variance: float | None = None
    nis: float | None = None
    gate: float | None = None

    @property
    def name(self) -> str:
        """Name of the measurement."""
        return str(self.measured)

    @property
    def accepted(self) -> bool:
        """Whether it has corrected the estimate."""
        return self.outcome is Outcome.ACCEPTED


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FilterStep:
    """One step of a filter; n states.

    Attributes:
        transition: From the estimate of the step before to the prediction, (n, n).
        predicted: State before the corrections of this step, and its covariance.
        estimate: State after them, and its covariance.
    """

    transition: Array
    predicted: tuple[Array, Array]
    estimate: tuple[Array, Array]


class GuardedFilter:
    """An extended Kalman filter for measurements with independent errors.

    Measurements are taken one by one, in Joseph form.

    Args:
        state: First estimate.
        variances: Its variances, greater than zero.
        angles: Which states are angles; they stay within [-pi, pi).
        gate_probability: A measurement is rejected when its NIS exceeds this quantile of chi-square.

    Attributes:
        angles: As given.
        kept: Steps since `keep_steps`, for a smoother; None before.
    """

    def __init__(
        self,
        state: Sequence[float],
        variances: Sequence[float],
        angles: Sequence[int],
        gate_probability: float,
    ) -> None:
        self._x: Array = np.array(state, dtype=float)
        self._p: Array = np.diag(np.array(variances, dtype=float))
        # Corrections lose digits; the sum of a prediction does not.
        self._is_corrected = True
        self.angles = tuple(angles)
        self.kept: list[FilterStep] | None = None
        self._gate_probability = gate_probability
        # With one degree of freedom the chi-square quantile is that of a normal deviate, squared.
        self._gate = NormalDist().inv_cdf(0.5 * (1.0 + gate_probability)) ** 2

    @property
    def state(self) -> list[float]:
        """The estimate, as a copy."""
        values: list[float] = self._x.tolist()
        return values

    def value(self, index: int) -> float:
        """Return one state of the estimate."""
        return self._x.item(index)

    @property
    def covariance(self) -> list[list[float]]:
        """Its covariance, as a copy."""
        values: list[list[float]] = self._p.tolist()
        return values

    def keep_steps(self) -> list[FilterStep]:
        """Keep every step from now on, for a smoother; return the growing list."""
        self.kept = []
        self._begin_step(np.eye(len(self._x)))
        return self.kept

    def _begin_step(self, transition: Array) -> None:
        if self.kept is not None:
            now = (self._x.copy(), self._p.copy())
            self.kept.append(FilterStep(transition=transition.copy(), predicted=now, estimate=now))

    def _end_step(self) -> None:
        """Take the present estimate as that of the newest step."""
        if self.kept is not None:
            self.kept[-1] = replace(self.kept[-1], estimate=(self._x.copy(), self._p.copy()))

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
        with np.errstate(all="ignore"):
            covariance = product(product(transition, self._p), transition.T) + noise
        if not self._take(np.array(state, dtype=float), covariance):
            return False
        if self._is_corrected and not is_positive_definite(self._p):
            self._p = _lift(self._p)
        self._is_corrected = False
        self._begin_step(transition)
        return True

    def correct(
        self, model: MeasurementModel, readings: Sequence[float], held: Sequence[int] = ()
    ) -> tuple[Innovation, ...]:
        """Correct the estimate by what a model measures; shape (k,).

        Args:
            model: Of two or more numbers where states are held.
            readings: What was measured.
            held: States that are uncertain but not corrected (Schmidt's consider states).
        """
        expected = model.predict(self._x)
        residuals = [
            wrap_angle(reading - value) if index in model.angles else reading - value
            for index, (reading, value) in enumerate(zip(readings, expected.value.tolist(), strict=True))
        ]
        if len(residuals) == 1:
            (measured,), variance = model.names, expected.variance.item(0)
            return (self.update(measured, residuals[0], expected.row[0], variance),)
        return self.update_together(model.names, np.array(residuals), expected.row, expected.variance, held)

    def compare(self, model: MeasurementModel, reading: float) -> Innovation:
        """Return what would become of the one number that a model measures; the estimate stays."""
        expected = model.predict(self._x)
        residual = reading - float(expected.value[0])
        residual = wrap_angle(residual) if model.angles else residual
        (measured,), row, variance = model.names, expected.row[0], expected.variance.item(0)
        step = self._corrected(self._x, self._p, residual, row, variance)
        if step is None:
            return Innovation(measured=measured, outcome=Outcome.REJECTED)
        return self._innovation(measured, residual, step[2])

    def update(self, measured: Measured, residual: float, row: Array, variance: float) -> Innovation:
        """Correct the estimate by a scalar measurement.

        Args:
            measured: What is measured, for the report.
            residual: Measured minus expected at the present estimate; wrapped by the caller for an angle.
            row: Jacobian of the expected measurement, one number per state.
            variance: Variance of the measurement's own error, greater than zero.
        """
        step = self._corrected(self._x, self._p, residual, row, variance)
        if step is None:
            return Innovation(measured=measured, outcome=Outcome.REJECTED)
        state, covariance, total = step
        innovation = self._innovation(measured, residual, total)
        if innovation.accepted and self._take(state, covariance):
            self._is_corrected = True
        elif innovation.accepted:
            innovation = replace(innovation, outcome=Outcome.REJECTED)
        self._end_step()
        return innovation

    def _innovation(self, measured: Measured, residual: float, variance: float) -> Innovation:
        nis = residual * residual / variance
        return Innovation(
            measured=measured,
            outcome=_outcome(accepted=nis <= self._gate),
            residual=residual,
            variance=variance,
            nis=nis,
            gate=self._gate,
        )

    def update_together(
        self,
        measured: Sequence[Measured],
        residuals: Array,
        rows: Array,
        variances: Array,
        held: Sequence[int] = (),
    ) -> tuple[Innovation, ...]:
        """Correct the estimate by measurements that are accepted or rejected together.

        Args:
            measured: What is measured, for the report.
            residuals: As for `update`, shape (n,).
            rows: Jacobians, shape (n, number of states).
            variances: Of the measurements' own errors, shape (n,).
            held: States that are not corrected.
        """
        from scipy.stats import chi2

        state, covariance = self._x, self._p
        nis = 0.0
        totals = []
        for residual, row, variance in zip(residuals.tolist(), rows, variances.tolist(), strict=True):
            alone = self._corrected(self._x, self._p, residual, row, variance)
            # What the measurements before it leave of this one; their sum is the NIS of all together.
            remaining = residual - float((row * (state - self._x)).sum())
            step = self._corrected(state, covariance, remaining, row, variance, held)
            if alone is None or step is None:
                return tuple(Innovation(measured=each, outcome=Outcome.REJECTED) for each in measured)
            state, covariance, total = step
            nis += remaining * remaining / total
            totals.append(alone[2])
        gate = float(chi2.ppf(self._gate_probability, len(measured)))
        accepted = nis <= gate and self._take(state, covariance)
        self._is_corrected |= accepted
        self._end_step()
        return tuple(
            Innovation(
                measured=each,
                outcome=_outcome(accepted=accepted),
                residual=residual,
                variance=total,
                nis=residual * residual / total,
                gate=gate,
            )
            for each, residual, total in zip(measured, residuals.tolist(), totals, strict=True)
        )

    def assign(self, index: int, value: float) -> None:
        """Set a state that is unknown so far, so that its first measurement is linearised at its value."""
        self._x[index] = value
        self._begin_step(np.eye(len(self._x)))

    def add_variance(self, index: int, variance: float) -> None:
        """Increase the variance of a state by a number that is not negative."""
        self._p[index, index] += variance
        self._begin_step(np.eye(len(self._x)))

    def add_covariance(self, noise: Array) -> None:
        """Add a covariance; without effect where a number of it is not finite."""
        if math.isfinite(float(noise.sum())):
            self._p = self._p + noise
            self._begin_step(np.eye(len(self._x)))

    @staticmethod
    def _corrected(
        state: Array,
        covariance: Array,
        residual: float,
        row: Array,
        variance: float,
        held: Sequence[int] = (),
    ) -> tuple[Array, Array, float] | None:
        """Return state and covariance after a scalar measurement, and the variance of its residual.

        None where that variance or the residual is not a usable number.
        """
        with np.errstate(all="ignore"):
            cross = product(covariance, row)
            total = float((row * cross).sum()) + variance
        if not (math.isfinite(residual) and 0.0 < variance <= total < math.inf):
            return None
        with np.errstate(all="ignore"):
            gain = cross / total
            gain[list(held)] = 0.0
            reduced = covariance - gain[:, None] * cross
            # Joseph form: (I - K h) P (I - K h)^T + K r K^T.
            joseph = reduced - product(reduced, row)[:, None] * gain + variance * gain[:, None] * gain
            return state + residual * gain, joseph, total

    def _take(self, state: Array, covariance: Array) -> bool:
        """Take an estimate, its angles wrapped; return False if a number of it is not finite."""
        if not (math.isfinite(sum(state.tolist())) and math.isfinite(float(covariance.sum()))):
            return False
        for index in self.angles:
            state[index] = wrap_angle(float(state[index]))
        self._x, self._p = state, 0.5 * (covariance + covariance.T)
        return True


def _outcome(*, accepted: bool) -> Outcome:
    return Outcome.ACCEPTED if accepted else Outcome.REJECTED


def _lift(covariance: Array) -> Array:
    """Return the symmetric matrix that rounding made indefinite, its diagonal raised as needed."""
    variances = np.diag(covariance)
    known = variances > 0.0
    kept = covariance * known[:, None] * known
    variances = np.where(known, variances, np.finfo(float).tiny)
    share = float(np.finfo(float).eps)
    while not is_positive_definite(kept + np.diag(share * variances)):
        share *= 2.0
    lifted: Array = kept + np.diag(share * variances)
    return lifted
