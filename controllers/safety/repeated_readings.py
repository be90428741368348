"""Whether a noisy source sends a sequence of readings that it has sent before."""

import math
from collections import deque
from collections.abc import Hashable, Iterator
from typing import Generic, NamedTuple, TypeVar

HISTORY = 1 << 14
"""Readings with which the newest are compared: more than a minute of a fast gyro."""

KEY = 16
"""So many equal readings begin a repetition; fewer are found too often in coarse readings."""

MEMORY = 256
"""Of the share of equal successive numbers, in readings: a rover at rest has another one than in motion."""

LEAST_DISTINCT = 8
"""It has so many different readings: a constant between two steps of a converter is a short tone."""

LEAST_TURNING = 0.2
"""Share of the changes after which noise turns back: two in three, fewer behind a low-pass; motion, less."""

LONGEST_OPERATION = 1e10
"""Readings in which one false report is accepted: a year of ten sources with 30 readings a second each."""

CHANCES = math.log(HISTORY * LONGEST_OPERATION)
"""Logarithm of the number of pairs of a present sequence and a past one."""


ContextT = TypeVar("ContextT")


class Reading(NamedTuple, Generic[ContextT]):
    """A reading as it is compared.

    Attributes:
        value: Everything that was read.
        number: Shows its noise: a number in it, or its increment.
        context: Of it, for the caller.
        path: Sum of the magnitudes of the numbers up to this one.
        is_change: Whether it differs from the number before.
        is_turning: Whether the numbers rose up to this one and fall from it, or the reverse.
    """

    value: Hashable
    number: float
    context: ContextT
    path: float
    is_change: bool
    is_turning: bool


class RepeatedReadings(Generic[ContextT]):
    """Follows how long the newest readings of a source equal earlier ones.

    Assumed: all readings are of one quantity, and the noise of successive ones is independent. A number then
    equals an earlier one at most as often as the one before it, with probability p, and n of them with p^n. A
    motion without noise may repeat itself as a whole; it has few turning points, noise two in three readings:
    these are the n.
    """

    def __init__(self) -> None:
        self._ring: list[Reading[ContextT] | None] = [None] * HISTORY
        self._count = 0
        self._newest: deque[Hashable] = deque(maxlen=KEY)
        self._last_of: dict[int, int] = {}
        self._lag = self._length = self._changes = self._turning = 0
        self._equal = 0.5
        self._rises: bool | None = None
        self._largest = 0.0
        self._has_distinct = False

    def add(self, value: Hashable, number: float, context: ContextT) -> None:
        """Take a reading, see `Reading`."""
        now, before = self._count, self._at(self._count - 1)
        change = 0.0 if before is None else number - before.number
        is_turning = change != 0.0 and self._rises is (change < 0.0)
        if change:
            self._rises = change > 0.0
        path = abs(number) + (0.0 if before is None else before.path)
        self._ring[now % HISTORY] = Reading(value, number, context, path, change != 0.0, is_turning)
        self._count += 1
        self._newest.append(value)
        key = hash(tuple(self._newest)) if len(self._newest) == KEY else None
        past = self._at(now - self._lag) if self._lag else None
        if past is not None and past.value == value:
            self._length += 1
            self._changes += change != 0.0
            self._turning += is_turning
            self._largest = max(self._largest, abs(number))
        else:
            self._begin(now, key)
        if before is not None and self._lag <= 1:
            self._equal += ((change == 0.0) - self._equal) / min(now + 1, MEMORY)
        if key is not None:
            self._remember(now, key)

    @property
    def is_repetition(self) -> bool:
        """Whether chance does not explain that the newest readings equal earlier ones."""
        by_chance = -math.log(max(self._equal, 1.0 / MEMORY))
        if self._turning * by_chance < CHANCES or self._turning < LEAST_TURNING * self._changes:
            return False
        self._has_distinct = self._has_distinct or self._is_distinct()
        return self._has_distinct

    def _is_distinct(self) -> bool:
        """Return whether the repetition has enough different readings, as far as the longest useful look."""
        distinct: set[Hashable] = set()
        for reading in self._last(min(self._length, MEMORY)):
            distinct.add(reading.value)
            if len(distinct) >= LEAST_DISTINCT:
                return True
        return False

    @property
    def first(self) -> ContextT | None:
        """The context of the first reading that equals an earlier one; None where there is none."""
        return self._context(self._count - self._length) if self._length else None

    @property
    def copied(self) -> ContextT | None:
        """The context of the reading that this one equals, or of the oldest that is kept."""
        return self._context(self._count - self._length - self._lag) if self._length else None

    def _context(self, index: int) -> ContextT | None:
        reading = self._at(max(index, self._count - HISTORY))
        return None if reading is None else reading.context

    @property
    def length(self) -> int:
        """How many of the newest readings equal earlier ones."""
        return self._length

    @property
    def lag(self) -> int:
        """How many readings before them those were sent; 0 where none equal."""
        return self._lag

    @property
    def has_jump(self) -> bool:
        """Whether a number of the repetition is larger than a quarter of the sum of all in its period.

        For increments of a position that has gone back at once, and not on the way on which it came: the sum
        is that of both ways.
        """
        newest, before = self._at(self._count - 1), self._at(self._count - 1 - self._lag)
        if newest is None or before is None or not self._lag:
            return False
        return 4.0 * self._largest > newest.path - before.path

    def _at(self, index: int) -> Reading[ContextT] | None:
        is_kept = max(0, self._count - HISTORY) <= index < self._count
        return self._ring[index % HISTORY] if is_kept else None

    def _last(self, count: int) -> Iterator[Reading[ContextT]]:
        indices = range(self._count - min(count, HISTORY), self._count)
        return (reading for index in indices if (reading := self._at(index)) is not None)

    def _begin(self, now: int, key: int | None) -> None:
        """Look for earlier readings that the newest equal."""
        self._has_distinct = False
        past = None if key is None else self._last_of.get(key)
        if past is None or now - past > HISTORY - KEY or not self._are_equal(now, past):
            self._lag = self._length = self._changes = self._turning = 0
            return
        self._lag, self._length = now - past, KEY
        self._changes = sum(reading.is_change for reading in self._last(KEY))
        self._turning = sum(reading.is_turning for reading in self._last(KEY))
        self._largest = max(abs(reading.number) for reading in self._last(KEY))

    def _are_equal(self, now: int, past: int) -> bool:
        """Return whether the readings up to two indices are equal: their hash is."""
        pairs = ((self._at(now - back), self._at(past - back)) for back in range(KEY))
        return all(a is not None and b is not None and a.value == b.value for a, b in pairs)

    def _remember(self, now: int, key: int) -> None:
        self._last_of[key] = now
        if len(self._last_of) > 2 * HISTORY:
            self._last_of = {key: at for key, at in self._last_of.items() if now - at < HISTORY}
