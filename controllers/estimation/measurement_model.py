"""What a measurement model is."""

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Expected(NamedTuple):
    """What a sensor is expected to read; k numbers, n states.

    Attributes:
        value: Shape (k,).
        row: Derivatives of `value` over the states, shape (k, n).
        variance: Of the errors of the reading, which are independent, shape (k,).
    """

    value: Array
    row: Array
    variance: Array


class MeasurementModel(Protocol):
    """A measurement of k numbers that are accepted or rejected together.

    Attributes:
        names: Of the numbers, for the report.
        angles: Which of them are angles: their residuals are wrapped.
    """

    @property
    def names(self) -> tuple[str, ...]:
        """Of the numbers."""
        ...

    @property
    def angles(self) -> tuple[int, ...]:
        """Indices of those that are angles."""
        ...

    def predict(self, state: Array) -> Expected:
        """Return what is expected at a state, shape (n,)."""
        ...
