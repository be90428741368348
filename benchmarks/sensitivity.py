"""How much a result changes when each tuned number of a parameter object is varied by 20 %."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import fields
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


def _of(name: str, value: Any, factor: float) -> Any:
    """Return the varied value; of a probability near 1 the rest to 1 is varied."""
    return 1.0 - factor * (1.0 - value) if name == "gate" else varied(value, factor)


@contextmanager
def changed(group: object, name: str, value: object) -> Iterator[None]:
    """Give a number of a frozen group another value for a while; every reader of the group sees it."""
    usual = getattr(group, name)
    object.__setattr__(group, name, value)
    try:
        yield
    finally:
        object.__setattr__(group, name, usual)


def print_table(
    parameters: object,
    score: Callable[[], Mapping[str, float]],
    *,
    leave_out: tuple[str, ...] = (),
    groups: str | None = None,
) -> None:
    """Print the figures at the usual values, and as Markdown how each number changes them.

    Args:
        parameters: Groups of numbers, as `controllers/slip/effort/parameters.py` has them.
        score: Computes the figures anew, by label.
        leave_out: Numbers not to vary, as `group.name`.
        groups: Names of the groups to vary, with commas; all of them when None.
    """
    usual = score()
    print("as shipped: " + ", ".join(f"{label} {value:.3g}" for label, value in usual.items()))
    print("\n| number | value | " + " | ".join(usual) + " |\n" + "|---" * (2 + len(usual)) + "|")
    for part in fields(parameters):  # type: ignore[arg-type]
        if groups is not None and part.name not in groups.split(","):
            continue
        group = getattr(parameters, part.name)
        for name in (number.name for number in fields(group)):
            if f"{part.name}.{name}" in leave_out:
                continue
            value = getattr(group, name)
            results = []
            for factor in FACTORS:
                with changed(group, name, _of(name, value, factor)):
                    results.append(score())
            cells = [" / ".join(f"{result[key] - usual[key]:+.2g}" for result in results) for key in usual]
            print(f"| {part.name}.{name} | {value:.4g} | {' | '.join(cells)} |", flush=True)
