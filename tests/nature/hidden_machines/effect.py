"""A hidden effect: what nature does, and the line by which its user would list it."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Where = Literal["port", "input", "channel", "parameter"]


@dataclass(frozen=True)
class Term:
    """A regression term that describes an effect outside the catalogue."""

    port: str
    sources: tuple[str, ...]
    forms: tuple[str, ...]
    """`constant`, `linear`, ..., `threshold` or `product`."""


@dataclass(frozen=True)
class Effect:
    """An effect of one strength; zero strength changes nothing."""

    name: str
    where: Where
    place: str
    act: Callable[..., Array]
    """Port: `(signal, values of states and inputs, strength)`; series: `(signal, dt, strength)`."""
    typical: float
    most: float = np.inf
    """Greatest strength that makes sense."""
    line: str = ""
    """The user's line with `{size}`; empty outside the catalogue."""
    parameter: str = ""
    """Name of the size in the answer."""
    reported: Callable[[float], float] = float
    """Size as the documents define it, from the strength."""
    terms: tuple[Term, ...] = ()
    """Terms that are right as drafts; outside the catalogue only."""
    is_signed: bool = False
    """Whether either sign occurs in nature."""
