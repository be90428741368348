"""How much a result changes when each tuned number of a parameter object is varied by 20 %."""

import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import fields
from functools import partial
from typing import Any

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


@contextmanager
def recorded_reads(parameters: object) -> Iterator[set[str]]:
    """Give the set into which every number that is read meanwhile is put, as `group.name`."""
    read: set[str] = set()
    classes = {type(getattr(parameters, part.name)): part.name for part in fields(parameters)}  # type: ignore[arg-type]

    def reader(label: str) -> Callable[[object, str], Any]:
        def read_one(group: object, name: str) -> Any:
            read.add(f"{label}.{name}")
            return object.__getattribute__(group, name)

        return read_one

    for kind, label in classes.items():
        type.__setattr__(kind, "__getattribute__", reader(label))
    try:
        yield read
    finally:
        for kind in classes:
            type.__delattr__(kind, "__getattribute__")


def print_table(
    parameters: object,
    score: Callable[[], Mapping[str, float]],
    *,
    leave_out: tuple[str, ...] = (),
    groups: str | None = None,
    near_one: tuple[str, ...] = ("gate",),
    refusals: tuple[type[Exception], ...] = (),
    effects_only: bool = False,
) -> None:
    """Print the figures at the usual values, and as Markdown how each number changes them.

    A number that the usual computation does not read is listed below the table; it has no effect there.

    Args:
        parameters: Groups of numbers, as `controllers/slip/effort/parameters.py` has them.
        score: Computes the figures anew, by label.
        leave_out: Numbers not to vary, as `group.name`.
        groups: Names of the groups to vary, with commas; all of them when None.
        near_one: Names of shares and probabilities of which the rest to 1 is varied.
        refusals: Errors by which a result is refused; the table says so.
        effects_only: Numbers that change no figure get one line of text in the end instead of rows.
    """
    with recorded_reads(parameters) as read:
        usual = score()
    print("as shipped: " + ", ".join(f"{label} {value:.3g}" for label, value in usual.items()))
    print("\n| number | value | " + " | ".join(usual) + " |\n" + "|---" * (2 + len(usual)) + "|")
    without_effect: list[str] = []
    unread: list[str] = []
    for part in fields(parameters):  # type: ignore[arg-type]
        group = getattr(parameters, part.name)
        for name in _names(part.name, group, leave_out, groups):
            if f"{part.name}.{name}" not in read:
                unread.append(f"{part.name}.{name}")
                continue
            value = getattr(group, name)
            results = _results(group, name, partial(_score, score, usual, refusals), near_one)
            if effects_only and all(_is_same(result, usual) for result in results):
                without_effect.append(f"{part.name}.{name}")
                continue
            cells = [
                " / ".join(_cell(result.get(key, math.nan) - usual[key]) for result in results)
                for key in usual
            ]
            print(f"| {part.name}.{name} | {_text(value)} | {' | '.join(cells)} |", flush=True)
    if without_effect:
        print("\nwithout effect: " + ", ".join(without_effect))
    if unread:
        print("\nnot read by these cases: " + ", ".join(unread))


def _names(part: str, group: Any, leave_out: tuple[str, ...], groups: str | None) -> list[str]:
    """Return the names of the numbers of a group to vary."""
    if groups is not None and part not in groups.split(","):
        return []
    names = (number.name for number in fields(group))
    return [name for name in names if f"{part}.{name}" not in leave_out]


def _results(
    group: object, name: str, score: Callable[[], Mapping[str, float]], near_one: tuple[str, ...]
) -> list[Mapping[str, float]]:
    """Return the figures at each factor."""
    results = []
    for factor in FACTORS:
        with changed(group, name, _of(name, getattr(group, name), factor, near_one)):
            results.append(score())
    return results


def _score(
    score: Callable[[], Mapping[str, float]],
    usual: Mapping[str, float],
    refusals: tuple[type[Exception], ...],
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
