"""Base of all settings models, and the TOML files that hold them."""

from collections.abc import Sequence
from importlib.abc import Traversable
from pathlib import Path

from pydantic import BaseModel, ConfigDict
from pydantic_core import ErrorDetails

from drivers.errors import ConfigError
from drivers.files import parse_toml, read_text


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
