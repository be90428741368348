"""What stops a rover, ends its run or is tolerated, as data: the reference page of safety is made of it."""

from enum import StrEnum
from typing import NamedTuple

WHEN_GONE = "when the cause is gone"
AFTER_A_WAIT = "by itself; the cause cannot be detected at standstill"
RESTART = "restart"


class Outcome(StrEnum):
    """What an event does to a run.

    STOPS: Zero setpoints; the run goes on.
    ENDS: The drive is stopped, and the run ends.
    CONTINUES: The rover drives on, or stops only where the event states it.
    FINDING: Reported about a drive that somebody else controlled.
    """

    STOPS = "stops"
    ENDS = "ends"
    CONTINUES = "continues"
    FINDING = "finding"


class SafetyEvent(NamedTuple):
    """A row of the reference page of safety, kept next to the code that it describes.

    Attributes:
        outcome: What the event does to a run.
        event: What happens.
        result: The reason, the end of the run, or what the program does.
        tests: Files and names of the tests that show it.
        within: Time from the event to the command.
        settings: Keys that decide it; of `[safety]` where a key has no table.
        clears: What lets the rover move again.
    """

    outcome: Outcome
    event: str
    result: str
    tests: tuple[str, ...]
    within: str = ""
    settings: tuple[str, ...] = ()
    clears: str = ""
