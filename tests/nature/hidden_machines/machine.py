"""What a machine of this folder consists of: its nature, and the model that its user writes down."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from tests.nature.hidden_machines.effect import Effect

Array = NDArray[np.float64]
Values = dict[str, Array]
Push = Callable[[str, Array], Array]
"""Signal at a place after what acts there in secret."""


@dataclass(frozen=True)
class Number:
    """A base parameter as its user knows it."""

    name: str
    unit: str
    nominal: float
    share_sd: float
    """Prior standard deviation over the nominal value."""


@dataclass(frozen=True)
class Sensor:
    """A channel: noise of one reading and resolution, in its unit."""

    name: str
    unit: str
    sigma: float
    quantum: float = 0.0

    @property
    def noise(self) -> float:
        """Return the standard deviation of one reading."""
        return float(np.hypot(self.sigma, self.quantum / np.sqrt(12.0)))


@dataclass(frozen=True)
class Start:
    """First value of a state: normal about zero with `spread`; measured by `channel` if it has one."""

    state: str
    spread: float
    channel: str = ""


@dataclass(frozen=True)
class Input:
    """A command, held from sample to sample, between `low` and `high`."""

    name: str
    unit: str
    low: float
    high: float


@dataclass(frozen=True)
class Condition:
    """A number that is set once per run, between `low` and `high`."""

    name: str
    unit: str
    low: float
    high: float


@dataclass(frozen=True)
class Machine:
    """A machine: nature as functions, the user's equations as text."""

    name: str
    step_s: float
    samples: int
    substeps: int
    """Steps of the integration per sample."""
    states: Mapping[str, str]
    inputs: tuple[Input, ...]
    numbers: tuple[Number, ...]
    sensors: tuple[Sensor, ...]
    starts: tuple[Start, ...]
    ports: Mapping[str, tuple[str, float]]
    """Unit and usual size of an unknown force."""
    rates: Callable[[Values, Values, Values, Push], Values]
    outputs: Callable[[Values, Values, Values], Values]
    derivative: str
    """Body of the user's `derivative`."""
    output: str
    """What the user's `output` returns."""
    catalogue: tuple[Effect, ...]
    outside: tuple[Effect, ...]
    pairs: tuple[tuple[str, str], ...] = ()
    """Effects at one input whose order matters."""
    conditions: tuple[Condition, ...] = field(default=())

    def effect(self, name: str) -> Effect:
        """Return the effect of a name."""
        return next(effect for effect in (*self.catalogue, *self.outside) if effect.name == name)
