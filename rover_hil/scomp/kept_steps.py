"""Steps of a filter over a long drive: all but the newest are in a file."""

from collections.abc import Iterator, Sequence
from typing import BinaryIO

import numpy as np

from controllers.estimation.filter.guarded_filter import FilterStep
from rover_hil.scomp.smoother import Estimate, smooth

BLOCK = 4000
"""So many steps are written at once: some tens of megabytes."""


class KeptSteps:
    """The steps that a filter keeps, and their smoothed estimates.

    A filter of 25 states needs 15 kB for a step: a drive of two hours would not fit into the memory.

    Args:
        steps: The growing list of the filter; the older ones are moved out of it.
        file: Empty, open for reading and writing.
    """

    def __init__(self, steps: list[FilterStep], file: BinaryIO) -> None:
        self._steps, self._file = steps, file
        self._places: list[int] = []
        self._written = 0

    def __len__(self) -> int:
        return self._written + len(self._steps)

    @property
    def last(self) -> FilterStep:
        """The newest step."""
        return self._steps[-1]

    def save(self) -> None:
        """Write a block into the file when there are so many; the newest step may still change."""
        if len(self._steps) <= BLOCK:
            return
        block = self._steps[:BLOCK]
        self._places.append(self._file.tell())
        parts = [(step.transition, *step.predicted, *step.estimate) for step in block]
        for column in zip(*parts, strict=True):
            np.save(self._file, np.array(column))
        del self._steps[:BLOCK]
        self._written += BLOCK

    def estimates(self, angles: Sequence[int], *, online: bool) -> Iterator[tuple[int, list[Estimate]]]:
        """Yield the estimates by blocks, the newest block first, each with the number of its first step.

        Args:
            angles: Indices of the states that are angles in rad.
            online: As the filter had them, not smoothed.
        """
        following: tuple[FilterStep, Estimate] | None = None
        for number in reversed(range(len(self._places) + 1)):
            steps = self._block(number)
            if online:
                yield number * BLOCK, [step.estimate for step in steps]
                continue
            if following is None:
                smoothed = smooth(steps, angles)
            else:
                smoothed = smooth([*steps, following[0]], angles, following[1])[:-1]
            following = (steps[0], smoothed[0])
            yield number * BLOCK, smoothed

    def _block(self, number: int) -> list[FilterStep]:
        if number == len(self._places):
            return self._steps
        self._file.seek(self._places[number])
        columns = [np.load(self._file) for _ in range(5)]
        return [
            FilterStep(transition=transition, predicted=(before, spread), estimate=(after, left))
            for transition, before, spread, after, left in zip(*columns, strict=True)
        ]
