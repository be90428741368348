"""Base of all settings models, and the TOML files that hold them."""

from collections.abc import Sequence
from importlib.abc import Traversable
from pathlib import Path
from typing import Annotated, TypeAlias

from pydantic import AfterValidator, BaseModel, ConfigDict, Field
from pydantic_core import ErrorDetails

from drivers.errors import ConfigError
from drivers.files import LONGEST_NAME_BYTES, LONGEST_PATH, parse_toml, read_text


def _check_path(text: str) -> str:
    if "\0" in text or any(
        len(part.encode("utf-8", "replace")) > LONGEST_NAME_BYTES for part in text.split("/")
    ):
        raise ValueError("no file can have this name: correct it")
    return text


PathText: TypeAlias = Annotated[
    str, Field(min_length=1, max_length=LONGEST_PATH), AfterValidator(_check_path)
]
"""Name or path of a file or port, as a configuration holds it."""


class Settings(BaseModel):
    """Frozen; unknown keys are errors; NaN and infinity are errors."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


def read_toml(path: Path | Traversable, what: str, fix: str) -> dict[str, object]:
    """Return the content of a TOML file.

    Args:
        path: The file.
        what: Its kind and name, for messages.
        fix: What to do where it cannot be read.

    Raises:
        ConfigError: It cannot be read, or is not TOML.
    """
    try:
        return parse_toml(read_text(path) if isinstance(path, Path) else path.read_text("utf-8"))
    except OSError as error:
        raise ConfigError(f"cannot read {what}: {error.strerror}; {fix}") from error
    except ValueError as error:
        raise ConfigError(f"{what} is not valid TOML: {error}") from error


def direct_mistakes(details: Sequence[ErrorDetails]) -> list[ErrorDetails]:
    """Return errors without those that only follow: a collection too short as its parts are not valid."""
    return [
        detail
        for detail in details
        if detail["type"] != "too_short"
        or not any(other["loc"][: len(detail["loc"])] == detail["loc"] != other["loc"] for other in details)
    ]
