"""Range checks of physical quantities; errors name parameter, value, unit and range."""

import math

import numpy as np
from numpy.typing import ArrayLike
from pydantic import AfterValidator, ValidationInfo

from drivers.errors import ModelError


def quantity(unit: str, lower: float, upper: float) -> AfterValidator:
    """Return a check for a field of settings: the value must lie in `lower` to `upper`, both included.

    Args:
        unit: Unit in the message; "1" for a pure number.
        lower: Least value.
        upper: Greatest value.
    """

    def check(value: float, info: ValidationInfo) -> float:
        if not lower <= value <= upper:
            raise ValueError(_message(info.field_name or "value", value, unit, lower, upper))
        return value

    return AfterValidator(check)


def check_range(name: str, values: ArrayLike, unit: str, lower: float, upper: float) -> None:
    """Check that a number or every number of an array is finite and within `lower` to `upper`.

    Args:
        name: Name of the parameter.
        values: Number or array.
        unit: Unit in the message; "1" for a pure number.
        lower: Least value.
        upper: Greatest value.

    Raises:
        ModelError: A value is not a number, or outside; names parameter, value, unit and range.
    """
    numbers = np.atleast_1d(np.asarray(values, dtype=np.float64))
    wrong = ~((numbers >= lower) & (numbers <= upper))
    if wrong.any():
        raise ModelError(_message(name, float(numbers[wrong][0]), unit, lower, upper) + ".")


def _message(name: str, value: float, unit: str, lower: float, upper: float) -> str:
    shown = "" if unit == "1" else f" {unit}"
    text = f"{name} is {value:g}{shown}, outside {lower:g} .. {upper:g}{shown}"
    if unit == "rad" and not math.isnan(value) and abs(math.radians(value)) <= upper:
        text += f" (degrees? {value:g} deg is {math.radians(value):.4g} rad)"
    return text
