"""What a measurement model is.

The turn by a moving gyro and the wheels' constraint are no measurement models but inputs of the transition,
see `transition.MotionTransition`: the state holds no velocity and no yaw rate that a reading could be
compared with.
"""

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Measured(NamedTuple):
    """What is measured.

    Attributes:
        device: By which device.
        quantity: Which of its quantities; empty for its only one.
    """

    device: str
    quantity: str = ""

    def __str__(self) -> str:
        """Return its name, as in logs and reports."""
        return f"{self.device} {self.quantity}" if self.quantity else self.device


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
        names: What the numbers are, for the report.
        angles: Which of them are angles: their residuals are wrapped.
    """

    @property
    def names(self) -> tuple[Measured, ...]:
        """What the numbers are."""
        ...

    @property
    def angles(self) -> tuple[int, ...]:
        """Indices of those that are angles."""
        ...

    def predict(self, state: Array) -> Expected:
        """Return what is expected at a state, shape (n,)."""
        ...
