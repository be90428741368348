"""The verdict and its text."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum

MOST_LINES = 5
"""Series with gaps that the terminal lists."""


class Answer(StrEnum):
    """Kinds of verdict."""

    NO_GAP = "NO_GAP"
    NAMED = "NAMED"
    NAMED_SET = "NAMED_SET"
    PARTLY_NAMED = "PARTLY_NAMED"
    UNNAMED = "UNNAMED"
    NOT_IDENTIFIABLE = "NOT_IDENTIFIABLE"
    BAD_DATA = "BAD_DATA"

    @property
    def is_name(self) -> bool:
        """True for verdicts with effects."""
        return self in (Answer.NAMED, Answer.NAMED_SET, Answer.PARTLY_NAMED)


@dataclass(frozen=True, slots=True, kw_only=True)
class FoundParameter:
    """A parameter of a named effect with its 95 % interval."""

    value: float
    unit: str
    ci95: tuple[float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class FoundEffect:
    """A named effect."""

    name: str
    parameters: Mapping[str, FoundParameter]


@dataclass(frozen=True, slots=True, kw_only=True)
class FittedBase:
    """A base parameter as the runs show it.

    Attributes:
        name: Of the parameter.
        unit: Its unit.
        nominal: What the model was given.
        prior_sd: How well that was known.
        value: Fitted.
        ci95: Its 95 % interval.
        pull: Distance of the value from the nominal one in prior deviations, with sign.
        is_named: The runs prove that the nominal value is wrong and this one right.
        why: Of a value that is far from the nominal one but not named: what is not proven.
        equals: Explanations with the nominal value that explain the runs as well.
        probability: Share of the draws of the decision whose winner moves it; None where none was asked for.
    """

    name: str
    unit: str
    nominal: float
    prior_sd: float
    value: float
    ci95: tuple[float, float]
    pull: float
    is_named: bool = False
    why: str = ""
    equals: Sequence[Sequence[str]] = ()
    probability: float | None = None

    def sentence(self) -> str:
        """Return the value with its interval beside what the model was given."""
        low, high = self.ci95
        unit = "" if self.unit == "1" else f" {self.unit}"
        return (
            f"{self.name} is {self.value:.4g}{unit} ({low:.4g} to {high:.4g}), not {self.nominal:.4g}: "
            f"{abs(self.pull):.1f} prior deviations"
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Verdict:
    """Content of `verdict.json`."""

    verdict: Answer
    sentence: str
    p_gap: float | None = None
    where: Sequence[Mapping[str, str | float | int]] = ()
    effects: Sequence[FoundEffect] = ()
    base_parameters: Sequence[FittedBase] = ()
    confidence_set: Sequence[Sequence[str]] = ()
    probabilities: Sequence[Mapping[str, float | Sequence[str]]] = ()
    order: Mapping[str, Sequence[str]] = field(default_factory=dict)
    rejected: Sequence[Mapping[str, str]] = ()
    unnamed: Sequence[Mapping[str, str | float | None]] = ()
    next_run: str = ""
    next_runs: Sequence[Mapping[str, object]] = ()
    detectable: Sequence[Mapping[str, str | float]] = ()
    gap: Mapping[str, Mapping[str, float | Sequence[float] | None]] = field(default_factory=dict)
    missing: Sequence[Mapping[str, str | int]] = ()
    error_budget: Mapping[str, Mapping[str, float | str | None]] = field(default_factory=dict)
    draft: Sequence[Mapping[str, float | str]] = ()
    weightings: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    warnings: Sequence[str] = ()
    seconds: float = math.nan

    def lines(self) -> list[str]:
        """Return it as lines of text: answer, gaps in the data, what no effect explains, the next run."""
        lines = [f"{self.verdict}: {self.sentence}"]
        lines += [
            f"Missing values: {one['count']} of {one['total']} of {one['series']} in run {one['run']}"
            for one in self.missing[:MOST_LINES]
        ]
        if len(self.missing) > MOST_LINES:
            lines.append(f"Missing values: {len(self.missing) - MOST_LINES} more series, see verdict.json")
        for one in self.unnamed:
            similar = f" (most similar effect: {one['closest']}, cosine {one['cosine']})"
            lines.append(f"Unexplained: {one['equation']}{similar if one['closest'] else ''}")
        lines += [f"Warning: {one}" for one in self.warnings]
        lines += self._base_lines()
        return [*lines, f"Next run: {self.next_run}"] if self.next_run else lines

    def _base_lines(self) -> list[str]:
        """Return the base parameters as a table."""
        if not self.base_parameters:
            return []
        rows = [("Base parameter", "value", "95 % interval", "unit", "nominal", "prior sd", "pull")]
        for one in self.base_parameters:
            low, high = one.ci95
            interval = f"{low:.4g} to {high:.4g}"
            numbers = (f"{one.nominal:.4g}", f"{one.prior_sd:.2g}", f"{one.pull:+.1f}")
            rows.append((one.name, f"{one.value:.4g}", interval, one.unit, *numbers))
        widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]))]
        return ["  ".join(map(str.ljust, row, widths)).rstrip() for row in rows]


def refuse(answer: Answer, reason: str) -> Verdict:
    """Return the verdict on unusable data."""
    head = "The data cannot be used" if answer is Answer.BAD_DATA else "The data cannot decide"
    return Verdict(verdict=answer, sentence=f"{head}: {reason}.")
