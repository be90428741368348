"""Enter values into the text of a configuration; its comments and order stay."""

from collections.abc import Mapping
from typing import Any

import tomlkit


def with_entry(text: str, section: str, key: str, value: str | float) -> str:
    """Return the text of a configuration with another value; the key is added where it is not there.

    Args:
        text: A valid configuration.
        section: Name of the table, with dots.
        key: Key in it.
        value: Its new value.
    """
    document = tomlkit.parse(text)
    place: Any = document
    *outer, last = section.split(".")
    for part in outer:
        place = place.setdefault(part, tomlkit.table(is_super_table=True))
    place.setdefault(last, tomlkit.table())[key] = value
    return document.as_string()


def with_table(text: str, section: str, name: str, table: Mapping[str, object]) -> str:
    """Return the text of a configuration with a table; it replaces an earlier one.

    Args:
        text: A valid configuration with the section.
        section: Name of the table that holds it, without dots.
        name: Its name there.
        table: Its content; tables in it become one line for each of their keys.
    """
    document = tomlkit.parse(text)
    place: Any = document[section]
    place.pop(name, None)
    place[name] = {key: _with_inline_tables(value) for key, value in table.items()}
    return document.as_string()


def _with_inline_tables(value: object) -> object:
    if not isinstance(value, Mapping):
        return value
    table = tomlkit.table()
    for key, inner in value.items():
        if isinstance(inner, Mapping):
            line = tomlkit.inline_table()
            line.update(inner)
            table[key] = line
        else:
            table[key] = inner
    return table
