"""What every model of errors has: a transformation that makes them independent and of unit size."""

from typing import Protocol

from rover_hil.gap.data.problem import Indices
from sim_backends.models.interface import Array


class Noise(Protocol):
    """Whitens errors of observations."""

    @property
    def freedom(self) -> float:
        """Degrees of freedom behind the size of the errors."""
        ...

    @property
    def row_sd(self) -> Array:
        """Standard deviation of each row before whitening."""
        ...

    @property
    def site(self) -> Indices:
        """Group of each whitened row."""
        ...

    @property
    def channel(self) -> Indices:
        """Channel of each whitened row."""
        ...

    @property
    def block(self) -> Indices:
        """Stretch of data of each whitened row; errors of different stretches are independent."""
        ...

    def whiten(self, rows: Array) -> Array:
        """Return rows, or columns of rows, in units of independent standard errors."""
        ...
