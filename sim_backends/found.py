"""What recorded drives have shown of a simulated rover: numbers with intervals, and what depends on them."""

from typing import Annotated, Any, Self

from pydantic import Field, model_validator

from drivers.settings import Settings


class FoundNumber(Settings):
    """A number that recorded drives have shown.

    Attributes:
        value: The number, with which the values of [simulation] are as they are written.
        low: Lower end of its 95 % interval.
        high: Upper end of it.
        moves: By how much each value of [simulation] changes per change of the number, by the dotted key of
            the value, e.g. "devices.imu.gyro_noise_deg_s".
    """

    value: float
    low: float
    high: float
    moves: Annotated[dict[str, float], Field(min_length=1)]

    @model_validator(mode="after")
    def _check_order(self) -> Self:
        if not self.low <= self.value <= self.high:
            raise ValueError(
                f"value {self.value:g} is not between low {self.low:g} and high {self.high:g}: correct them"
            )
        return self


class FoundSettings(Settings):
    """What recorded drives have shown of this rover; written by `--enter` of `rover-hil diagnose`.

    `tune` draws each number of each scenario from its interval, and keeps the site of the configuration.
    `gap rover` does not judge the simulation by these drives.

    Attributes:
        drives: Names of the drives.
        found_on: Day of the diagnosis, as 2026-01-31.
        numbers: What they have shown, by name.
    """

    drives: Annotated[tuple[str, ...], Field(min_length=1)]
    found_on: str
    numbers: Annotated[dict[str, FoundNumber], Field(min_length=1)]


def move(simulation: dict[str, Any], key: str, change: float) -> None:
    """Change one value of a simulation.

    Args:
        simulation: [simulation] as a table.
        key: Dotted key of the value in it; of a list its place, from 0.
        change: Is added to the value.

    Raises:
        ValueError: There is no such value, or it is no float.
    """
    place: Any = simulation
    *outer, last = [int(part) if part.isdigit() else part for part in key.split(".")]
    try:
        for part in outer:
            place = place[part]
        value = place[last]
    except (IndexError, KeyError, TypeError):
        value = None
    if not isinstance(value, float):
        raise ValueError(
            f"[simulation] states no number '{key}': add it, or remove it from moves; or repeat "
            "`--enter` of `rover-hil diagnose`"
        )
    place[last] = value + change
