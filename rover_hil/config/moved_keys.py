"""Keys of configurations that moved or are called otherwise, and what answers them."""

import sys
from collections.abc import Mapping, MutableMapping, Sequence

from controllers.settings import OLD_SCOMP_KEY

SITE = 'the ground is a map now: remove this, and name one in [simulation.plant], e.g. site = "floor_table"'
REMOVED: Mapping[tuple[str, ...], str] = {
    ("simulation", "plant", "floor"): SITE,
    ("simulation", "plant", "patches"): SITE,
}
"""Keys, and what to do instead."""
RENAMED_VALUES: Mapping[tuple[str, ...], str] = {("simulation", "plant", "type", "four_wheel"): "el_dorado"}
"""Keys with an earlier value, and the value of today."""


def fix_of(key: Sequence[str | int]) -> str:
    """Return what to do about a key that was removed; empty for any other."""
    return REMOVED.get(tuple(map(str, key)), "")


def new_value(key: Sequence[str | int], value: object) -> str:
    """Return how a value of a key is called today; empty where it never was one."""
    return RENAMED_VALUES.get((*map(str, key), str(value)), "")


def rename_sections(table: MutableMapping[str, object]) -> None:
    """Accept sections under the names of the version before, with a note to the user."""
    if OLD_SCOMP_KEY in table and "scomp" not in table:
        note = f"[{OLD_SCOMP_KEY}] is now called [scomp]: rename it, the next version knows the new name only"
        print(note, file=sys.stderr)  # noqa: T201 - a note to the user
        table["scomp"] = table.pop(OLD_SCOMP_KEY)
