"""When the clock of a recorder was set back, and when the stamps of a sound bag only look like it."""

from collections.abc import Callable, Iterator, Sequence

import pytest

from rover_hil.drives.formats.rosbag.bag import Bag, BagMessage

FIRST_NS = 1_700_000_000_000_000_000
SECOND_NS = 1_000_000_000
STEP_NS = 20_000_000


class Recorded(Bag):
    """The messages of a bag, without a file."""

    def __init__(self, messages: Sequence[BagMessage]) -> None:
        self._all = sorted(messages, key=lambda message: message.t_ns)
        self._set_back, self._is_clock_judged, self._end_ns = None, False, 0

    @property
    def sections(self) -> frozenset[str]:
        return frozenset(message.section for message in self._all)

    def _span(self) -> tuple[int, int]:
        return FIRST_NS, FIRST_NS + self._all[-1].t_ns

    def _recorded(self, section: str | None) -> Iterator[BagMessage]:
        yield from (each for each in self._all if section in (None, each.section))


def section(
    name: str,
    stamp_ns: Callable[[int], int | None] = lambda t_ns: t_ns,
    t_ns: Callable[[int], int] = lambda t_ns: t_ns,
    first_ns: int = 0,
) -> list[BagMessage]:
    """Return 10 s of messages; stamps count from the first recording of the bag."""
    times = range(first_ns, 10 * SECOND_NS, STEP_NS)
    return [BagMessage(name, "any", t_ns(each), stamp_ns(each), each) for each in times]


def set_back(by_ns: int) -> Callable[[int], int]:
    return lambda t_ns: t_ns - by_ns if t_ns >= 7 * SECOND_NS else t_ns


@pytest.mark.parametrize("by_ns", [SECOND_NS // 2, 2 * SECOND_NS, 5 * SECOND_NS])
@pytest.mark.parametrize("late_ns", [0, 3_000_000, 400_000_000])
def test_a_clock_that_was_set_back_gives_the_drive(by_ns: int, late_ns: int) -> None:
    """One section is stamped earlier than the other by a constant, as of another computer."""
    bag = Recorded(
        section("odometry", t_ns=set_back(by_ns))
        + section("imu", lambda t_ns: t_ns - late_ns, set_back(by_ns), 5_000_000)
    )
    step = bag.set_back
    assert step is not None
    assert step.by_ns == by_ns
    messages = [*bag.messages()]
    # What was recorded, and when it was: the content is the true time.
    assert [message.t_ns for message in messages] == pytest.approx([each.content for each in messages])
    assert all(message.stamp_ns == message.t_ns for message in messages)
    assert bag.duration_ns == messages[-1].t_ns


@pytest.mark.parametrize(
    "stamp_ns",
    [
        lambda _: -FIRST_NS,  # a header that nobody filled in
        lambda t_ns: t_ns - FIRST_NS + 100 * SECOND_NS,  # time since the computer was switched on
        lambda t_ns: t_ns - 3600 * SECOND_NS if t_ns == 0 else t_ns,  # latched: an hour old
        lambda t_ns: -FIRST_NS if t_ns == 0 else t_ns,
        lambda t_ns: t_ns - 500_000_000,  # another clock
        lambda t_ns: None if t_ns == 0 else t_ns,
        lambda t_ns: round(1.1 * t_ns),  # played back slower
    ],
)
def test_stamps_of_a_sound_bag_set_no_clock_back(stamp_ns: Callable[[int], int | None]) -> None:
    bag = Recorded(section("odometry") + section("truth", stamp_ns))
    assert bag.set_back is None
    assert [message.t_ns for message in bag.messages("odometry")] == [*range(0, 10 * SECOND_NS, STEP_NS)]


def test_messages_that_had_waited_set_no_clock_back() -> None:
    """In the first 3 s the network is late by half a second; what had waited comes at once."""

    def late(t_ns: int) -> int:
        return min(t_ns + SECOND_NS // 2, 3 * SECOND_NS) if t_ns < 3 * SECOND_NS else t_ns

    assert Recorded(section("odometry", t_ns=late) + section("imu", t_ns=late)).set_back is None


def test_a_delay_that_ends_at_once_sets_no_clock_back() -> None:
    def late(t_ns: int) -> int:
        return t_ns + SECOND_NS // 2 if t_ns < 3 * SECOND_NS else t_ns

    bag = Recorded([each for each in section("odometry", t_ns=late) if not 2.5e9 <= each.content < 3e9])
    assert bag.set_back is None


def test_a_step_in_one_section_only_is_the_fault_of_that_sensor() -> None:
    bag = Recorded(section("odometry") + section("imu", t_ns=set_back(2 * SECOND_NS)))
    assert bag.set_back is None
