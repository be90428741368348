"""The cases of a seed: machines and, of every eighth number, drives of a rover; their answers and digest."""

import hashlib
import json
from collections.abc import Iterable, Iterator
from pathlib import Path

from tests.nature.hidden_machines.draw import CLASSES, draw
from tests.nature.hidden_machines.drives import answer_drives, draw_drives, write_drives
from tests.nature.hidden_machines.write import answer, write_case

PATTERN = ("catalogue", "outside", "none", "catalogue", "order", "catalogue", "outside", "none", "catalogue",
           "catalogue", "outside", "none", "catalogue", "order", "catalogue", "outside", "none", "catalogue",
           "outside", "none")  # fmt: skip
"""Classes of successive cases where all are drawn: 8 catalogue, 2 order, 5 outside, 5 none of twenty."""
EVERY, AT = 8, 5
"""Of every eighth number, the one at this place is a rover's."""

Key = tuple[str, int]


def keys(kind: str, first: int) -> Iterator[Key]:
    """Yield class and number of the first cases of a class, or of `all` classes in turn."""
    counts = dict.fromkeys(CLASSES, 0)
    for place in range(first):
        name = PATTERN[place % len(PATTERN)] if kind == "all" else kind
        yield name, counts[name]
        counts[name] += 1


def is_drive(key: Key) -> bool:
    """Return whether a case holds drives of a rover."""
    return key[0] not in ("order", "faint") and key[1] % EVERY == AT


def case_of(seed: int, key: Key) -> str:
    """Return the name of a case."""
    return f"{key[0]}-{seed}-{key[1]}"


def name_of(seed: int, key: Key, variant: int) -> str:
    """Return the name of the folder of a variant."""
    return f"{case_of(seed, key)}-{variant}"


def write(seed: int, key: Key, folder: Path, variants: Iterable[int] = (0,)) -> dict[str, object]:
    """Write variants of a case below a folder, one each, and return the answer."""
    if is_drive(key):
        drives = draw_drives(seed, *key)
        for variant in variants:
            write_drives(drives, folder / name_of(seed, key, variant), variant)
        return answer_drives(drives)
    case = draw(seed, *key)
    for variant in variants:
        write_case(case, folder / name_of(seed, key, variant), variant)
    return answer(case)


def answer_of(seed: int, key: Key) -> dict[str, object]:
    """Return the answer of a case."""
    return answer_drives(draw_drives(seed, *key)) if is_drive(key) else answer(draw(seed, *key))


def answer_line(entry: dict[str, object]) -> str:
    """Return an answer as a line whose numbers do not depend on the last bits of a computer's arithmetic."""
    return json.dumps(_rounded(entry), sort_keys=True)


def digest(lines: list[str]) -> str:
    """Return the SHA-256 of answers."""
    return hashlib.sha256("".join(f"{line}\n" for line in lines).encode()).hexdigest()


def _rounded(value: object) -> object:
    if isinstance(value, float):
        return float(f"{value:.4g}")
    if isinstance(value, dict):
        return {key: _rounded(entry) for key, entry in value.items()}
    return [_rounded(entry) for entry in value] if isinstance(value, list) else value
