"""Equations recorded as a list of operations, so that they can be computed without Python.

A right-hand side made of numpy functions is called once with `Traced` numbers, which write down what is done
with them. What cannot be written down (a choice by `if`, a random number, a sum over runs) raises `TypeError`
or `AttributeError` in the equations, and they stay with numpy.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum, auto
from typing import Any

import numpy as np


class Op(IntEnum):
    """An operation on up to three numbers, called as in numpy; truth is 1 and 0."""

    ADD = 0
    SUBTRACT = auto()
    MULTIPLY = auto()
    DIVIDE = auto()
    NEGATIVE = auto()
    ABSOLUTE = auto()
    MINIMUM = auto()
    MAXIMUM = auto()
    WHERE = auto()
    LESS = auto()
    LESS_EQUAL = auto()
    EQUAL = auto()
    NOT_EQUAL = auto()
    LOGICAL_AND = auto()
    LOGICAL_OR = auto()
    LOGICAL_NOT = auto()
    SIGN = auto()
    SQRT = auto()
    EXP = auto()
    EXPM1 = auto()
    LOG = auto()
    LOG1P = auto()
    SIN = auto()
    COS = auto()
    TAN = auto()
    TANH = auto()
    SINH = auto()
    COSH = auto()
    ARCSIN = auto()
    ARCCOS = auto()
    ARCTAN = auto()
    ARCTAN2 = auto()
    HYPOT = auto()
    POWER = auto()
    FLOOR = auto()
    CEIL = auto()
    COPYSIGN = auto()
    ISFINITE = auto()


COMPARISONS = (Op.LESS, Op.LESS_EQUAL, Op.EQUAL, Op.NOT_EQUAL)
LOGIC = (Op.LOGICAL_AND, Op.LOGICAL_OR, Op.LOGICAL_NOT)
TRUTHS = (*COMPARISONS, *LOGIC, Op.ISFINITE)
"""Operations whose result is true or false."""

UFUNCS: Mapping[np.ufunc, Op] = {
    np.fabs: Op.ABSOLUTE,
    **{getattr(np, op.name.lower()): op for op in Op if op is not Op.WHERE},
}
SWAPPED = {np.greater: Op.LESS, np.greater_equal: Op.LESS_EQUAL}
BITWISE = {np.bitwise_and: Op.LOGICAL_AND, np.bitwise_or: Op.LOGICAL_OR, np.invert: Op.LOGICAL_NOT}


def _power(value: Any, exponent: Any) -> tuple[Op, tuple[Any, ...]]:
    is_square = not isinstance(exponent, Traced) and np.ndim(exponent) == 0 and exponent == 2
    return (Op.MULTIPLY, (value, value)) if is_square else (Op.POWER, (value, exponent))


WRITTEN: Mapping[np.ufunc, Callable[..., tuple[Op, tuple[Any, ...]]]] = {
    np.positive: lambda value: (Op.ADD, (value, 0.0)),
    np.square: lambda value: (Op.MULTIPLY, (value, value)),
    np.power: _power,
    np.float_power: _power,
}
"""Functions of numpy that are written as another operation."""


class Source(IntEnum):
    """What a number of the equations depends on: how often it must be computed."""

    PARAMETER = 0
    INPUT = 1
    STATE = 2


@dataclass(frozen=True, slots=True)
class Node:
    """A number of the recorded equations.

    Attributes:
        source: What it depends on.
        op: How it is computed; None for a given one.
        arguments: Other numbers.
        constant: Its value, where it is one.
    """

    source: Source
    op: Op | None = None
    arguments: tuple[int, ...] = ()
    constant: float | None = None


class Graph:
    """Recorded numbers, in the order in which they can be computed."""

    def __init__(self) -> None:
        self.nodes: list[Node] = []
        self._constants: dict[float, int] = {}
        self._known: dict[tuple[Op, tuple[int, ...]], int] = {}

    def given(self, source: Source) -> "Traced":
        """Return a new given number."""
        self.nodes.append(Node(source))
        return Traced(self, len(self.nodes) - 1, is_truth=False)

    def node(self, value: object) -> int:
        """Return the place of a number.

        Raises:
            TypeError: It is no single number.
        """
        if isinstance(value, Traced):
            if value.graph is not self:
                raise TypeError("a number of other equations")
            return value.place
        array = np.asarray(value)
        if array.size != 1 or array.dtype.kind not in "bif":
            raise TypeError("an array or an object among the recorded numbers")
        number = float(array.reshape(()))
        # Zero with a minus is equal to zero, and not a number is not equal to itself.
        key = number if number == number and (number or np.signbit(number) == 0) else None
        if key is not None and key in self._constants:
            return self._constants[key]
        self.nodes.append(Node(Source.PARAMETER, constant=number))
        if key is not None:
            self._constants[key] = len(self.nodes) - 1
        return len(self.nodes) - 1

    def compute(self, op: Op, *values: object) -> "Traced":
        """Return the result of an operation."""
        places = tuple(self.node(value) for value in values)
        key = (op, places)
        if key not in self._known:
            source = max(self.nodes[place].source for place in places)
            self.nodes.append(Node(source, op, places))
            self._known[key] = len(self.nodes) - 1
        is_truth = op in TRUTHS or (op is Op.WHERE and all(_is_truth(value) for value in values[1:]))
        return Traced(self, self._known[key], is_truth=is_truth)


class Traced(np.lib.mixins.NDArrayOperatorsMixin):
    """A number that writes down what is done with it."""

    __slots__ = ("graph", "is_truth", "place")

    def __init__(self, graph: Graph, place: int, *, is_truth: bool) -> None:
        self.graph = graph
        self.place = place
        self.is_truth = is_truth

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: Any, **options: Any) -> Any:
        """Write down a function of numpy."""
        if method != "__call__" or options:
            return NotImplemented
        truths = [_is_truth(one) for one in inputs]
        if ufunc in BITWISE:
            return self.graph.compute(BITWISE[ufunc], *inputs) if all(truths) else NotImplemented
        if ufunc in SWAPPED:
            return self.graph.compute(SWAPPED[ufunc], *reversed(inputs))
        if ufunc in WRITTEN:
            op, numbers = WRITTEN[ufunc](*inputs)
            return self._unless_truth(op, *numbers)
        simple = UFUNCS.get(ufunc)
        if simple in LOGIC:
            return self.graph.compute(simple, *(_truth(self.graph, one) for one in inputs))
        # Numpy computes with truths alone in other ways than with numbers.
        if simple is None or (simple not in TRUTHS and all(truths)):
            return NotImplemented
        return self.graph.compute(simple, *inputs)

    def _unless_truth(self, op: Op, *values: Any) -> Any:
        return NotImplemented if any(_is_truth(one) for one in values) else self.graph.compute(op, *values)

    def __array_function__(
        self, function: Callable[..., Any], _: Any, arguments: tuple[Any, ...], options: Mapping[str, Any]
    ) -> Any:
        """Write down one of the functions of numpy that choose, limit or arrange."""
        handler = FUNCTIONS.get(function)
        if handler is None:
            return NotImplemented
        return handler(self.graph, *arguments, **options)

    def __array__(self, *_: object, **__: object) -> Any:
        """Refuse to be an array.

        Raises:
            TypeError: Always.
        """
        raise TypeError("a recorded number is no array")

    def __bool__(self) -> bool:
        """Refuse to decide.

        Raises:
            TypeError: Always.
        """
        raise TypeError("a recorded number is neither true nor false")

    def __float__(self) -> float:
        """Refuse to be a number.

        Raises:
            TypeError: Always.
        """
        raise TypeError("a recorded number has no value")

    def clip(self, low: Any, high: Any) -> Any:
        """Write down limits."""
        return _clip(self.graph, self, low, high)


class TracedStack:
    """Several recorded numbers: a stack that can only be taken apart."""

    __array_ufunc__ = None

    def __init__(self, parts: Sequence[Any]) -> None:
        self._parts = parts

    def __iter__(self) -> Iterator[Any]:
        return iter(self._parts)

    def __len__(self) -> int:
        return len(self._parts)

    def __getitem__(self, place: int | slice) -> Any:
        return TracedStack(self._parts[place]) if isinstance(place, slice) else self._parts[place]


def _is_truth(value: object) -> bool:
    return value.is_truth if isinstance(value, Traced) else np.asarray(value).dtype.kind == "b"


def _truth(graph: Graph, value: Any) -> Any:
    return value if _is_truth(value) else graph.compute(Op.NOT_EQUAL, value, 0.0)


def _where(graph: Graph, condition: Any, *choices: Any) -> Traced:
    if len(choices) != 2:
        raise TypeError("where without choices")
    return graph.compute(Op.WHERE, _truth(graph, condition), *choices)


def _clip(graph: Graph, value: Any, low: Any = None, high: Any = None) -> Traced:
    if _is_truth(value):
        raise TypeError("limits of a truth")
    limited = value if low is None else graph.compute(Op.MAXIMUM, value, low)
    limited = limited if high is None else graph.compute(Op.MINIMUM, limited, high)
    return graph.compute(Op.ADD, limited, 0.0) if not isinstance(limited, Traced) else limited


def _constant_like(value: float) -> Callable[..., float]:
    return lambda _, __: value


def _full_like(_: Graph, __: Any, value: Any) -> Any:
    return value


def _broadcast_arrays(_: Graph, *values: Any) -> tuple[Any, ...]:
    return values


def _stack(_: Graph, values: Sequence[Any]) -> TracedStack:
    return TracedStack(tuple(values))


FUNCTIONS: Mapping[Callable[..., Any], Callable[..., Any]] = {
    np.where: _where,
    np.clip: _clip,
    np.zeros_like: _constant_like(0.0),
    np.ones_like: _constant_like(1.0),
    np.full_like: _full_like,
    np.broadcast_arrays: _broadcast_arrays,
    np.stack: _stack,
}
