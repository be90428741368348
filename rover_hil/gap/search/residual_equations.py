"""Equations for what no effect explains: the shortest with units."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rover_hil.gap.data.problem import Observations
from rover_hil.gap.evidence.evidence import Names
from rover_hil.gap.evidence.fit import Fit
from rover_hil.gap.evidence.score import Projection, Score, linear_gain, of_terms, one_sided_z, score_all
from rover_hil.gap.evidence.terms import Term, directions
from rover_hil.gap.fit.holdout import is_confirming
from rover_hil.gap.noise.sensor_noise import SensorNoise
from rover_hil.gap.parameters import MACHINES


@dataclass(frozen=True, slots=True, kw_only=True)
class Equation:
    """Sum to add to one channel.

    Attributes:
        channel: The channel.
        unit: Of the sum.
        terms: Text, coefficient, its standard error and unit, of each term.
        closest: The effect with the most similar change.
        cosine: -1..1.
        closure: Share of the gap on the test runs that it closes; None where there is none.
        improved: Share of the test runs that it improves.
    """

    channel: str
    unit: str
    terms: tuple[tuple[str, float, float, str], ...]
    closest: str
    cosine: float
    closure: float | None = None
    improved: float = 0.0

    @property
    def is_confirmed(self) -> bool:
        """True where it closes most of the gap on the test runs and improves most of them, as a name does."""
        return is_confirming(self.closure, self.improved)

    def is_law_of(self, names: Names) -> bool:
        """Return True where it is the same law as one of some effects."""
        return self.closest in names and abs(self.cosine) > MACHINES.terms.same_law

    @property
    def text(self) -> str:
        """Return the equation as a line of text."""
        parts = []
        for text, value, error, unit in self.terms:
            factor = "" if text == "1" else f" * {text}"
            parts.append(f"({value:.3g} ± {1.96 * error:.2g} {unit}){factor}")
        return f"{self.channel} += " + " + ".join(parts)


def find_equations(
    observations: Observations,
    noise: SensorNoise,
    fitted: Fit,
    terms: Sequence[Term],
    effects: Sequence[Score],
    threshold: float,
) -> list[Equation]:
    """Return an equation for each channel with significant terms, the greatest gain first."""
    scores = of_terms(
        score_all(fitted, noise, directions(observations, noise, terms), is_steady=observations.is_steady)
    )
    equations = []
    for channel in observations.channels:
        channel_scores = [score for score in scores if score.direction.name.startswith(f"{channel.name}: ")]
        channel_scores = sorted(channel_scores, key=lambda score: -one_sided_z(score))[
            : MACHINES.equations.top_terms
        ]
        if not channel_scores or one_sided_z(channel_scores[0]) < threshold:
            continue
        chosen = _choose(channel_scores, threshold)
        gain = linear_gain([channel_scores[index] for index in chosen])
        equations.append(
            (gain, _equation(channel.name, channel.unit, channel_scores, chosen, fitted, effects))
        )
    return [
        equation for _, equation in sorted(equations, key=lambda item: -item[0])[: MACHINES.equations.most]
    ]


def _choose(scores: Sequence[Score], threshold: float) -> tuple[int, ...]:
    """Return the best subset; a further term must be as significant as the first."""
    best: tuple[int, ...] = (0,)
    for size in range(1, min(MACHINES.equations.most_terms, len(scores)) + 1):
        subsets = itertools.combinations(range(len(scores)), size)
        ranked = max(subsets, key=lambda one: linear_gain([scores[index] for index in one]))
        gain = linear_gain([scores[index] for index in ranked])
        before = linear_gain([scores[index] for index in best])
        if size == 1 or gain - before >= threshold**2 * (size - len(best)):
            best = ranked
    return best


def _equation(
    channel: str,
    unit: str,
    scores: Sequence[Score],
    chosen: Sequence[int],
    fitted: Fit,
    effects: Sequence[Score],
) -> Equation:
    parts = [scores[index] for index in chosen]
    matrix = np.stack([score.projected / score.standard_error for score in parts], axis=1)
    projection = Projection(fitted)
    normal = np.linalg.inv(matrix.T @ matrix)
    values = normal @ matrix.T @ projection.residual
    errors = np.sqrt(np.diag(normal))
    together = matrix @ values
    together /= max(float(np.linalg.norm(together)), 1e-300)
    closest, alike = "", 0.0
    for score in effects:
        similar = float(score.projected @ together)
        if abs(similar) > abs(alike):
            closest, alike = score.direction.name, similar
    return Equation(
        channel=channel,
        unit=unit,
        terms=tuple(
            (
                score.direction.name.removeprefix(f"{channel}: "),
                float(value),
                float(error),
                score.direction.unit,
            )
            for score, value, error in zip(parts, values, errors, strict=True)
        ),
        closest=closest,
        cosine=alike,
    )
