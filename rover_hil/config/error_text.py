"""One line per mistake in a file: source, key, what is wrong, how to fix it."""

import reprlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from difflib import get_close_matches
from typing import TypeVar

from pydantic import ValidationError
from pydantic_core import ErrorDetails

from drivers.errors import ConfigError
from drivers.settings import Settings, direct_mistakes
from rover_hil.config.moved_keys import fix_of, new_value

MOST_MISTAKES = 100
_REPRESENTATION = reprlib.Repr()
_REPRESENTATION.maxstring = _REPRESENTATION.maxother = _REPRESENTATION.maxlong = 100
LONGEST_KEY = 80
"""A longer key was not mistyped; to compare it with known ones takes long."""
DISCRIMINATORS = ("type", "kinematics")
"""Keys whose value decides which other keys a table has."""

SettingsT = TypeVar("SettingsT", bound=Settings)


def validated(kind: type[SettingsT], table: Mapping[str, object], source: str) -> SettingsT:
    """Return the settings in a table.

    Raises:
        ConfigError: It holds mistakes; one line per mistake with `source`, key and fix.
    """
    try:
        return kind.model_validate(table)
    except ValidationError as error:
        raise ConfigError(describe_validation_error(source, error, table)) from error


def describe_validation_error(source: str, error: ValidationError, table: Mapping[str, object]) -> str:
    """Return one line per mistake.

    Args:
        source: File or table that holds the mistakes.
        error: What pydantic found.
        table: The content that was validated.
    """
    return join_lines(source, describe_mistakes(error.errors(), table))


def join_lines(source: str, mistakes: Iterable[str]) -> str:
    """Return one line per different mistake, each with its source."""
    return "\n".join(f"{source}: {mistake}" for mistake in dict.fromkeys(mistakes))


def describe_mistakes(details: Sequence[ErrorDetails], table: Mapping[str, object]) -> list[str]:
    """Return key, mistake and fix of every error.

    Args:
        details: What pydantic found; only the first `MOST_MISTAKES` are described.
        table: The content that was validated.
    """
    untold = len(details) - MOST_MISTAKES
    details = details[:MOST_MISTAKES]
    mistyped = {
        (*detail["loc"][:-1], _closest_key(detail, table))
        for detail in details
        if detail["type"] == "extra_forbidden"
    }
    # A mistyped key is reported twice, as missing and as unknown; the latter is clearer.
    mistakes = [
        mistake
        for detail in direct_mistakes(details)
        if detail["type"] != "missing" or detail["loc"] not in mistyped
        for mistake in _describe(detail, table)
    ]
    return [*mistakes, f"and {untold} more mistakes: correct these first"] if untold > 0 else mistakes


def _describe(detail: ErrorDetails, table: Mapping[str, object]) -> list[str]:
    key = ".".join(str(part) for part in _toml_path(detail, table))
    if detail["type"] != "value_error":
        return [f"{key or 'the file'}: {_explain(detail, table)}"]
    prefix = f"{key}: " if key else ""
    return [prefix + line for line in detail["msg"].removeprefix("Value error, ").splitlines()]


def _toml_path(detail: ErrorDetails, table: Mapping[str, object]) -> list[str | int]:
    """Drop the parts of pydantic's location that name a union's branch rather than a key."""
    return [part for part, _ in _walk(detail, table)]


def _walk(detail: ErrorDetails, table: Mapping[str, object]) -> Iterator[tuple[str | int, object]]:
    """Yield each key on the way to a mistake, with the table or list that holds it."""
    value: object = table
    branch_of: object = None
    for index, part in enumerate(detail["loc"]):
        is_last = index == len(detail["loc"]) - 1
        if isinstance(value, Mapping) and value is not branch_of and _is_branch(part, value):
            # A branch may have the name of a key: type "wheels" has a key wheels.
            branch_of = value
            continue
        if isinstance(value, Mapping):
            if part in value or (is_last and detail["type"] == "missing"):
                yield part, value
                value = value.get(str(part))
        elif isinstance(value, list) and isinstance(part, int) and part < len(value):
            yield part, value
            value = value[part]


def _is_branch(part: str | int, table: Mapping[object, object]) -> bool:
    return any(table.get(key) == part for key in DISCRIMINATORS)


def _explain(detail: ErrorDetails, table: Mapping[str, object]) -> str:
    kind = detail["type"]
    if kind == "missing":
        return "this key is missing; add it"
    if kind == "extra_forbidden":
        moved = fix_of(_toml_path(detail, table))
        if moved:
            return moved
        close = _closest_key(detail, table)
        fix = f"did you mean {close}?" if close else "it does not belong here, remove it"
        return f"unknown key; {fix}"
    if kind in ("union_tag_invalid", "union_tag_not_found"):
        tag = detail.get("ctx", {}).get("discriminator", "'type'")
        renamed = new_value(
            [*_toml_path(detail, table), tag.strip("'")], detail.get("ctx", {}).get("tag", "")
        )
        if renamed:
            return f"{tag} is called '{renamed}' now"
        expected = detail.get("ctx", {}).get("expected_tags", "")
        return f"{tag} must be one of {expected}" if expected else f"the key {tag} is missing; add it"
    message = detail["msg"]
    return f"{message[0].lower()}{message[1:]}, got {_REPRESENTATION.repr(detail['input'])}"


def _closest_key(detail: ErrorDetails, table: Mapping[str, object]) -> str:
    """Return the key that an unknown one was probably meant to be; "" without one."""
    key = str(detail["loc"][-1])
    if len(key) > LONGEST_KEY:
        return ""
    holders = [holder for _, holder in _walk(detail, table)]
    neighbours = set(holders[-1]) - {key} if holders and isinstance(holders[-1], Mapping) else set()
    # The table is of the kind that knows most of the other keys in it.
    kinds = list(_all_keys(Settings))
    most = max(len(keys & neighbours) for keys in kinds)
    known = set().union(*(keys for keys in kinds if len(keys & neighbours) == most))
    close = get_close_matches(key, known - {key}, n=1, cutoff=0.6)
    return close[0] if close and key not in known else ""


def _all_keys(kind: type[Settings]) -> Iterator[set[str]]:
    yield {field.alias or name for name, field in kind.model_fields.items()}
    for inner in kind.__subclasses__():
        yield from _all_keys(inner)
