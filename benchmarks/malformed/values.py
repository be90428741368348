"""Values that no honest file holds, and where to put them into tables of TOML and JSON."""

import copy
import json
import math
import random
from collections.abc import Iterator, Sequence

DEEP_MARK = "@deep@"
HUGE_MARK = "@huge@"
VALUES: Sequence[object] = (
    None,
    True,
    "",
    "x",
    "\x00",
    "a\x1b[2Jb",
    "/dev/zero",
    "../../../../dev/zero",
    "n" * 5000,
    "y" * 300_000,
    -1,
    0,
    1,
    1e-308,
    1e308,
    -1e308,
    1e9,
    100_000_000,
    math.nan,
    math.inf,
    -math.inf,
    2**53 + 1,
    2**63,
    -(2**70),
    [],
    {},
    [[]],
    [0.0] * 100_000,
    {"x": 1},
    DEEP_MARK,
    HUGE_MARK,
)


def places_of(value: object) -> Iterator[tuple[str | int, ...]]:
    """Yield the path to each value inside a table or list."""
    parts: list[tuple[str | int, object]] = []
    if isinstance(value, dict):
        parts = list(value.items())
    elif isinstance(value, list):
        parts = list(enumerate(value))
    for key, inner in parts:
        yield (key,)
        yield from ((key, *below) for below in places_of(inner))


def change_at(value: object, place: Sequence[str | int], new: object) -> object:
    """Return a copy with another value at a place; without the key where it is `...`."""
    changed = copy.deepcopy(value)
    holder = changed
    for key in place[:-1]:
        holder = holder[key]  # type: ignore[index]
    if new is ...:
        del holder[place[-1]]  # type: ignore[attr-defined]
    else:
        holder[place[-1]] = new  # type: ignore[index]
    return changed


def change_somewhere(value: object, generator: random.Random) -> object:
    """Return a copy with a malformed value at a random place, or without what is there."""
    places = list(places_of(value))
    if not places:
        return generator.choice(VALUES)
    return change_at(value, generator.choice(places), generator.choice((*VALUES, ...)))


def raw_json(value: object) -> bytes:
    """Return JSON text, also of what Python cannot write as JSON."""
    text = json.dumps(value)
    text = text.replace(f'"{DEEP_MARK}"', "[" * 50_000 + "]" * 50_000)
    return text.replace(f'"{HUGE_MARK}"', "9" * 4000).encode()
