"""Heading of a compass."""

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from controllers.estimation.filter.guarded_filter import Innovation
from controllers.estimation.filter.measurement_model import Array, Expected, Measured
from controllers.estimation.filter.reader import Situation
from controllers.estimation.filter.state_layout import HARMONICS, YAW
from drivers.samples import HeadingReference, HeadingSample, Sample


@dataclass(frozen=True, slots=True, kw_only=True)
class HeadingModel:
    """Heading of a device that lags behind the rover.

        h = yaw - t + o + d(yaw) - d(0)
        d(yaw) = a sin yaw + b cos yaw + c sin 2 yaw + e cos 2 yaw

    with the turn t of the rover since it was measured, the offset o, and the deviation d by the iron of the
    rover (Archibald Smith's semicircular and quadrantal terms; Denne, Magnetic Compass Deviation and
    Correction, 1979). The offset holds at the yaw of the start.

    Attributes:
        source: Device and reference.
        offset_index: State of the offset.
        deviation_index: First of the states of a, b, c, e; None without.
        turned_since_rad: t.
        sd_rad: Standard deviation of a reading.
    """

    source: Measured
    offset_index: int
    deviation_index: int | None
    turned_since_rad: float
    sd_rad: float

    @property
    def names(self) -> tuple[Measured, ...]:
        """Of the heading."""
        return (self.source,)

    @property
    def angles(self) -> tuple[int, ...]:
        """The heading."""
        return (0,)

    def predict(self, state: Array) -> Expected:
        """Return the expected heading."""
        row = np.zeros((1, len(state)))
        row[0, YAW] = row[0, self.offset_index] = 1.0
        yaw_rad = state.item(YAW)
        value_rad = yaw_rad - self.turned_since_rad + state.item(self.offset_index)
        if self.deviation_index is not None:
            block = slice(self.deviation_index, self.deviation_index + HARMONICS)
            sine, cosine = math.sin(yaw_rad), math.cos(yaw_rad)
            sine_2, cosine_2 = math.sin(2.0 * yaw_rad), math.cos(2.0 * yaw_rad)
            waves = np.array([sine, cosine - 1.0, sine_2, cosine_2 - 1.0])
            slopes = np.array([cosine, -sine, 2.0 * cosine_2, -2.0 * sine_2])
            value_rad += float((waves * state[block]).sum())
            row[0, YAW] += float((slopes * state[block]).sum())
            row[0, block] = waves
        return Expected(np.array([value_rad]), row, np.array([self.sd_rad**2]))


MOST_CHANCE = 0.5
"""A gate over the whole circle proves nothing; an accepted reading then counts as the toss of a coin."""


class HeadingReader:
    """Reads headings: one per device and reference.

    An arbitrary angle falls into the gate by chance, more often the more uncertain the yaw. After a rejected
    heading the following ones correct only when so many in a row were accepted that chance explains them no
    better than the gate explains a rejection: until then the device may measure nothing.
    """

    kind: ClassVar[type[Sample]] = HeadingSample

    def __init__(self) -> None:
        self._chance: dict[Measured, float] = {}

    def source(self, sample: HeadingSample) -> tuple[str, HeadingReference]:
        """Return device and reference."""
        return (sample.device, sample.reference)

    def measured_ns(self, sample: HeadingSample, t_ns: int) -> int:
        """Return the arrival; what the device lags behind is a setting."""
        return t_ns

    def correct(self, sample: HeadingSample, now: Situation) -> tuple[Innovation, ...]:
        """Correct by a heading; without effect for a device whose offset is no state."""
        source, layout = (sample.device, sample.reference), now.pose_filter.layout
        offset_index = layout.offsets.get(source)
        if offset_index is None:
            return ()
        model = HeadingModel(
            source=Measured(sample.device, sample.reference),
            offset_index=offset_index,
            deviation_index=layout.deviations.get(source),
            turned_since_rad=now.way_back.turned_rad + now.yaw_rate_rad_s * now.settings.heading_lag_s,
            sd_rad=now.settings.heading_noise_rad,
        )
        if model.source in self._chance:
            trial = now.pose_filter.kalman.compare(model, sample.heading_rad)
            if self._is_chance(trial, now.settings.gate_probability):
                return (trial,)
        (innovation,) = now.pose_filter.correct(model, (sample.heading_rad,))
        if not innovation.accepted:
            self._chance[model.source] = 1.0
        return (innovation,)

    def _is_chance(self, trial: Innovation, gate_probability: float) -> bool:
        """Take what would become of a heading after a rejected one; return whether chance explains it."""
        name = trial.measured
        if not trial.accepted:
            self._chance[name] = 1.0
        elif trial.variance and trial.gate:
            half_rad = math.sqrt(trial.gate * trial.variance)
            self._chance[name] *= min(MOST_CHANCE, half_rad / math.pi)
            if self._chance[name] <= 1.0 - gate_probability:
                del self._chance[name]
        return name in self._chance

    def miss(self, sample: HeadingSample) -> None:
        """Nothing: the next heading is as good."""
