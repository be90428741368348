"""Tables as the text of a TOML file."""

import json
from collections.abc import Mapping, Sequence
from datetime import date


def toml_text(table: Mapping[str, object], digits: int | None = None, prefix: str = "") -> str:
    """Return TOML; plain values first, as TOML requires them before a table's own tables.

    Args:
        table: Its content, without None.
        digits: Significant digits of its floats; None for all.
        prefix: The table's own place in the file, with a dot behind it.
    """
    plain: list[str] = []
    tables: list[str] = []
    for key, value in table.items():
        place = f"{prefix}{key}"
        if isinstance(value, Mapping):
            tables.append(f"\n[{place}]\n{toml_text(value, digits, f'{place}.')}")
        elif isinstance(value, (tuple, list)) and value and isinstance(value[0], Mapping):
            tables += [f"\n[[{place}]]\n{toml_text(item, digits, f'{place}.')}" for item in value]
        else:
            plain.append(f"{key} = {_value(value, digits)}\n")
    return "".join(plain + tables)


def _value(value: object, digits: int | None) -> str:
    match value:
        case float():
            return repr(value if digits is None else float(f"{value:.{digits}g}"))
        case str():
            return json.dumps(value, ensure_ascii=False)
        case Sequence():
            return f"[{', '.join(_value(item, digits) for item in value)}]"
        case date():
            return value.isoformat()
        case _:
            return json.dumps(value)
