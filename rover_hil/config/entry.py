"""Enter a value into the text of a configuration; its comments and order stay."""

import json
import re
import tomllib

from drivers.errors import ConfigError


def with_entry(text: str, section: str, key: str, value: str | float) -> str:
    """Return the text of a configuration with another value; the key is added where it is not there.

    Args:
        text: A valid configuration.
        section: Name of the table, with dots.
        key: Key in it.
        value: Its new value.

    Raises:
        ConfigError: The section is written in a way that cannot be edited.
    """
    expected = tomllib.loads(text)
    place = expected
    for part in section.split("."):
        place = place.setdefault(part, {})
    place[key] = value
    edited = _edited(text, section, key, json.dumps(value, ensure_ascii=False))
    try:
        is_right = tomllib.loads(edited) == expected
    except tomllib.TOMLDecodeError:
        is_right = False
    if not is_right:
        raise ConfigError(
            f"cannot enter {section}.{key} into the configuration: write it as a 'key = value' line below "
            f"[{section}]"
        )
    return edited


def _edited(text: str, section: str, key: str, shown: str) -> str:
    header = re.search(rf"^[ \t]*\[[ \t]*{re.escape(section)}[ \t]*\][ \t]*(#.*)?\n", text, re.MULTILINE)
    line = f"{key} = {shown}\n"
    if header is None:
        return f"{text.rstrip()}\n\n[{section}]\n{line}"
    following = re.compile(r"^\s*\[", re.MULTILINE).search(text, header.end())
    end = len(text) if following is None else following.start()
    body = text[header.end() : end]
    pattern = re.compile(rf"^([ \t]*{re.escape(key)}[ \t]*=[ \t]*)(\"[^\"\n]*\"|[^\s#]+)", re.MULTILINE)
    edited, count = pattern.subn(lambda found: found[1] + shown, body)
    if not count:
        kept = body.rstrip()
        edited = f"{kept}\n{line}{body[len(kept) :].removeprefix(chr(10))}" if kept else line + body
    return text[: header.end()] + edited + text[end:]
