"""Fit the motor model to all logs of a motor: output error, several starts, one delay for each move."""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from rover_hil.drives.arrays import Array
from rover_hil.identify.motor.parameters import MOTOR_FIT
from rover_hil.identify.motor.problem import MotorProblem, Noise
from rover_hil.identify.motor.response import MotorModel

DELAY_STEP_S = 5e-4
STEP = 1e-4
LOG_LAGS = (np.log(5e-4), np.log(3.0))
HIDDEN = ("lag_s", "inertia_a_s2_per_rad")
LOOP_PERIOD_S = 1 / 900
ELECTRIC_LAG_S = 8.9e-3 / 5.95 + LOOP_PERIOD_S / 2
"""La / Ra of the GR 42x25 (data sheet), and the mean hold of the EA05's output, which acts like it."""

NAMES = tuple(field.name for field in fields(MotorModel) if field.name != "electric_lag_s")
MECHANICAL = NAMES[:6]
TYPICAL = dict(zip(NAMES, (1.0, 1.0, 0.02, 0.2, 3e-4, 2e-4, 5.0, 0.05), strict=True))
"""Size of each parameter for a motor of some ten watts: scales steps and ranks, decides nothing."""


@dataclass(frozen=True, slots=True, eq=False)
class MotorFit:
    """A fitted model and what the uncertainty is computed from.

    Attributes:
        model: The best model.
        names: The parameters that were fitted.
        delay_s: Loop delay of each move.
        delay_is_known: Which moves determine their delay.
        jacobian: Residuals by parameters, with what each move's own delay can explain taken out.
        delay_jacobian: Residuals by the delay of their move.
        plain_jacobian: Residuals by parameters at fixed delays.
        residual: In standard deviations.
    """

    model: MotorModel
    names: tuple[str, ...]
    delay_s: Array
    delay_is_known: NDArray[np.bool_]
    jacobian: Array
    delay_jacobian: Array
    plain_jacobian: Array
    residual: Array


def fit_motor(problem: MotorProblem) -> MotorFit:
    """Return the best fit; the problem's noise is that of its residuals afterwards."""
    names = NAMES if problem.has_voltage else MECHANICAL
    best_cost, model, delay_s = np.inf, MotorModel(), np.zeros(problem.moves)
    is_known = np.zeros(problem.moves, dtype=np.bool_)
    first = _first_guess(problem)
    for lag_s in MOTOR_FIT.fit.start_lags_s:
        start = replace(first, lag_s=lag_s)
        start_delay_s, _ = search_delays(problem, start)
        fitted, fitted_delay_s, cost = _minimise(
            problem, names, start, start_delay_s, MOTOR_FIT.fit.first_evaluations
        )
        if cost < best_cost:
            best_cost, model, delay_s = cost, fitted, fitted_delay_s
    is_hidden = False
    for _ in range(MOTOR_FIT.fit.rounds):
        is_hidden = is_hidden or model.lag_s < MOTOR_FIT.hidden.lag_periods * problem.period_s
        if is_hidden:
            names = tuple(name for name in names if name not in HIDDEN)
            model = replace(
                model, inertia_a_s2_per_rad=0.0, lag_s=max(model.lag_s, MOTOR_FIT.hidden.least_lag_s)
            )
        problem.learn_noise(model, delay_s)
        problem.show_changes()
        delay_s, is_known = search_delays(problem, model)
        if is_hidden:
            problem.hide_changes(delay_s, problem.period_s + MOTOR_FIT.hidden.settled_lags * model.lag_s)
        model, delay_s, _ = _minimise(problem, names, model, delay_s, MOTOR_FIT.fit.last_evaluations)
    problem.learn_noise(model, delay_s)
    profiled = _jacobians(problem, names, model, delay_s)[0]
    residual = problem.weighted(model, delay_s)
    problem.show_changes()
    _, by_delay, plain = _jacobians(problem, names, model, delay_s)
    return MotorFit(model, names, delay_s, is_known, profiled, by_delay, plain, residual)


def search_delays(problem: MotorProblem, model: MotorModel) -> tuple[Array, NDArray[np.bool_]]:
    """Return the best delay of each move on a grid, and which moves depend on it at all."""
    grid_s = np.arange(0.0, MOTOR_FIT.delay.longest_s, MOTOR_FIT.delay.grid_s)
    costs = np.stack(
        [problem.costs(problem.weighted(model, np.full(problem.moves, delay_s))) for delay_s in grid_s]
    )
    lowest = costs.min(axis=0)
    # The middle of the lowest stretch: between two samples of a fast motor all delays fit alike.
    is_low = costs <= lowest + MOTOR_FIT.delay.low_cost
    delay_s = (is_low * grid_s[:, None]).sum(axis=0) / is_low.sum(axis=0)
    is_known = costs.max(axis=0) - lowest > MOTOR_FIT.delay.known_cost
    delay_s[~is_known] = np.median(delay_s[is_known]) if is_known.any() else 0.0
    return delay_s, is_known


def _first_guess(problem: MotorProblem) -> MotorModel:
    readings = np.concatenate([np.abs(part.record.current.value) for part in problem.parts])
    flowing = readings[readings > 0]
    top = max(float(np.abs(part.motion_speed()[1]).max()) for part in problem.parts)
    problem.noise = Noise(
        motion=max(
            MOTOR_FIT.fit.start_motion_share
            * top
            * (problem.period_s if problem.parts[0].uses_ticks else 1.0),
            1e-3,
        )
    )
    set_points = np.concatenate([np.abs(part.record.set_point.value) for part in problem.parts])
    speeds = np.concatenate([np.abs(part.motion_speed()[1]) for part in problem.parts])
    return MotorModel(
        # Both have the same share of standstill; the loop delay shifts it only.
        gain=float(speeds.mean() / set_points.mean()) if set_points.any() else 1.0,
        droop_rad_s_per_a=MOTOR_FIT.fit.start_droop_rad_s_per_a,
        coulomb_a=float(np.median(flowing)) if flowing.size else 0.2,
        electric_lag_s=ELECTRIC_LAG_S if problem.parts[0].record.is_robotino else 0.0,
    )


def _minimise(
    problem: MotorProblem, names: Sequence[str], start: MotorModel, start_delay_s: Array, evaluations: int
) -> tuple[MotorModel, Array, float]:
    scale = np.array([TYPICAL[name] for name in names])
    is_lag = np.array([name == "lag_s" for name in names])

    def model_of(free: Array) -> MotorModel:
        values = np.where(is_lag, np.exp(np.clip(free, *LOG_LAGS)), free * scale)
        return replace(start, **dict(zip(names, values.tolist(), strict=True)))

    def residual(free: Array) -> Array:
        model = model_of(free)
        return problem.weighted(model, _refine_delays(problem, model, start_delay_s))

    def jacobian(free: Array) -> Array:
        model = model_of(free)
        delay_s = _refine_delays(problem, model, start_delay_s)
        return _jacobians(problem, names, model, delay_s)[0] * np.where(is_lag, model.lag_s, scale)

    begin = np.array([getattr(start, name) for name in names])
    begin = np.where(is_lag, np.log(start.lag_s), begin / scale)
    solution = least_squares(residual, begin, jac=jacobian, method="lm", max_nfev=evaluations, xtol=1e-6)
    model = model_of(solution.x)
    return model, _refine_delays(problem, model, start_delay_s), float(solution.cost)


def _refine_delays(problem: MotorProblem, model: MotorModel, delay_s: Array) -> Array:
    """Two Gauss-Newton steps on the delay of each move."""
    base = problem.weighted(model, delay_s)
    for _ in range(2):
        slope = (problem.weighted(model, delay_s + DELAY_STEP_S) - base) / DELAY_STEP_S
        steep = np.bincount(problem.owner, slope**2, problem.moves)
        downhill = -np.bincount(problem.owner, slope * base, problem.moves)
        step_s = np.where(steep > 1.0, downhill / np.maximum(steep, 1.0), 0.0)
        tried_s = np.clip(
            delay_s + np.clip(step_s, -MOTOR_FIT.delay.largest_change_s, MOTOR_FIT.delay.largest_change_s),
            0.0,
            MOTOR_FIT.delay.longest_s,
        )
        tried = problem.weighted(model, tried_s)
        better = problem.costs(tried) < problem.costs(base)
        delay_s = np.where(better, tried_s, delay_s)
        base = problem.weighted(model, delay_s)
    return delay_s


def _jacobians(
    problem: MotorProblem, names: Sequence[str], model: MotorModel, delay_s: Array
) -> tuple[Array, Array, Array]:
    """Return the Jacobian without what each move's delay explains, that of the delays, the plain one."""
    base = problem.weighted(model, delay_s)

    def moved(name: str) -> Array:
        changed = replace(model, **{name: getattr(model, name) + STEP * TYPICAL[name]})
        return (problem.weighted(changed, delay_s) - base) / (STEP * TYPICAL[name])

    plain = np.stack([moved(name) for name in names], axis=1)
    by_delay = (problem.weighted(model, delay_s + DELAY_STEP_S) - base) / DELAY_STEP_S
    steep = np.bincount(problem.owner, by_delay**2, problem.moves)
    shares = [
        np.bincount(problem.owner, by_delay * column, problem.moves) / np.maximum(steep, 1.0)
        for column in plain.T
    ]
    profiled = plain - np.stack([by_delay * share[problem.owner] for share in shares], axis=1)
    return profiled, by_delay, plain
