"""Stop rule about the area that the rover must not leave."""

import math
from collections.abc import Iterator
from enum import Enum, auto

from controllers.fault import Cause, ClearedBy, Fault, Severity
from controllers.safety.reasons import Cycle, StopRule
from drivers.safety_event import WHEN_GONE, Outcome, SafetyEvent

AT_START = (
    "rover: its region reaches over the border of safety.area before it has moved: enlarge the area, or "
    "start the run farther inside"
)
UNKNOWN = "rover: its position is not known, so that it may be outside safety.area"
CONFIRM = (
    "confirm on the page of `rover-hil bench` that it may move back inside; without the page end the run, "
    "and drive the rover back with `rover-hil bench`"
)
RETURNS = (
    "rover: its region is over the border of safety.area: only motion that leads back inside is possible"
)


class _State(Enum):
    INSIDE = auto()
    WAITS = auto()
    RETURNS = auto()


class AreaRule(StopRule):
    """Stops when the region of the rover crosses the border of its area, until an operator confirms.

    Then the rover may move back inside, as long as the greatest excess since the crossing does not grow.
    Where the region is inside again, the rule begins anew. Before the first motion nothing has to be
    confirmed.
    """

    observes = ()
    is_for_drives = False

    events = (
        SafetyEvent(
            Outcome.STOPS,
            "The region of the rover crosses the border of `area`, or its position is no longer known.",
            "`rover: its region crossed the border of safety.area, estimated position …, … m; confirm …`",
            (
                "tests/controllers/safety/test_area_rule.py::"
                "test_the_set_points_are_zero_in_the_cycle_in_which_the_region_crosses",
                "tests/controllers/safety/test_area_rule.py::"
                "test_by_hand_only_motion_back_inside_is_possible_after_the_confirmation",
                "tests/controllers/safety/test_area_rule.py::"
                "test_a_position_that_is_not_known_cannot_be_confirmed",
            ),
            within="one cycle",
            settings=("area", "area_body_m"),
            clears="when an operator confirms on the page of `bench`. Then only motion that leads back "
            "inside, and rotation on the spot, is possible. These stops do not count for "
            "`identical_stops`. Without the page: end the run, and drive the rover back with "
            "`bench`",
        ),
        SafetyEvent(
            Outcome.STOPS,
            "The region reaches over the border before the first motion.",
            "`rover: its region reaches over the border of safety.area before it has moved: …`",
            (
                "tests/controllers/safety/test_area_rule.py::"
                "test_before_the_first_motion_the_reason_ends_by_itself",
            ),
            within="no motion",
            settings=("area",),
            clears=WHEN_GONE,
        ),
    )

    def __init__(self) -> None:
        self._state = _State.INSIDE
        self._has_moved = False
        self._greatest_m = 0.0
        self._text = ""

    def check(self, cycle: Cycle) -> Iterator[Fault]:
        """Return the reason to stop; while the rover may move back, one that is only shown."""
        over_m = cycle.operation.over_border_m
        self._has_moved |= any(cycle.wheels.set.speed_rad_s)
        if self._state is _State.INSIDE and over_m > 0.0:
            if not self._has_moved:
                yield Fault("rover", Cause.AREA, AT_START)
                return
            self._state, self._text = _State.WAITS, f"{_crossing(cycle)}; {CONFIRM}"
        elif self._state is _State.WAITS and cycle.operation.is_confirmed and math.isfinite(over_m):
            self._state = _State.RETURNS
        if self._state is _State.RETURNS and (over_m > self._greatest_m or cycle.operation.is_led_out):
            self._state = _State.WAITS
        if self._state is _State.WAITS:
            self._greatest_m = max(self._greatest_m, over_m if math.isfinite(over_m) else 0.0)
            yield Fault("rover", Cause.AREA, self._text, cleared_by=ClearedBy.OPERATOR)
        elif over_m <= 0.0:
            self._state, self._greatest_m = _State.INSIDE, 0.0
        else:
            yield Fault("rover", Cause.AREA, RETURNS, Severity.WARNING)


def _crossing(cycle: Cycle) -> str:
    if not math.isfinite(cycle.operation.over_border_m):
        return UNKNOWN
    x_m, y_m = cycle.estimate.x_m, cycle.estimate.y_m
    return f"rover: its region crossed the border of safety.area, estimated position {x_m:.2f}, {y_m:.2f} m"
