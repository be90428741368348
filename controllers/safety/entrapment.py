"""Stop rule about a rover that does not get on although its wheels turn."""

from collections.abc import Iterator
from typing import Annotated

from pydantic import Field

from controllers.safety.reasons import Cycle, Severity, StopReason, StopRule
from drivers.settings import Settings


class EntrapmentSettings(Settings):
    """When wheels that turn without moving the rover stop it.

    Attributes:
        entrapment_m: The rover stops until restart when its wheels have travelled this far without a break at
            a slip of at least `entrapment_slip`: they dig in.
        entrapment_slip: Only valid slip of the yaw excitation counts.
    """

    entrapment_m: Annotated[float, Field(ge=0.02, le=100.0)] = 0.5
    entrapment_slip: Annotated[float, Field(ge=0.5, le=1.0)] = 0.85


class EntrapmentRule(StopRule):
    """Adds up the travel of the wheels at a slip near 1. Smaller slip clears; unknown slip does not."""

    def __init__(self, settings: EntrapmentSettings) -> None:
        self._settings = settings
        self._travelled_m = 0.0

    def check(self, cycle: Cycle) -> Iterator[StopReason]:
        """Take the travel of a cycle; return a reason when the rover is entrapped."""
        if cycle.slip is not None:
            is_held = cycle.slip >= self._settings.entrapment_slip
            self._travelled_m = self._travelled_m + cycle.distance_m if is_held else 0.0
        if self._travelled_m >= self._settings.entrapment_m:
            text = (
                f"rover: entrapped, its wheels travelled {self._settings.entrapment_m:g} m at a slip of "
                f"at least {self._settings.entrapment_slip:g}: free it and restart"
            )
            yield StopReason("entrapment", text, Severity.FINAL)
