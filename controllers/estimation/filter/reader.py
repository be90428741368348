"""How a sample becomes a measurement."""

from collections.abc import Hashable
from dataclasses import dataclass
from typing import Protocol

from controllers.estimation.filter.measurement_model import MeasurementModel
from controllers.estimation.filter.state_layout import StateLayout
from controllers.estimation.settings import FilterSettings
from drivers.samples import Sample

Measurement = tuple[MeasurementModel, tuple[float, ...]]
"""A model, and what was measured."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Situation:
    """What a reader may need to know.

    Attributes:
        settings: Noise.
        layout: Where each part of the state is.
        yaw_rate_rad_s: Of the rover.
        age_s: By how much the state is later than the sample.
    """

    settings: FilterSettings
    layout: StateLayout
    yaw_rate_rad_s: float
    age_s: float


class Reader(Protocol):
    """Turns samples of one kind into measurements."""

    def source(self, sample: Sample) -> Hashable | None:
        """Return what the sample is one of: newer ones replace older ones. None for another kind."""
        ...

    def read(self, sample: Sample, now: Situation) -> Measurement | None:
        """Return the measurement in a sample; None where there is no state for it."""
        ...
