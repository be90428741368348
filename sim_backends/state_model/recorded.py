"""A right-hand side without Python: recorded once, integrated for many lanes on all processors."""

import os
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from sim_backends.models.interface import Array
from sim_backends.state_model.tape import Tape
from sim_backends.state_model.tape_kernel import compute, integrate

LEAST_WORK = 3_000_000
"""Operations on a lane below which more threads cost more than they gain."""
LEAST_LANES = 8
"""Lanes of a thread: fewer cannot use the vector units."""
CLOSE = 1e-9
"""Greatest relative difference between recorded and called equations."""


class RecordedLanes:
    """Recorded equations and the numbers of all lanes; a lane is a run at a point.

    Args:
        tape: The equations.
        shape: Points and runs.
        parameters: In the order of the tape: points x runs, or what is broadcast to it.
        series: Inputs and forces in the order of the tape: points x runs x steps, the same.
        steps: Number of integration steps.
    """

    def __init__(
        self,
        tape: Tape,
        shape: tuple[int, int],
        parameters: Iterable[Array],
        series: Iterable[Array],
        steps: int,
    ) -> None:
        self._tape = tape
        self._lanes = shape[0] * shape[1]
        rows = [np.broadcast_to(one, shape).reshape(-1) for one in parameters]
        self._parameters = np.array(rows, dtype=np.float64).reshape(len(rows), self._lanes)
        self._series, self._sources = _rows_of_lanes(list(series), shape, steps)

    def integrate(self, stored: Array, substeps: int, widths_s: Array) -> None:
        """Fill in the samples after the first, states x points x runs x samples.

        The integration steps of a sample have the width in `widths_s`, runs or one for all x samples.

        The result does not depend on the number of processors.
        """
        lanes = stored.reshape(stored.shape[0], self._lanes, stored.shape[3])
        work = self._lanes * stored.shape[3] * substeps * max(len(self._tape.stage), 1)
        threads = min(_processors(), self._lanes // LEAST_LANES) if work >= LEAST_WORK else 1
        widths = np.resize(np.arange(widths_s.shape[0]), self._lanes)
        ends = np.linspace(0, self._lanes, max(threads, 1) + 1).astype(int)

        def part(begin: int, end: int) -> None:
            tape = self._tape
            integrate(
                tape.constants, tape.once, tape.step, tape.stage, tape.rates, tape.registers,
                self._parameters, self._series, self._sources, lanes, substeps, widths_s, widths, begin, end,
            )  # fmt: skip

        if threads <= 1:
            part(0, self._lanes)
            return
        with ThreadPoolExecutor(threads) as pool:
            for done in [pool.submit(part, *pair) for pair in pairwise(ends.tolist())]:
                done.result()

    def rates(self, states: Array, step: int) -> Array:
        """Return the rates of states, states x points x runs, during an integration step."""
        tape = self._tape
        given = (
            np.repeat(tape.constants[:, None], self._lanes, axis=1),
            self._parameters,
            self._series[self._sources, step],
            states.reshape(states.shape[0], self._lanes),
        )
        values = np.empty((tape.registers, self._lanes))
        filled = np.concatenate([one for one in given if one.size])
        values[: filled.shape[0]] = filled
        for rows in (tape.once, tape.step, tape.stage):
            compute(values, rows, self._lanes)
        found: Array = values[tape.rates].reshape(states.shape)
        return found


def are_equal(recorded: Array, called: Array) -> bool:
    """Return True where recorded equations have the rates of the called ones, states x points x runs."""
    for one, other in zip(recorded, called, strict=True):
        both = np.isfinite(one) & np.isfinite(other)
        if np.any(np.isfinite(one) != np.isfinite(other)):
            return False
        largest = float(np.max(np.abs(other[both]), initial=0.0))
        if float(np.max(np.abs(one[both] - other[both]), initial=0.0)) > CLOSE * largest:
            return False
    return True


def _rows_of_lanes(series: list[Array], shape: tuple[int, int], steps: int) -> tuple[Array, NDArray[np.intp]]:
    """Return all different series, rows x steps, and the row of each in each lane."""
    rows: list[Array] = []
    sources = np.zeros((len(series), shape[0] * shape[1]), dtype=np.intp)
    count = 0
    for index, one in enumerate(series):
        places = np.arange(one.shape[0] * one.shape[1]).reshape(one.shape[:2]) + count
        sources[index] = np.broadcast_to(places, shape).reshape(-1)
        rows.append(one[..., :steps].reshape(-1, steps))
        count += places.size
    # One memory order: for another one the integration would be compiled again.
    return np.ascontiguousarray(np.concatenate([np.zeros((0, steps)), *rows])), sources


def _processors() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
