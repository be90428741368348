"""How well the data determine each parameter: sandwich covariance over whole moves, and what it rests on."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student

from rover_hil.drives.arrays import Array
from rover_hil.identify.motor.fit import LOOP_PERIOD_S, TYPICAL, MotorFit
from rover_hil.identify.motor.parameters import MOTOR_FIT
from rover_hil.identify.motor.problem import MotorProblem

CONFIDENCE = 0.95


@dataclass(frozen=True, slots=True, eq=False)
class Uncertainty:
    """Uncertainty of the fitted parameters by the residuals.

    Attributes:
        covariance: Of the parameters in the order of the fit's names; infinite where not determined.
        support: For each parameter, how many moves (or blocks of time) carry it, in effect.
        correlation: Between parameters, from the covariance.
        delay_s: Mean loop delay.
        delay_half_s: Half of its interval.
        delay_spread_s: Standard deviation of the delay from move to move.
    """

    covariance: Array
    support: Array
    correlation: Array
    delay_s: float
    delay_half_s: float
    delay_spread_s: float

    def half_widths(self) -> Array:
        """Return half of each parameter's interval; infinite where nothing supports one."""
        freedom = np.maximum(self.support - 1.0, 1.0)
        factor = student.ppf(0.5 + CONFIDENCE / 2, freedom)
        return np.asarray(
            np.where(
                self.support > MOTOR_FIT.uncertainty.least_support,
                factor * np.sqrt(np.diag(self.covariance)),
                np.inf,
            )
        )


def assess(problem: MotorProblem, fit: MotorFit) -> Uncertainty:
    """Return the uncertainty of a fit.

    The residuals of one move belong together (slow changes of friction, ripple that beats with the sampling),
    so scores are summed over moves before they are squared. The plain least-squares variance is a lower
    bound: with few moves the sandwich can be small by chance.
    """
    scale = np.array([TYPICAL[name] for name in fit.names])
    jacobian = fit.jacobian * scale
    blocks, count = _blocks(problem)
    _, strength, directions = np.linalg.svd(jacobian, full_matrices=False)
    felt = strength > MOTOR_FIT.uncertainty.null_share * max(float(strength[0]), 1e-12)
    inverse = (directions[felt].T / strength[felt] ** 2) @ directions[felt]
    scores = np.stack([np.bincount(blocks, column * fit.residual, count) for column in jacobian.T], axis=1)
    sandwich = inverse @ (scores.T @ scores) @ inverse * count / max(count - 1, 1)
    freedom = max(fit.residual.size - len(fit.names), 1)
    plain = inverse * float(fit.residual @ fit.residual) / freedom
    inflate = np.sqrt(np.maximum(np.diag(plain) / np.maximum(np.diag(sandwich), 1e-300), 1.0))
    covariance = sandwich * np.outer(inflate, inflate)
    # Along the other directions, scaled to the typical sizes, nothing changes.
    lost = (directions[~felt] ** 2).sum(axis=0) > MOTOR_FIT.uncertainty.lost_share
    covariance[lost, :] = covariance[:, lost] = 0.0
    covariance = covariance * np.outer(scale, scale)
    delay_s, half_s, spread_s = _delay(problem, fit, covariance)
    covariance[lost, lost] = np.inf
    return Uncertainty(
        covariance,
        _support(jacobian, inverse, blocks, count),
        _correlation(covariance),
        delay_s,
        half_s,
        spread_s,
    )


def _blocks(problem: MotorProblem) -> tuple[NDArray[np.intp], int]:
    if problem.moves >= MOTOR_FIT.uncertainty.fewest_moves:
        return problem.owner, problem.moves
    first_s, last_s = min(p.t_s.min() for p in problem.parts), max(p.t_s.max() for p in problem.parts)
    length_s = max(
        (last_s - first_s) * len(problem.parts) / MOTOR_FIT.uncertainty.blocks,
        MOTOR_FIT.uncertainty.shortest_block_s,
    )
    keys = np.concatenate(
        [number * 100_000 + (part.t_s // length_s) for number, part in enumerate(problem.parts)]
    )
    kinds, blocks = np.unique(keys, return_inverse=True)
    return blocks, kinds.size


def _support(jacobian: Array, inverse: Array, blocks: NDArray[np.intp], count: int) -> Array:
    """Return how many blocks carry the information about each parameter that no other one has."""
    own = jacobian @ inverse
    shares = np.stack([np.bincount(blocks, column**2, count) for column in own.T], axis=1)
    total = shares.sum(axis=0)
    return np.asarray(np.where(total > 0, total**2 / np.maximum((shares**2).sum(axis=0), 1e-300), 0.0))


def _correlation(covariance: Array) -> Array:
    deviation = np.sqrt(np.diag(covariance))
    known = np.isfinite(deviation) & (deviation > 0)
    safe = np.where(known, deviation, 1.0)
    return np.asarray(np.where(np.outer(known, known), covariance / np.outer(safe, safe), 0.0))


def _delay(problem: MotorProblem, fit: MotorFit, covariance: Array) -> tuple[float, float, float]:
    """Return the mean delay, half of its interval, and its spread.

    Three things blur it: delays differ from move to move, the other parameters are uncertain, and between two
    samples a sudden change may have happened anywhere.
    """
    is_known = fit.delay_is_known
    count = int(is_known.sum())
    if count == 0:
        return np.nan, np.inf, np.nan
    low_s, high_s = _flat_stretch(problem, fit)
    middle_s = fit.delay_s + (low_s + high_s) / 2
    spread_s = float(np.std(middle_s[is_known], ddof=1)) if count > 1 else 0.0
    steep = np.bincount(problem.owner, fit.delay_jacobian**2, problem.moves)
    pulls = [
        np.bincount(problem.owner, fit.delay_jacobian * column, problem.moves) / np.maximum(steep, 1.0)
        for column in fit.plain_jacobian.T
    ]
    pull = np.array([-values[is_known].mean() for values in pulls])
    # A delay less certain than this is determined by the flat stretch only.
    least = 1.0 / MOTOR_FIT.uncertainty.flat_delay_sd_s**2
    own = float(np.mean(np.where(steep > least, 1.0 / np.maximum(steep, least), 0.0)[is_known])) / count
    variance = max(spread_s**2 / count, own) + float(pull @ covariance @ pull)
    factor = float(student.ppf(0.5 + CONFIDENCE / 2, max(count - 1, 1)))
    half_s = factor * np.sqrt(variance) + float((high_s - low_s)[is_known].mean()) / 2
    half_s += LOOP_PERIOD_S / 2  # a setpoint waits for the next cycle of the speed loop
    if "lag_s" not in fit.names:
        half_s += fit.model.lag_s  # what the lag takes too much, the delay lacks
    return float(middle_s[is_known].mean()), float(half_s), spread_s


def _flat_stretch(problem: MotorProblem, fit: MotorFit) -> tuple[Array, Array]:
    """Return how far each move's delay can change either way without a worse fit."""
    reach_s, step_s = MOTOR_FIT.uncertainty.flat_reach_s, MOTOR_FIT.uncertainty.flat_step_s
    grid_s = np.arange(-reach_s, reach_s + 0.1 * step_s, step_s)
    costs = np.stack(
        [problem.costs(problem.weighted(fit.model, fit.delay_s + shift_s)) for shift_s in grid_s]
    )
    is_flat = costs <= costs.min(axis=0) + MOTOR_FIT.uncertainty.flat_cost
    low = grid_s[is_flat.argmax(axis=0)]
    high = grid_s[grid_s.size - 1 - is_flat[::-1].argmax(axis=0)]
    return low, high
