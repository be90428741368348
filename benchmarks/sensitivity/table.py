"""How much a result changes when each tuned number of a parameter object is varied by 20 %."""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import fields, is_dataclass
from functools import partial
from typing import Any

from benchmarks.sensitivity.subject import Score, Subject

FACTORS = (0.8, 1.2)


def varied(value: Any, factor: float) -> Any:
    """Return a number or a tuple of numbers times a factor; whole numbers change by at least 1."""
    if isinstance(value, tuple):
        return tuple(varied(item, factor) for item in value)
    if isinstance(value, int):
        step = max(1, round(abs(factor - 1.0) * value))
        return value + step if factor > 1.0 else value - step
    return value * factor


def _of(name: str, value: Any, factor: float, near_one: tuple[str, ...]) -> Any:
    """Return the varied value; of a share or probability near 1 the rest to 1 is varied."""
    return 1.0 - factor * (1.0 - value) if name in near_one else varied(value, factor)


@contextmanager
def changed(group: object, name: str, value: object) -> Iterator[None]:
    """Give a number of a frozen group another value for a while; every reader of the group sees it."""
    usual = getattr(group, name)
    object.__setattr__(group, name, value)
    try:
        yield
    finally:
        object.__setattr__(group, name, usual)


def numbers_of(parameters: object, path: str = "") -> Iterator[tuple[str, object, str]]:
    """Yield the dotted name of each number, the group that holds it and its name there."""
    for part in fields(parameters):  # type: ignore[arg-type]
        value = getattr(parameters, part.name)
        if is_dataclass(value):
            yield from numbers_of(value, f"{path}{part.name}.")
        else:
            yield f"{path}{part.name}", parameters, part.name


@contextmanager
def recorded_reads(parameters: object) -> Iterator[set[tuple[int, str]]]:
    """Give the set into which every number that is read meanwhile is put, as id of its group and name."""
    read: set[tuple[int, str]] = set()

    def recorded(group: object, name: str) -> Any:
        read.add((id(group), name))
        return object.__getattribute__(group, name)

    kinds = {type(group) for _, group, _ in numbers_of(parameters)}
    for kind in kinds:
        type.__setattr__(kind, "__getattribute__", recorded)
    try:
        yield read
    finally:
        for kind in kinds:
            type.__delattr__(kind, "__getattribute__")


def print_table(subject: Subject, score: Score, groups: Sequence[str] | None) -> None:
    """Print the figures at the usual values, and as Markdown how each number changes them.

    Numbers that change no figure, and numbers that the usual computation does not read, are listed below it.

    Args:
        subject: What is varied.
        score: Computes the figures anew, by label.
        groups: Names of the groups to vary; all of them when None.
    """
    varied_numbers = [
        number
        for number in numbers_of(subject.parameters)
        if not _is_below(number[0], subject.fixed) and (groups is None or _is_below(number[0], groups))
    ]
    if not varied_numbers:
        names = ", ".join(part.name for part in fields(subject.parameters))  # type: ignore[arg-type]
        raise SystemExit(f"no number of these groups is varied; groups are: {names}")
    with recorded_reads(subject.parameters) as read:
        usual = score()
    print("as shipped: " + ", ".join(f"{label} {value:.3g}" for label, value in usual.items()))
    print("\n| number | value | " + " | ".join(usual) + " |\n" + "|---" * (2 + len(usual)) + "|")
    without_effect: list[str] = []
    unread: list[str] = []
    for path, group, name in varied_numbers:
        if (id(group), name) not in read:
            unread.append(path)
            continue
        value = getattr(group, name)
        results = _results(group, name, partial(_score, score, usual, subject.refusals), subject.near_one)
        if all(_is_same(result, usual) for result in results):
            without_effect.append(path)
            continue
        cells = [
            " / ".join(_cell(result.get(key, math.nan) - usual[key]) for result in results) for key in usual
        ]
        print(f"| {path} | {_text(value)} | {' | '.join(cells)} |", flush=True)
    if without_effect:
        print("\nwithout effect: " + ", ".join(without_effect))
    if unread:
        print("\nnot read by these cases: " + ", ".join(unread))


def _is_below(path: str, names: Iterable[str]) -> bool:
    """Return whether a number is one of these, or in one of these groups."""
    return any(f"{path}.".startswith(f"{name}.") for name in names)


def _results(group: object, name: str, score: Score, near_one: tuple[str, ...]) -> list[Mapping[str, float]]:
    """Return the figures at each factor."""
    results = []
    for factor in FACTORS:
        with changed(group, name, _of(name, getattr(group, name), factor, near_one)):
            results.append(score())
    return results


def _score(
    score: Score, usual: Mapping[str, float], refusals: tuple[type[Exception], ...]
) -> Mapping[str, float]:
    """Return the figures, NaN where the data are refused."""
    try:
        return score()
    except refusals:
        return dict.fromkeys(usual, math.nan)


def _is_same(result: Mapping[str, float], usual: Mapping[str, float]) -> bool:
    return all(
        result.get(key) == value or (math.isnan(result.get(key, 0.0)) and math.isnan(value))
        for key, value in usual.items()
    )


def _cell(change: float) -> str:
    if math.isnan(change):
        return "refused"
    return "0" if change == 0.0 else f"{change:+.2g}"


def _text(value: Any) -> str:
    return ", ".join(_text(item) for item in value) if isinstance(value, tuple) else f"{value:.4g}"
