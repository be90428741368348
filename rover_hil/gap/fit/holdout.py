"""Validation of a machine's explanation on the locked runs."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rover_hil.gap.data.problem import Point, Problem, observe
from rover_hil.gap.evidence.evidence import MachineFit
from rover_hil.gap.fit.descent import descend, descend_together, residual_of
from rover_hil.gap.fit.machine_fit import start_of_runs
from rover_hil.gap.noise.sensor_noise import declared_noise
from rover_hil.gap.parameters import MACHINES
from sim_backends.models.interface import Array, Model, Run


@dataclass(frozen=True, slots=True, kw_only=True)
class HoldoutChannel:
    """One channel on the locked runs, in its unit.

    Attributes:
        before: Root mean square error of the base model, fitted to the other runs.
        after: The same with the effects.
        noise_floor: Noise of the sensor.
        closure: Share of the error energy above the floor that is closed; None where there is none. Errors
            smaller than the floor are the floor: they show that it is too high.
        ci95: Its interval over locked runs; None where there are too few.
    """

    before: float
    after: float
    noise_floor: float
    closure: float | None
    ci95: tuple[float, float] | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Holdout:
    """Result on the locked runs.

    Attributes:
        channels: By name.
        closure: Over all channels, each in units of its noise; None where nothing was to be closed. At most
            1, as by channel.
        improved: Share of the locked runs that the effects improve.
        lean: Errors with the effects along the way to the base model, in its length, and this length in
            standard errors: with the right effects the first is normal.
        residuals: Measured minus simulated of the base model and with the effects, by row.
        problem: The locked runs.
    """

    channels: dict[str, HoldoutChannel]
    closure: float | None
    improved: float
    lean: tuple[float, float]
    residuals: tuple[Array, Array]
    problem: Problem


def hold_out(
    model: Model,
    runs: Sequence[Run],
    base: MachineFit,
    best: MachineFit,
    rng: np.random.Generator,
    *,
    is_nominal: bool = False,
) -> Holdout:
    """Validate an explanation on the locked runs; only the unknowns of each run are fitted there.

    With `is_nominal` the error before is that of the nominal base parameters, not of the fitted ones.
    """
    problem = Problem(model, observe(model, runs))
    observations = problem.observations
    residuals = []
    for shared in (base.fit.point, best.fit.point):
        point = with_own_unknowns(problem, shared)
        residuals.append(residual_of(observations, problem.predict(point)))
    lean_of = [np.nan_to_num(one / declared_noise(observations).row_sd) for one in residuals]
    if is_nominal:
        residuals[0] = residual_of(observations, problem.predict(with_own_unknowns(problem, {})))
    channels = {
        channel.name: _channel(problem, residuals, index, rng)
        for index, channel in enumerate(observations.channels)
        if np.isfinite(residuals[0][observations.channel == index]).any()
    }
    closure, improved = closed(problem, residuals, best)
    return Holdout(
        channels=channels,
        closure=closure,
        improved=improved,
        lean=_lean(*lean_of),
        residuals=(residuals[0], residuals[1]),
        problem=problem,
    )


def closed(problem: Problem, residuals: Sequence[Array], best: MachineFit) -> tuple[float | None, float]:
    """Return the share of a gap that is closed, and of the runs that are improved.

    Args:
        problem: The locked runs.
        residuals: Measured minus simulated before and after, by row.
        best: The fit to the other runs; where it learned the noise, the squares of errors scatter more.
    """
    observations = problem.observations
    noise = declared_noise(observations).row_sd
    before, after = (_by_run(problem, residual / noise) for residual in residuals)
    total = float(np.isfinite(observations.values).sum())
    scatter = 2.0 * total
    if best.evidence.is_learned:
        # Errors with heavy tails have squares that scatter more, and what they should be was learned.
        squares = np.nan_to_num(residuals[1] / noise)[np.isfinite(observations.values)] ** 2
        scatter = total * float(np.var(squares)) * (1.0 + total / best.count)
    is_gap = float(before.sum()) - total > 2.0 * math.sqrt(scatter)
    share = float(_closure(before.sum(), after.sum(), total)) if is_gap else None
    return share, float(np.mean(after < before))


def is_confirming(closure: float | None, improved: float) -> bool:
    """Return True where most of the gap is closed and most runs are improved, as of a name."""
    is_closed = closure is not None and closure >= MACHINES.verdict.half
    return is_closed and improved >= MACHINES.search.agreeing_share


def with_own_unknowns(problem: Problem, point: Point) -> Point:
    """Return a point with the unknowns of each run of a problem fitted, and nothing else."""
    shared = {key: value for key, value in point.items() if not key.run}
    free = problem.run_free([key.effect for key in shared if key.effect])
    if not free:
        return shared
    # A fit reads the start of its base parameters from the model; here they are all fixed.
    start = {**{item.key: item.start for item in free}, **start_of_runs(problem, shared)}
    ((found, _),) = descend_together(problem, [descend(problem, free, start, shared)])
    return found.point


def _lean(base: Array, best: Array) -> tuple[float, float]:
    apart = best - base
    length = float(np.linalg.norm(apart))
    return float(best @ apart) / max(length, 1e-300), length


def _by_run(problem: Problem, values: Array) -> Array:
    """Return the sum of squares of each run; missing values count nothing."""
    sums = np.bincount(
        problem.observations.site, weights=np.nan_to_num(values) ** 2, minlength=len(problem.sites)
    )
    return sums.astype(np.float64)


def _closure(before: Array, after: Array, floor: float) -> Array:
    closure: Array = (before - after) / (before - np.minimum(floor, after))
    return closure


def _channel(
    problem: Problem, residuals: Sequence[Array], index: int, rng: np.random.Generator
) -> HoldoutChannel:
    observations = problem.observations
    here = (observations.channel == index) & np.isfinite(residuals[0])
    runs = np.unique(observations.site[here])
    means = np.array(
        [
            [float(np.mean(residual[here & (observations.site == run)] ** 2)) for run in runs]
            for residual in residuals
        ]
    )
    floor = observations.channels[index].noise_sd
    before, after = means.mean(axis=1)
    closure, interval = None, None
    if before > floor**2 * (1.0 + 2.0 * math.sqrt(2.0 / int(here.sum()))):
        closure = float(_closure(before, after, floor**2))
        draws = rng.integers(0, runs.size, (MACHINES.verdict.resamples, runs.size))
        drawn = means[:, draws].mean(axis=2)
        if runs.size > 1 and (drawn[0] > floor**2).all():
            low, high = np.quantile(_closure(drawn[0], drawn[1], floor**2), (0.025, 0.975))
            interval = (float(low), float(high))
    return HoldoutChannel(
        before=math.sqrt(before),
        after=math.sqrt(after),
        noise_floor=floor,
        closure=closure,
        ci95=interval,
    )
