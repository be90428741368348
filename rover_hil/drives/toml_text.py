"""Tables as the text of a TOML file."""

from collections.abc import Mapping

import tomlkit


def toml_text(table: Mapping[str, object], digits: int | None = None) -> str:
    """Return TOML.

    Args:
        table: Its content, without None.
        digits: Significant digits of its floats; None for all.
    """
    return tomlkit.dumps({key: _rounded(value, digits) for key, value in table.items()})


def _rounded(value: object, digits: int | None) -> object:
    match value:
        case float() if digits is not None:
            return float(f"{value:.{digits}g}")
        case Mapping():
            return {key: _rounded(inner, digits) for key, inner in value.items()}
        case tuple() | list():
            return [_rounded(inner, digits) for inner in value]
        case _:
            return value
