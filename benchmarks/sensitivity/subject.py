"""What of the product is varied, and how its result is computed."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

Score = Callable[[], Mapping[str, float]]


@dataclass(frozen=True, slots=True, kw_only=True)
class Subject:
    """A parameter object and the cases on which its result is computed.

    Attributes:
        parameters: Groups of numbers as in `controllers/slip/effort/parameters.py`, or groups of groups.
        cases: Usual cases, with commas.
        prepare: Returns from a list of cases what computes the figures anew, by label.
        fixed: Groups and numbers that are not varied, with dots.
        near_one: Names of shares and probabilities of which the rest to 1 is varied.
        refusals: Errors by which a result is refused; the table says so.
    """

    parameters: object
    cases: str
    prepare: Callable[[Sequence[str]], Score]
    fixed: tuple[str, ...] = ()
    near_one: tuple[str, ...] = ("gate",)
    refusals: tuple[type[Exception], ...] = ()
