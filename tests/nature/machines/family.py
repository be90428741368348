"""A family of machines: base law, hidden effects, inputs and sensors, and the simulation of one run."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tests.nature.machines.case import Channel, Effect, InputSignal, Parameter, State, Term
from tests.nature.machines.integrator import TOLERANCE, simulate

Array = NDArray[np.float64]
Values = Mapping[str, float]
Signals = Mapping[str, Array]


@dataclass(frozen=True, kw_only=True)
class Plan:
    """What an experimenter does in one run: `start_<state>` and other conditions, and the inputs."""

    name: str
    conditions: Values
    inputs: Signals


@dataclass(frozen=True, kw_only=True)
class Disturbance:
    """Smooth random force of a broad case.

    Attributes:
        equation: State of the base law whose equation gets it.
        unit: Of the force, which stands on the right-hand side as the base law is written.
        largest_rms: Largest sensible size.
        correlation_s: Of the Ornstein-Uhlenbeck series.
    """

    equation: str
    unit: str
    largest_rms: float
    correlation_s: float


@dataclass(frozen=True, kw_only=True)
class Family:
    """See `case.py` for the described parts.

    Attributes:
        extra_states: States of the truth that the base law does not have, with their scale.
        constants: Names of the constants in the order in which the compiled functions read them.
        slope: Compiled, see `integrator.SLOPE`.
        guard: Compiled, see `integrator.GUARD`.
        switch: Compiled, see `integrator.SWITCH`.
        begin: (starts of the base law's states, constants, actuated inputs) to the truth's first state.
        actuate: (commanded inputs, constants) to inputs behind the actuator, and the delay of each in s.
        observe: (states by name, constants) to channels without noise.
        plan: (generator, samples, index of the run) to a run's plan.
    """

    name: str
    dt_s: float
    parameters: tuple[Parameter, ...]
    states: tuple[State, ...]
    extra_states: tuple[tuple[str, float], ...]
    channels: tuple[Channel, ...]
    inputs: tuple[InputSignal, ...]
    catalogue: tuple[Effect, ...]
    outside: tuple[Term, ...]
    disturbance: Disturbance
    constants: tuple[str, ...]
    slope: Any
    guard: Any
    switch: Any
    begin: Callable[[Values, Values, Signals], tuple[float, ...]]
    actuate: Callable[[Signals, Values], tuple[dict[str, Array], tuple[float, ...]]]
    observe: Callable[[Signals, Values], dict[str, Array]]
    plan: Callable[[np.random.Generator, int, int], Plan]

    def nothing_hidden(self) -> dict[str, float]:
        """Return every constant of a hidden effect at its value without the effect."""
        nothing: dict[str, float] = {}
        for effect in self.catalogue:
            nothing |= dict.fromkeys(effect.drawn, 0.0)
            nothing |= {name: without for name, (without, _) in effect.size.items()}
        for term in self.outside:
            nothing |= dict.fromkeys(term.drawn, 0.0) | {term.coefficient: 0.0}
        return nothing

    def run(
        self,
        plan: Plan,
        constants: Values,
        start: Values,
        disturbance: Array,
        tolerance: float = TOLERANCE,
    ) -> dict[str, Array]:
        """Return states, mode and channels of one run without noise."""
        actuated, delays_s = self.actuate(plan.inputs, constants)
        names = [state.name for state in self.states] + [name for name, _ in self.extra_states]
        scale = [state.scale for state in self.states] + [scale for _, scale in self.extra_states]
        seen = simulate(
            self.slope,
            self.guard,
            self.switch,
            np.array(self.begin(start, constants, actuated)),
            np.ascontiguousarray([actuated[signal.name] for signal in self.inputs]),
            disturbance,
            np.array(delays_s),
            np.array([constants[name] for name in self.constants]),
            self.dt_s,
            np.array(scale),
            tolerance,
        )
        truth = {name: seen[:, place].copy() for place, name in enumerate([*names, "mode"])}
        return truth | self.observe(truth, constants)
