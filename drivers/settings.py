"""Base of all settings models."""

from collections.abc import Sequence

from pydantic import BaseModel, ConfigDict
from pydantic_core import ErrorDetails


class Settings(BaseModel):
    """Frozen; unknown keys are errors; NaN and infinity are errors."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


def direct_mistakes(details: Sequence[ErrorDetails]) -> list[ErrorDetails]:
    """Return errors without those that only follow: a collection too short as its parts are not valid."""
    return [
        detail
        for detail in details
        if detail["type"] != "too_short"
        or not any(other["loc"][: len(detail["loc"])] == detail["loc"] != other["loc"] for other in details)
    ]
