"""What a case and a family of machines consist of."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

KINDS = ("none", "single", "pair", "outside", "broad")


@dataclass(frozen=True)
class Parameter:
    """A constant of the base law.

    Attributes:
        name: With its unit as suffix.
        nominal: What the data sheet says.
        spread: Standard deviation of the machine's true value as a share of `nominal`, cut off at twice that.
        scatter: Standard deviation from run to run as a share of the machine's value.
        meaning: One line for the reader.
    """

    name: str
    nominal: float
    spread: float
    scatter: float
    meaning: str


@dataclass(frozen=True, kw_only=True)
class State:
    """A state of the base law.

    Attributes:
        name: With its unit as suffix. A run's condition `start_<name>` is where the run was meant to start.
        spread: Standard deviation of the true start about that condition, in the state's unit.
        scale: Typical size, for the tolerance of the integrator.
    """

    name: str
    spread: float
    scale: float


@dataclass(frozen=True, kw_only=True)
class Channel:
    """A sensor: `sigma` of its white noise and `quantum` of its reading, in the unit of its name."""

    name: str
    sigma: float
    quantum: float


@dataclass(frozen=True, kw_only=True)
class InputSignal:
    """An input: it never leaves `low` to `high`, in the unit of its name."""

    name: str
    low: float
    high: float


@dataclass(frozen=True)
class Effect:
    """A hidden effect that a user may have thought of.

    Attributes:
        name: Of the effect.
        group: Two effects of one group never occur together.
        formula: What changes in the base law.
        size: Name of each parameter that grows with the effect, with its value without the effect and its
            largest sensible value.
        drawn: Name of each other parameter, with the range it is drawn from uniformly.
        signed: Whether the size may be negative as well.
    """

    name: str
    group: str
    formula: str
    size: Mapping[str, tuple[float, float]]
    drawn: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    signed: bool = False


@dataclass(frozen=True)
class Term:
    """A hidden term outside the catalogue: `equation` gets `coefficient` times a shape of the variables.

    Attributes:
        name: Of the term.
        equation: State whose equation gets the term; the equation is written as in the base law.
        variables: What the term depends on: states and inputs by name.
        shape: One of `square`, `signed_square`, `cube`, `fourth_power`, `square_root`, `sine`, `product`,
            `threshold`; `product` may carry powers, which `formula` gives.
        formula: The term as it is added to the right-hand side.
        coefficient: Name of its coefficient.
        largest: Largest sensible coefficient.
        drawn: Name of each other parameter, with the range it is drawn from uniformly.
        sign: Of the term for positive variables, +1 or -1.
    """

    name: str
    equation: str
    variables: tuple[str, ...]
    shape: str
    formula: str
    coefficient: str
    largest: float
    drawn: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    sign: int = -1


@dataclass(frozen=True, kw_only=True)
class Run:
    """One record.

    Attributes:
        name: Of the run; it begins with what excites it.
        conditions: What the experimenter set: `start_<state>` for each state of the base law, and others.
        inputs: Commanded inputs by name, held from each sample to the next.
        measured: Channels by name, with noise and quantisation.
        truth: Without noise: each channel, each state of the truth, and `disturbance` of a broad case.
        initial_state: True start of each state of the base law.
        parameters: True parameters of the base law in this run.
    """

    name: str
    conditions: Mapping[str, float]
    inputs: Mapping[str, Array]
    measured: Mapping[str, Array]
    truth: Mapping[str, Array]
    initial_state: Mapping[str, float]
    parameters: Mapping[str, float]


@dataclass(frozen=True, kw_only=True)
class Case:
    """A machine, what is hidden in it, and its records.

    Attributes:
        family: Name of the family.
        number: Of the case; from 1000 on the cases are sealed.
        kind: One of `KINDS`.
        effects: Hidden effects by name, each with its parameters; also those outside the catalogue.
        terms: Labels of the effects outside the catalogue.
        snr_target: The ratio that was asked for each effect, or for the disturbance; 0 if nothing is hidden.
        snr: The ratio of all that is hidden: rms over samples and runs of the change of the output, divided
            by sigma, in the channel where that is largest.
        snr_each: The ratio of each effect alone.
        snr_after_refit: The ratio of what is left of the change once the base law's parameters and starts
            have been fitted to it within their spread, to first order.
        snr_after_refit_each: The same for each effect alone.
        extra_scatter: Whether the parameters scatter from run to run several times as much as documented.
        parameters: True parameters of the base law, before the scatter.
        disturbance_rms: Of a broad case, in the unit of the base law's equation; 0 otherwise.
        dt_s: Sample time.
        runs: The records.
        sigma: Noise of each channel.
        quantum: Of each channel.
    """

    family: str
    number: int
    kind: str
    effects: Mapping[str, Mapping[str, float]]
    terms: tuple[Term, ...]
    snr_target: float
    snr: float
    snr_each: Mapping[str, float]
    snr_after_refit: float
    snr_after_refit_each: Mapping[str, float]
    extra_scatter: bool
    parameters: Mapping[str, float]
    disturbance_rms: float
    dt_s: float
    runs: tuple[Run, ...]
    sigma: Mapping[str, float]
    quantum: Mapping[str, float]
