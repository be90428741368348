"""Validation on locked runs: the gap shrinks, and the named effect is the cause."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rover_hil.gap.data.problem import (
    Observations,
    Point,
    observe,
    predict_rows,
)
from rover_hil.gap.explain.naming import Naming
from rover_hil.gap.explain.parameters import EXPLAIN
from rover_hil.gap.explain.prepare import Prepared, terms_of
from rover_hil.gap.explain.search import Explanation
from rover_hil.gap.statistics.fit import fit
from rover_hil.gap.statistics.noise import for_other_runs
from rover_hil.gap.statistics.score import Direction, score_all
from sim_backends.models.interface import Array, Model, Run


@dataclass(frozen=True, slots=True, kw_only=True)
class ChannelValidation:
    """One channel on the locked runs.

    Attributes:
        before: Root mean square error of the model as it was, its unit the channel's.
        after: The same with the effects.
        noise_floor: Of a perfect model.
        closure: Share of the gap between `before` and `noise_floor` that is closed; None where there is none.
        ci95: Interval of the closure over locked conditions.
        is_worse: The error grew by more than 2 %, and by more than chance over locked conditions.
    """

    before: float
    after: float
    noise_floor: float
    closure: float | None
    ci95: tuple[float, float] | None
    is_worse: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class Validation:
    """Result on the locked runs.

    Attributes:
        channels: By name.
        closure: Over all channels, each in units of its noise.
        controls: Closure by other means: the base model with freer parameters, terms drawn at random, the
            next best effect.
        harmed: Channels that got worse.
        is_confirmed: The effects predict the locked runs better than base parameters fitted alike.
        steps: Error over all channels in units of noise: base, base fitted, with each effect, noise.
    """

    channels: dict[str, ChannelValidation]
    closure: float | None
    controls: dict[str, float | None]
    harmed: tuple[str, ...]
    is_confirmed: bool
    steps: tuple[tuple[str, float], ...]


class LockedRuns:
    """Locked runs and errors of predictions on them.

    Args:
        prepared: Fit of the other runs.
        runs: The locked runs.
    """

    def __init__(self, prepared: Prepared, runs: Sequence[Run]) -> None:
        self.model: Model = prepared.problem.model
        self.observations: Observations = observe(self.model, runs)
        self.groups = len(self.observations.groups)
        shape = (self.groups, len(self.observations.channels))
        self.counts = np.zeros(shape)
        self.within = np.zeros(shape)
        self.freedom = np.zeros(shape)
        self._count()
        self.floor = self._floor(prepared)

    def predict(self, point: Point) -> Array:
        """Return predicted rows."""
        return predict_rows(self.model, [group.site for group in self.observations.groups], point)

    def squares(self, predicted: Array) -> Array:
        """Return sums of squared errors of single runs: groups x channels."""
        error = self.observations.values - predicted
        error = np.where(np.isfinite(error), error, 0.0)
        total = self.within.copy()
        np.add.at(
            total, (self.observations.site, self.observations.channel), self.observations.counts * error**2
        )
        return total

    def errors(self, point: Point) -> Array:
        """Return the same for the model's prediction."""
        return self.squares(self.predict(point))

    def relative(self, squares: Array) -> float:
        """Return the mean square over all channels, each in units of its noise."""
        each = squares.sum(axis=0) / np.maximum(self.counts.sum(axis=0), 1.0)
        return float(np.mean(each / self.floor**2))

    def closure(self, before: Array, after: Array) -> float | None:
        """Return the share of the gap that is closed over all channels."""
        gap = self.relative(before) - 1.0
        if gap <= EXPLAIN.validation.clear * math.sqrt(2.0 / max(float(self.counts.sum()), 1.0)):
            return None
        return (self.relative(before) - self.relative(after)) / gap

    def _count(self) -> None:
        np.add.at(self.counts, (self.observations.site, self.observations.channel), self.observations.counts)
        if not self.observations.is_steady:
            return
        for index, group in enumerate(self.observations.groups):
            for place, channel in enumerate(self.observations.channels):
                values = [run.measured[channel.name][0] for run in group.runs if channel.name in run.measured]
                if values:
                    self.within[index, place] = float(np.var(values)) * len(values)
                    self.freedom[index, place] = len(values) - 1

    def _floor(self, prepared: Prepared) -> Array:
        """Return the deviation of one value from a perfect model, per channel."""
        learned = prepared.problem.observations
        if prepared.scatter is None:
            return np.array(
                [
                    float(prepared.noise.row_sd[learned.channel == index].mean())
                    for index in range(len(learned.channels))
                ]
            )
        mean = prepared.scatter.covariance.diagonal(axis1=1, axis2=2).mean(axis=0)
        freedom = np.where(np.isfinite(prepared.scatter.freedom), prepared.scatter.freedom, 1e3)
        shared = np.array([channel.tolerance**2 for channel in learned.channels])
        here = self.freedom.sum(axis=0)
        floor: Array = np.sqrt((mean * freedom + self.within.sum(axis=0)) / (freedom + here) + shared)
        return floor


def validate(
    prepared: Prepared, runs: Sequence[Run], best: Explanation, naming: Naming, rng: np.random.Generator
) -> Validation:
    """Validate an explanation on the locked runs.

    Args:
        prepared: Fit of the other runs.
        runs: The locked runs.
        best: The chosen explanation.
        naming: All explanations, for the next best.
        rng: For intervals and placebos.
    """
    locked = LockedRuns(prepared, runs)
    before = locked.errors({})
    fitted = locked.errors(prepared.start.point)
    after = locked.errors(best.fit.point)
    channels = {
        channel.name: _channel(locked, before, after, index, rng)
        for index, channel in enumerate(locked.observations.channels)
    }
    harmed = [name for name, one in channels.items() if one.is_worse]
    steps = [("base", before), ("base fitted", fitted)]
    steps += [(" + ".join(one.names), locked.errors(one.fit.point)) for one in _parts(best, naming)]
    steps.append((" + ".join(best.names), after))
    sizes = [(name, math.sqrt(locked.relative(squares))) for name, squares in steps]
    return Validation(
        channels=channels,
        closure=locked.closure(before, after),
        controls={
            "retuned": locked.closure(before, locked.errors(retuned(prepared))),
            "placebo": _placebo(prepared, locked, before, rng),
            "rival": _rival(locked, before, best, naming),
        },
        harmed=tuple(harmed),
        is_confirmed=_is_confirmed(prepared, locked, best),
        steps=(*sizes, ("noise", 1.0)),
    )


def _parts(best: Explanation, naming: Naming) -> list[Explanation]:
    """Return the best subset of each size of the chosen explanation."""
    parts = []
    for size in range(1, len(best.names)):
        within = [one for key, one in naming.tried.items() if len(key) == size and set(key) < set(best.names)]
        if within:
            parts.append(min(within, key=lambda one: one.cost))
    return parts


def _is_confirmed(prepared: Prepared, locked: LockedRuns, best: Explanation) -> bool:
    """Return False where the locked runs contradict the effects.

    They do where they are nearer to the fitted base model than by chance: with the right effects, the part of
    the errors in its direction is normal, as wide as runs scatter.
    """
    noise = for_other_runs(prepared.noise, prepared.scatter, locked.observations)
    base, with_effects = (locked.predict(one) for one in (prepared.start.point, best.fit.point))
    error = locked.observations.values - with_effects
    good = np.isfinite(error) & np.isfinite(base)
    error = noise.whiten(np.where(good, error, 0.0))
    apart = noise.whiten(np.where(good, base - with_effects, 0.0))
    lean, square = float(error @ apart), float(apart @ apart)
    if prepared.scatter is None:
        # In minus two log-likelihood: where base and effects hardly differ, no contradiction is possible.
        return 2.0 * lean - square <= (EXPLAIN.validation.veto_sd * best.widening) ** 2
    distance = math.sqrt(square)
    return lean <= max(EXPLAIN.validation.veto_sd * best.widening, 0.5 * distance) * distance


def retuned(prepared: Prepared) -> Point:
    """Return base parameters fitted with wide priors and no effect: compensation without a cause."""
    problem = prepared.problem
    return fit(
        problem, prepared.noise, problem.base_free(widening=EXPLAIN.validation.widening), prepared.start.point
    ).point


def _channel(
    locked: LockedRuns, before: Array, after: Array, index: int, rng: np.random.Generator
) -> ChannelValidation:
    count = max(float(locked.counts[:, index].sum()), 1.0)
    floor = float(locked.floor[index])
    mean_before, mean_after = before[:, index].sum() / count, after[:, index].sum() / count
    gap = mean_before - floor**2
    closure, interval = None, None
    draws = rng.integers(0, locked.groups, (EXPLAIN.validation.resamples, locked.groups))
    counts = locked.counts[draws, index].sum(axis=1)
    sums = [squares[draws, index].sum(axis=1) / np.maximum(counts, 1.0) for squares in (before, after)]
    if gap > EXPLAIN.validation.clear * floor**2 * math.sqrt(2.0 / count):
        closure = float((mean_before - mean_after) / gap)
        gaps = sums[0] - floor**2
        resampled = (sums[0] - sums[1])[gaps > 0.0] / gaps[gaps > 0.0]
        if resampled.size > EXPLAIN.validation.resamples // 2:
            low, high = np.quantile(resampled, (0.025, 0.975))
            interval = (float(low), float(high))
    is_more = mean_after > EXPLAIN.validation.harm**2 * max(mean_before, floor**2)
    return ChannelValidation(
        before=math.sqrt(mean_before),
        after=math.sqrt(mean_after),
        noise_floor=floor,
        closure=closure,
        ci95=interval,
        is_worse=bool(is_more and np.quantile(sums[1] - EXPLAIN.validation.harm**2 * sums[0], 0.025) > 0.0),
    )


def _rival(locked: LockedRuns, before: Array, best: Explanation, naming: Naming) -> float | None:
    kept = {one.names for one in naming.members}
    alternatives = [
        one for key, one in naming.tried.items() if len(key) == len(best.names) and key not in kept
    ]
    if not alternatives:
        return None
    rival = min(alternatives, key=lambda one: one.cost)
    return locked.closure(before, locked.errors(rival.fit.point))


def _placebo(prepared: Prepared, locked: LockedRuns, before: Array, rng: np.random.Generator) -> float | None:
    """Return the median closure by smooth terms drawn at random, fitted like an effect."""
    locked_terms = {
        term.text: term.values for term in terms_of(locked.model, locked.observations, prepared.start.point)
    }
    terms = [term for term in prepared.terms if term.text in locked_terms]
    observations, start = prepared.problem.observations, prepared.start
    predicted = locked.predict(start.point)
    closures = []
    for _ in range(EXPLAIN.validation.placebos):
        learned, locked_change = np.zeros(observations.values.size), np.zeros(locked.observations.values.size)
        for index in range(len(observations.channels)):
            in_channel, in_locked_channel = (
                observations.channel == index,
                locked.observations.channel == index,
            )
            for term in terms:
                level = (
                    max(float(np.sqrt(np.mean(term.values[in_channel] ** 2))), 1e-300)
                    if in_channel.any()
                    else 1.0
                )
                weight = float(rng.standard_normal()) * float(locked.floor[index]) / level
                learned[in_channel] += weight * term.values[in_channel]
                locked_change[in_locked_channel] += weight * locked_terms[term.text][in_locked_channel]
        direction = Direction(
            name="placebo", change=prepared.noise.whiten(learned), sign=0, shapes={}, size=1.0, unit="1"
        )
        scores = score_all(start, prepared.noise, [direction], is_steady=observations.is_steady)
        strength = scores[0].strength if scores else 0.0
        closure = locked.closure(before, locked.squares(predicted + strength * locked_change))
        if closure is None:
            return None
        closures.append(closure)
    return float(np.median(closures))
