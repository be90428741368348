"""Recorded equations in the form that the compiled integration reads."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim_backends.models.interface import Array
from sim_backends.state_model.tracing import Graph, Node, Source, Traced

Rows = NDArray[np.uint32]


@dataclass(frozen=True, slots=True)
class Tape:
    """Operations on registers: constants first, then parameters, inputs, states, and results.

    Attributes:
        constants: Values of the first registers.
        once: Operations before the first step; each row is an operation, where its result goes, and up to
            three arguments.
        step: Before each integration step.
        stage: For each evaluation of the rates.
        rates: Register of the rate of each state.
        registers: Their number.
    """

    constants: Array
    once: Rows
    step: Rows
    stage: Rows
    rates: Rows
    registers: int


def make_tape(graph: Graph, given: Sequence[Traced], rates: Sequence[object]) -> Tape:
    """Return the operations that recorded equations need."""
    results = [graph.node(rate) for rate in rates]
    needed = _needed(graph.nodes, results)
    constants = [place for place in needed if graph.nodes[place].constant is not None]
    registers = {place: index for index, place in enumerate(constants)}
    registers |= {one.place: len(constants) + index for index, one in enumerate(given)}
    computed = [place for place in needed if graph.nodes[place].op is not None]
    by_source = {
        source: [place for place in computed if graph.nodes[place].source is source] for source in Source
    }
    count = len(registers)
    for source in (Source.PARAMETER, Source.INPUT):
        for place in by_source[source]:
            registers[place] = count
            count += 1
    count = _share_registers(graph.nodes, by_source[Source.STATE], results, registers, count)
    tapes = [_rows(graph.nodes, by_source[source], registers) for source in Source]
    return Tape(
        constants=np.array([graph.nodes[place].constant for place in constants], dtype=np.float64),
        once=tapes[Source.PARAMETER],
        step=tapes[Source.INPUT],
        stage=tapes[Source.STATE],
        rates=np.array([registers[place] for place in results], dtype=np.uint32),
        registers=count,
    )


def _needed(nodes: Sequence[Node], results: Sequence[int]) -> list[int]:
    found: set[int] = set()
    waiting = list(results)
    while waiting:
        place = waiting.pop()
        if place not in found:
            found.add(place)
            waiting += nodes[place].arguments
    return sorted(found)


def _share_registers(
    nodes: Sequence[Node],
    places: Sequence[int],
    results: Sequence[int],
    registers: dict[int, int],
    count: int,
) -> int:
    """Give each result of a stage a register that is no longer read; returns the number of registers.

    Few registers stay in the fastest memory.
    """
    last: dict[int, int] = {}
    for place in places:
        last.update(dict.fromkeys(nodes[place].arguments, place))
    last.update(dict.fromkeys(results, len(nodes)))
    own, unused = set(places), list[int]()
    for place in places:
        if unused:
            registers[place] = unused.pop()
        else:
            registers[place] = count
            count += 1
        unused += [
            registers[one]
            for one in dict.fromkeys(nodes[place].arguments)
            if one in own and last[one] == place
        ]
    return count


def _rows(nodes: Sequence[Node], places: Sequence[int], registers: Mapping[int, int]) -> Rows:
    rows = np.zeros((len(places), 5), dtype=np.uint32)
    for row, place in zip(rows, places, strict=True):
        arguments = [registers[one] for one in nodes[place].arguments]
        operation = nodes[place].op
        row[: 2 + len(arguments)] = [0 if operation is None else operation, registers[place], *arguments]
    return rows
