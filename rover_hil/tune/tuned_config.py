"""Write tuned values into the text of a configuration; its comments and order stay."""

import json
import re
import tomllib
from collections.abc import Mapping

from drivers.errors import ConfigError
from rover_hil.config.tune_settings import ProvenanceRecord
from rover_hil.tune.parameters import Values

PROVENANCE = "tune.provenance"


def tuned_text(text: str, values: Values, provenance: ProvenanceRecord | None) -> str:
    """Return the text of a configuration with new values and their provenance.

    Args:
        text: A valid configuration.
        values: By dotted key.
        provenance: Replaces that of an earlier tuning; None leaves it as it is.

    Raises:
        ConfigError: This editor does not find a value.
    """
    expected = tomllib.loads(text)
    for key, value in values.items():
        text = _with_value(text, key, value)
        _put(expected, key, value)
    if provenance is not None:
        record = provenance.model_dump(mode="json", exclude_none=True)
        text = f"{_without_section(text, PROVENANCE).rstrip()}\n\n{_tables(PROVENANCE, record)}"
        _put(expected, PROVENANCE, record)
    try:
        is_right = tomllib.loads(text) == expected
    except tomllib.TOMLDecodeError:
        is_right = False
    if not is_right:
        raise ConfigError(
            f"cannot write tuned values into the configuration: write {', '.join(values)} and [tune] as "
            "'key = value' lines below their [section]"
        )
    return text


def _with_value(text: str, dotted_key: str, value: float) -> str:
    """Replace a value in its section; add the line, or the section, where there is none."""
    section, _, key = dotted_key.rpartition(".")
    header = re.search(_header(section), text, re.MULTILINE)
    line = f"{key} = {value!r}\n"
    if header is None:
        return f"{text.rstrip()}\n\n[{section}]\n{line}"
    following = re.compile(r"^\s*\[", re.MULTILINE).search(text, header.end())
    end = len(text) if following is None else following.start()
    body = text[header.end() : end]
    edited, count = re.subn(
        rf"^(\s*{re.escape(key)}\s*=\s*)[^\s#]+", rf"\g<1>{value!r}", body, flags=re.MULTILINE
    )
    return text[: header.end()] + (edited if count else line + body) + text[end:]


def _without_section(text: str, section: str) -> str:
    """Remove a section and its subsections."""
    kept: list[str] = []
    is_inside = False
    for line in text.splitlines(keepends=True):
        if line.lstrip().startswith("["):
            is_inside = re.match(rf"\s*\[\s*{re.escape(section)}\s*[.\]]", line) is not None
        if not is_inside:
            kept.append(line)
    return "".join(kept)


def _header(section: str) -> str:
    return rf"^[ \t]*\[[ \t]*{re.escape(section)}[ \t]*\][ \t]*(#.*)?\n"


def _tables(name: str, record: Mapping[str, object]) -> str:
    """Return a table as TOML; tables within it follow, each as one inline table per line."""
    lines = [f"[{name}]"]
    inner: list[str] = []
    for key, value in record.items():
        if isinstance(value, dict):
            inner += ["", f"[{name}.{key}]", *(f"{json.dumps(k)} = {_inline(v)}" for k, v in value.items())]
        else:
            lines.append(f"{key} = {_inline(value)}")
    return "\n".join([*lines, *inner]) + "\n"


def _inline(value: object) -> str:
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{key} = {_inline(inner)}" for key, inner in value.items()) + " }"
    return json.dumps(value, ensure_ascii=False)


def _put(table: dict[str, object], dotted_key: str, value: object) -> None:
    first, _, rest = dotted_key.partition(".")
    inner = table.setdefault(first, {})
    if rest and isinstance(inner, dict):
        _put(inner, rest, value)
    else:
        table[first] = value
