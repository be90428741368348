"""What the inputs of measured runs can show of each effect, before any measured value is compared.

Of the measured values only those are used that run parameters start from.
"""

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from pydantic_core import to_json

from drivers.errors import ConfigError
from rover_hil.gap.data.derivatives import in_full
from rover_hil.gap.data.problem import Problem, observe
from rover_hil.gap.evidence.card_changes import (
    card_changes,
    imitating_parameter,
    shape_points,
    with_shapes,
)
from rover_hil.gap.evidence.fit import Fit, whitened_jacobian
from rover_hil.gap.evidence.score import Score, cosine, score_all
from rover_hil.gap.model_checks.reach import Reach, signal_ranges, threshold_reaches
from rover_hil.gap.noise.sensor_noise import SensorNoise, declared_noise
from rover_hil.gap.parameters import MACHINES
from sim_backends.models.interface import EffectCard, Machine, Run
from sim_backends.models.parameter_key import ParameterKey
from sim_backends.state_model.model import StateModel


@dataclass(frozen=True, slots=True, kw_only=True)
class CardCheck:
    """What the runs can show of one effect of natural size.

    Attributes:
        name: Of the card.
        change: Greatest change of a prediction, in sensor noises; NaN where there is no solution.
        rms: Root mean square over the samples of what base parameters and run unknowns cannot absorb, in
            sensor noises; at the shape where it is greatest.
        standard_errors: The same over all samples: size over its standard error by the sensor noise alone.
        absorbed_by: The base parameter or run unknown most similar to it, where it is not shown clearly.
    """

    name: str
    change: float
    rms: float
    standard_errors: float
    absorbed_by: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Pair:
    """Two effects that the inputs cannot separate, and their shapes where they are most similar."""

    cards: tuple[str, str]
    shapes: tuple[Mapping[str, float], Mapping[str, float]]
    cosine: float

    def sentence(self) -> str:
        """Return it in words."""
        one, other = (
            f"{name} ({', '.join(f'{key} {value:.3g}' for key, value in shapes.items())})" if shapes else name
            for name, shapes in zip(self.cards, self.shapes, strict=True)
        )
        return f"these inputs cannot separate {one} and {other} (cosine {self.cosine:.2f})"


@dataclass(frozen=True, slots=True, kw_only=True)
class RunUnknown:
    """An unknown of each run and where it starts from."""

    name: str
    unit: str
    prior_sd: float
    starts_from: str

    def sentence(self) -> str:
        """Return it in words."""
        return f"{self.name}: {self.starts_from} +- {self.prior_sd:g} {self.unit} in each run"


@dataclass(frozen=True, slots=True, kw_only=True)
class LintReport:
    """Result of `lint`.

    Attributes:
        problems: Sentences on cards that cannot work, or on data that cannot be used.
        cards: All effects, in the order of the model.
        pairs: Effects that the inputs cannot separate.
        thresholds: Sentences on thresholds that the signals do not reach.
        run_unknowns: Unknowns of each run.
    """

    problems: tuple[str, ...]
    cards: tuple[CardCheck, ...] = ()
    pairs: tuple[Pair, ...] = ()
    thresholds: tuple[str, ...] = ()
    run_unknowns: tuple[RunUnknown, ...] = ()

    def as_json(self) -> str:
        """Return it as JSON; numbers without a value are null."""
        return to_json(self, indent=2, inf_nan_mode="null").decode()

    def lines(self) -> list[str]:
        """Return it as lines of text, problems first."""
        width = max((len(one.name) for one in self.cards), default=0)
        lines = [f"Error: {one}." for one in self.problems]
        lines += [f"Unknown of each run: {one.sentence()}" for one in self.run_unknowns]
        if self.cards:
            lines.append(f"{'effect':<{width}}  rms in sensor noises  standard errors")
        for one in self.cards:
            weak = f"  weak: {one.absorbed_by} can do nearly the same" if one.absorbed_by else ""
            lines.append(f"{one.name:<{width}}  {one.rms:>20.3g}  {one.standard_errors:>15.3g}{weak}")
        lines += [f"Threshold: {one}" for one in self.thresholds]
        return [*lines, *(f"Similar: {one.sentence()}" for one in self.pairs)]


def require_changes(model: Machine, runs: Sequence[Run]) -> None:
    """Check that each effect of natural size changes some prediction.

    Raises:
        ConfigError: One changes nothing, whatever its shape.
    """
    bench = _Bench(model, runs)
    silent = [
        card
        for card in model.effects
        if bench.greatest(card, [_nominal_shapes(card)]) < MACHINES.linter.least_change
    ]
    silent = [
        card for card in silent if bench.greatest(card, shape_points(card)) < MACHINES.linter.least_change
    ]
    if silent:
        reach = _reaches(model, bench).get(silent[0].name)
        raise ConfigError(f"model {model.name}: {_silence(bench, silent[0], reach)}")


def lint(model: Machine, runs: Sequence[Run]) -> LintReport:
    """Return what the inputs and initial conditions of runs can show of each effect."""
    bench = _Bench(model, runs)
    changes = {card.name: bench.greatest(card, shape_points(card)) for card in model.effects}
    scores = bench.scores([card for card in model.effects if math.isfinite(changes[card.name])])
    reaches = _reaches(model, bench)
    problems: list[str] = []
    cards, thresholds = [], []
    for card in model.effects:
        change = changes[card.name]
        if not math.isfinite(change):
            problems.append(f"effect {card.name} at its natural size has no solution: make it smaller")
        elif change < MACHINES.linter.least_change:
            problems.append(_silence(bench, card, reaches.get(card.name)))
        else:
            thresholds += _unreached(bench, card, reaches.get(card.name))
        cards.append(bench.check(card, change, scores.get(card.name, [])))
    return LintReport(
        problems=tuple(problems),
        cards=tuple(cards),
        pairs=tuple(_pairs(scores)),
        thresholds=tuple(thresholds),
        run_unknowns=tuple(
            RunUnknown(
                name=one.name,
                unit=one.unit,
                prior_sd=one.prior_sd,
                starts_from=f"first value of {one.channel}" if one.channel else f"{one.nominal:g}",
            )
            for one in model.run_parameters
        ),
    )


def _with_starts_only(run: Run) -> Run:
    """Return a run whose measured values are all the first one of their channel."""
    measured = {}
    for name, values in run.measured.items():
        good = np.flatnonzero(np.isfinite(values))
        measured[name] = values if good.size == 0 else np.where(np.isfinite(values), values[good[0]], np.nan)
    return replace(run, measured=measured)


class _Bench:
    """The model on its runs; of their measured values it uses where they are and where states start."""

    def __init__(self, model: Machine, runs: Sequence[Run]) -> None:
        self.problem = Problem(model, observe(model, [_with_starts_only(run) for run in runs]))
        self._noise: SensorNoise = declared_noise(self.problem.observations)
        free = tuple(self.problem.base_free())
        nominal: dict[ParameterKey, float] = {item.key: item.start for item in free}
        jacobian = in_full(np.zeros((self._noise.site.size, 0)))
        self._fit = Fit(
            free=free,
            point=nominal,
            residual=np.zeros(self._noise.site.size),
            jacobian=jacobian,
            pull=np.zeros(len(free)),
            cost=0.0,
        )

    def greatest(self, card: EffectCard, shapes: Sequence[Mapping[str, float]]) -> float:
        """Return the greatest change of a prediction, in sensor noises; infinite without a solution."""
        strong = {**self._fit.point, card.strength_key: card.parameters[0].natural}
        points = [with_shapes(strong, card, one) for one in shapes]
        self.problem.prepare_points([self._fit.point, *points])
        before = self.problem.predict(self._fit.point)
        changes = [self._noise.whiten(self.problem.predict(point) - before) for point in points]
        found = [float(np.max(np.abs(one))) for one in changes]
        return max((one if math.isfinite(one) else math.inf for one in found), default=0.0)

    def scores(self, cards: Sequence[EffectCard]) -> dict[str, list[Score]]:
        """Return, by card, its changes without what base parameters and run unknowns absorb."""
        jacobian = whitened_jacobian(self.problem, self._noise, self._fit.free, self._fit.point)
        self._fit = replace(self._fit, jacobian=jacobian)
        changes = card_changes(self.problem, self._fit.point, cards)
        directions = [replace(one, change=self._noise.whiten(one.change)) for one in changes]
        found: dict[str, list[Score]] = {}
        for score in score_all(self._fit, self._noise, directions, is_steady=True):
            found.setdefault(score.direction.name, []).append(score)
        return found

    def check(self, card: EffectCard, change: float, scores: Sequence[Score]) -> CardCheck:
        """Return what the runs can show of a card."""
        best = max(scores, key=_standard_errors, default=None)
        shown = 0.0 if best is None else _standard_errors(best)
        imitator = (
            "" if best is None or shown >= MACHINES.linter.clear else imitating_parameter(self._fit, best)
        )
        return CardCheck(
            name=card.name,
            change=change if math.isfinite(change) else math.nan,
            rms=shown / math.sqrt(self._noise.site.size),
            standard_errors=shown,
            absorbed_by=imitator,
        )


def _reaches(model: Machine, bench: _Bench) -> dict[str, Reach]:
    """Return, by card, the signal that its threshold is compared with, where the model's ports are known."""
    if not isinstance(model, StateModel):
        return {}
    return threshold_reaches(model, signal_ranges(model, bench.problem.sites))


def _nominal_shapes(card: EffectCard) -> dict[str, float]:
    return {item.name: item.nominal for item in card.parameters[1:]}


def _standard_errors(score: Score) -> float:
    return score.direction.size / score.standard_error


def _silence(bench: _Bench, card: EffectCard, reach: Reach | None) -> str:
    """Return a sentence on an effect that changes no prediction of any run."""
    why = (
        f"is {card.place} used in the equations, and do the inputs act on it?"
        if reach is None
        else f"{reach.sentence()}{_advice(bench, card, reach)}"
    )
    return f"effect {card.name} at its natural size changes no prediction of any run: {why}"


def _advice(bench: _Bench, card: EffectCard, reach: Reach) -> str:
    """Return thresholds that change a prediction."""
    if not reach.shape:
        return ""
    good = [
        value
        for value in reach.inside()
        if bench.greatest(card, _at(card, reach, value)) >= MACHINES.linter.least_change
    ]
    if not good:
        return ", and no threshold inside this range changes a prediction"
    return f"; {reach.shape} may be {', '.join(f'{value:.3g}' for value in good)}"


def _at(card: EffectCard, reach: Reach, value: float) -> list[dict[str, float]]:
    """Return the shapes of a card with its threshold at a value."""
    return [{**one, reach.shape: value} for one in shape_points(card)]


def _unreached(bench: _Bench, card: EffectCard, reach: Reach | None) -> list[str]:
    """Return sentences on thresholds of a card that change nothing, or everything."""
    if reach is None:
        return []
    if not reach.shape:
        width = card.parameters[0].natural
        return (
            [f"{card.name}: {card.parameters[0].name} {width:g} {reach.unit} covers all; {reach.sentence()}"]
            if reach.is_beyond(width)
            else []
        )
    grid = card.shape_grid[reach.shape]
    silent = [
        value
        for value in grid
        if bench.greatest(card, _at(card, reach, value)) < MACHINES.linter.least_change
    ]
    if not silent:
        return []
    values = ", ".join(f"{value:g}" for value in silent)
    return [
        f"{card.name}: {reach.shape} {values} {reach.unit} changes nothing; {reach.sentence()}"
        f"{_advice(bench, card, reach)}"
    ]


def _pairs(scores: Mapping[str, Sequence[Score]]) -> list[Pair]:
    """Return the pairs of effects that are similar at some of their shapes, the most similar first."""
    pairs = []
    for one, other in itertools.combinations(scores, 2):
        found = [
            (abs(cosine(first, second)), first, second)
            for first in scores[one]
            for second in scores[other]
            if min(_standard_errors(first), _standard_errors(second)) >= 1.0
        ]
        if not found:
            continue
        most, first, second = max(found, key=lambda item: item[0])
        if most > MACHINES.linter.similar:
            shapes = (dict(first.direction.shapes), dict(second.direction.shapes))
            pairs.append(Pair(cards=(one, other), shapes=shapes, cosine=round(most, 4)))
    return sorted(pairs, key=lambda pair: -pair.cosine)
