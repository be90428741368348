"""Lists of numbers as they are written on the command line."""

from decimal import Decimal, InvalidOperation

from drivers.errors import ConfigError
from sim_backends.terramechanics.soil.quantity import check_range

LONGEST = 10_000


def parse_numbers(option: str, text: str, unit: str, lower: float, upper: float) -> tuple[float, ...]:
    """Return the numbers of `a,b,c` or `from:to:step`, the end included where a step meets it.

    Steps are counted in decimals, so that `0:0.3:0.1` ends with 0.3.

    Args:
        option: Where it was written, for messages.
        text: The list.
        unit: Of the numbers, for messages; "1" for pure numbers.
        lower: Least value.
        upper: Greatest value.

    Raises:
        ConfigError: Not such a list, or one of more than `LONGEST` numbers.
        ModelError: A number is outside its range, or not a number.
    """
    numbers: list[float] = []
    for part in text.split(","):
        try:
            numbers += _part([Decimal(word.strip()) for word in part.split(":")])
        except (InvalidOperation, ValueError):
            shown = "" if unit == "1" else f" in {unit}"
            raise ConfigError(
                f"{option} is '{text}', no list of numbers{shown} within {lower:g} .. {upper:g}: "
                f"write a,b,c or from:to:step, at most {LONGEST} numbers."
            ) from None
    check_range(option, numbers, unit, lower, upper)
    return tuple(numbers)


def _part(words: list[Decimal]) -> list[float]:
    if len(words) == 1:
        return [float(words[0])]
    start, end, step = words
    if not (start.is_finite() and end.is_finite() and step.is_finite()) or step == 0:
        raise ValueError
    steps = int((end - start) / step)
    if not 0 <= (end - start) / step < LONGEST:
        raise ValueError
    return [float(start + index * step) for index in range(steps + 1)]
