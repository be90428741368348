"""Several operators of one run as one."""

from collections.abc import Sequence
from dataclasses import replace

from controllers.operator import OperatorInput, merge
from rover_hil.run.executive import CycleView, End, Operator


class Operators:
    """Operates a run for several sides, of which each may stop the rover.

    Of what more than one changes in a cycle, the last side counts. The rover may move where no side has a
    reason to stop it: none releases the stop of another.

    Args:
        sides: The operators.
    """

    def __init__(self, sides: Sequence[Operator]) -> None:
        self._sides = sides
        self._reasons = [""] * len(sides)

    def wanted(self) -> OperatorInput | None:
        """Return what all sides want from this cycle on; None for no change."""
        wanted: OperatorInput | None = None
        for number, side in enumerate(self._sides):
            new = side.wanted()
            if new is None:
                continue
            if new.stop_reason is not None:
                self._reasons[number] = new.stop_reason
            wanted = new if wanted is None else merge(wanted, new)
        if wanted is None or wanted.stop_reason is None:
            return wanted
        return replace(wanted, stop_reason=next(filter(None, self._reasons), ""))

    def end(self) -> tuple[End, str] | None:
        """Return how and why the first side that wants so ends the run; None to go on."""
        return next(filter(None, [side.end() for side in self._sides]), None)

    def show(self, view: CycleView) -> None:
        """Show a cycle to all sides."""
        for side in self._sides:
            side.show(view)
