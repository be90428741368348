"""Enter values into the text of a configuration; its comments and order stay."""

from collections.abc import Mapping, Sequence
from typing import Any, TypeAlias

import tomlkit
from tomlkit.items import InlineTable

EntryValue: TypeAlias = "str | float | Mapping[str, object] | Sequence[Mapping[str, object]] | None"


def with_entry(text: str, section: str, key: str, value: EntryValue) -> str:
    """Return the text of a configuration with another value; the key is added where it is not there.

    Args:
        text: A valid configuration.
        section: Name of the table, with dots.
        key: Key in it.
        value: Its new value. Of tables that are there already, as many, only the keys given are changed. None
            removes the key. A table replaces an earlier value; tables in it become one line for each of
            their keys.
    """
    document = tomlkit.parse(text)
    place: Any = document
    *outer, last = section.split(".")
    for part in outer:
        place = place.setdefault(part, tomlkit.table(is_super_table=True))
    table = place.setdefault(last, tomlkit.table())
    present = table.get(key)
    if value is None:
        table.pop(key, None)
    elif isinstance(value, Mapping):
        table.pop(key, None)
        table[key] = {name: _with_inline_tables(each) for name, each in value.items()}
    elif isinstance(value, Sequence) and not isinstance(value, str):
        if present is not None and len(present) == len(value):
            for row, changes in zip(present, value, strict=True):
                for name, each in changes.items():
                    if row.get(name) != each:
                        row[name] = each
        else:
            rows = tomlkit.array()
            for changes in value:
                rows.append(_inline(changes))
            table[key] = rows.multiline(multiline=True)
    else:
        table[key] = value
    return document.as_string()


def _with_inline_tables(value: object) -> object:
    if not isinstance(value, Mapping):
        return value
    table = tomlkit.table()
    for key, inner in value.items():
        table[key] = _inline(inner) if isinstance(inner, Mapping) else inner
    return table


def _inline(table: Mapping[str, object]) -> InlineTable:
    line = tomlkit.inline_table()
    line.update(table)
    return line
