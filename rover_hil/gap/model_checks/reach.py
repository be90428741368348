"""Ranges of the signals of a machine, and the thresholds of effects in them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np

from rover_hil.gap.parameters import MACHINES
from sim_backends.models.interface import Array, Run
from sim_backends.state_model.equations import Signal
from sim_backends.state_model.model import StateModel
from sim_backends.state_model.port_effect import PortEffect

WIDTHS = ("half_width", "half_play")
"""Strengths that are thresholds of their signal."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Reach:
    """The signal that a threshold is compared with.

    Attributes:
        signal: Its name.
        unit: Its unit.
        low: Its least value in the runs, at nominal parameters.
        high: Its greatest value.
        shape: The shape parameter that is the threshold; empty where the strength is.
        is_negative: The threshold is on the negative side.
    """

    signal: str
    unit: str
    low: float
    high: float
    shape: str
    is_negative: bool

    def sentence(self) -> str:
        """Return the range in words."""
        return f"{self.signal} is {self.low:.3g} to {self.high:.3g} {self.unit} in these runs"

    def inside(self) -> list[float]:
        """Return thresholds inside the range."""
        end = self.low if self.is_negative else self.high
        if not self.is_negative and -self.low > end:
            end = -self.low
        begin = 0.0 if self.low <= 0.0 <= self.high else min((self.low, self.high), key=abs)
        return sorted({begin + share * (end - begin) for share in MACHINES.linter.threshold_shares})

    def is_beyond(self, width: float) -> bool:
        """Return True where a width around zero covers the whole signal."""
        return width >= max(abs(self.low), abs(self.high))


def signal_ranges(model: StateModel, runs: Sequence[Run]) -> dict[str, tuple[float, float]]:
    """Return the range of each state, input, channel and port at nominal parameters."""
    ranges: dict[str, tuple[float, float]] = {}

    def extend(name: str, values: Array) -> None:
        good = values[np.isfinite(values)]
        if good.size:
            low, high = ranges.get(name, (np.inf, -np.inf))
            ranges[name] = (min(low, float(good.min())), max(high, float(good.max())))

    def derivative(
        x: SimpleNamespace, u: SimpleNamespace, p: SimpleNamespace, port: Signal
    ) -> Mapping[str, Array]:
        def recorded(name: str, value: Array) -> Array:
            extend(name, np.asarray(value))
            return port(name, value)

        return model.derivative(x, u, p, recorded)

    recording = replace(model, derivative=derivative)
    for table in recording.trajectories(runs, {}, {}):
        for name, values in table.items():
            extend(name, values)
    for table in model.predict(runs, {}, {}):
        for name, values in table.items():
            extend(name, values)
    return ranges


def threshold_reaches(model: StateModel, ranges: Mapping[str, tuple[float, float]]) -> dict[str, Reach]:
    """Return, by card, the signal that its threshold is compared with, for cards with one."""
    found = {}
    for effect, card in zip(model.port_effects, model.effects, strict=True):
        shape = next((one for one in card.parameters if one.name in card.shape_grid), None)
        strength = card.parameters[0]
        if shape is None and strength.name not in WIDTHS:
            continue
        one = strength if shape is None else shape
        signal = _signal(model, effect, one.unit)
        if signal not in ranges:
            continue
        low, high = ranges[signal]
        found[card.name] = Reach(
            signal=signal,
            unit=one.unit,
            low=low,
            high=high,
            shape="" if shape is None else shape.name,
            is_negative=shape is not None and max(card.shape_grid[shape.name]) < 0.0,
        )
    return found


def _signal(model: StateModel, effect: PortEffect, unit: str) -> str:
    """Return the name of the signal in this unit that an effect compares with a threshold; empty for none."""
    units = model.signal_units
    return next((name for name in (*effect.states, effect.port) if units.get(name) == unit), "")
