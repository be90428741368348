"""Interface of a model that is compared with measured runs; independent of rovers."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol, TypeAlias, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from sim_backends.models.parameter_key import ParameterKey
from sim_backends.models.ranges import require_bounds, require_not_negative, require_positive

Array: TypeAlias = NDArray[np.float64]
Values: TypeAlias = Mapping[str, float]
"""Parameter name to value."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Parameter:
    """A number of a model or an effect.

    Attributes:
        name: Unique within its model or effect.
        unit: SI unit or degree; "1" for a pure number.
        nominal: Value without other knowledge; of an effect's parameter, the value without effect.
        prior_sd: Standard deviation of the nominal value; of an effect's parameter, its natural size.
        lower: Least possible value.
        upper: Greatest possible value.
        meaning: One sentence.
        scatter_sd: Machines: standard deviation between runs, or between the units under test. Each then has
            a deviation of its own from the value for all; 0 where all runs have one value. Of an effect only
            the strength may scatter.
        scatter_by: Condition that states which unit was under test; empty where every run deviates by itself.
    """

    name: str
    unit: str
    nominal: float
    prior_sd: float
    lower: float
    upper: float
    meaning: str = ""
    scatter_sd: float = 0.0
    scatter_by: str = ""

    def __post_init__(self) -> None:
        """Check the numbers; a `prior_sd` of 0 is allowed, of a parameter that is known.

        Raises:
            ConfigError: One is impossible.
        """
        owner = f"parameter {self.name}"
        require_not_negative(owner, prior_sd=self.prior_sd, scatter_sd=self.scatter_sd)
        require_bounds(owner, self.lower, self.nominal, self.upper)

    def owner_in(self, run: "Run") -> str:
        """Return whose deviation acts in a run: the name of the run, or `CONDITION=VALUE` of the unit."""
        if not self.scatter_by:
            return run.name
        value = run.conditions[self.scatter_by]
        short = f"{value:g}"
        return f"{self.scatter_by}={short if float(short) == value else repr(value)}"

    def deviation_in(self, run: "Run", effect: str = "") -> ParameterKey:
        """Return the deviation that acts in a run; `effect` where it is the strength of one."""
        return ParameterKey(name=self.name, effect=effect, run=self.owner_in(run), is_deviation=True)

    @property
    def natural(self) -> float:
        """The value one standard deviation from the nominal one, to the side that the bounds allow."""
        value = self.nominal + self.prior_sd
        if value > self.upper:
            value = self.nominal - self.prior_sd
        return max(value, self.lower)


def parameter(
    name: str, unit: str, nominal: float, prior_sd: float, lower: float, upper: float, meaning: str = ""
) -> Parameter:
    """Return a parameter given as a row of a table; see `Parameter` for the columns."""
    return Parameter(
        name=name, unit=unit, nominal=nominal, prior_sd=prior_sd, lower=lower, upper=upper, meaning=meaning
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Channel:
    """A measured quantity that a model predicts.

    Attributes:
        name: Unique within its model.
        unit: Its unit.
        sigma: Standard deviation of one value where the sensor's is known; None to estimate it from
            replicates.
        quantum: Step of the sensor; 0 where there is none.
        is_optional: Data without this channel is compared without it.
        tolerance: Steady experiments: standard deviation of what the base model is known to be wrong by
            (formula, solver), the same whenever the conditions are the same. Machines: greatest model error
            that counts as agreement; 0 for the noise of the sensor.
    """

    name: str
    unit: str
    sigma: float | None = None
    quantum: float = 0.0
    tolerance: float = 0.0
    is_optional: bool = False

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            ConfigError: One is negative.
        """
        require_not_negative(
            f"channel {self.name}", sigma=self.sigma or 0.0, quantum=self.quantum, tolerance=self.tolerance
        )

    @property
    def noise_sd(self) -> float:
        """Standard deviation of one value by the sensor's declaration, with its steps; 0 where unknown."""
        return math.hypot(self.sigma or 0.0, self.quantum / math.sqrt(12.0))


@dataclass(frozen=True, slots=True, kw_only=True)
class Port:
    """A named signal in the equations of a machine, where effects and unknown forces may act.

    Attributes:
        name: Unique among the ports, inputs and channels of its model.
        unit: Of the signal.
        force_sd: Natural size of an unknown random force at this port.
    """

    name: str
    unit: str
    force_sd: float

    def __post_init__(self) -> None:
        """Check the size.

        Raises:
            ConfigError: It is 0 or negative.
        """
        require_positive(f"port {self.name}", force_sd=self.force_sd)


@dataclass(frozen=True, slots=True, kw_only=True)
class RunParameter:
    """An unknown number of each run: an initial state, a release time, an offset.

    Attributes:
        name: Unique within its model.
        unit: SI unit or degree.
        prior_sd: Standard deviation of the nominal value.
        nominal: Value without other knowledge.
        channel: Where given, the nominal value is the first measured value of this channel instead. A fit
            may leave it, as it is a sample of the record already and would count twice.
        lower: Least possible value.
        upper: Greatest possible value.
    """

    name: str
    unit: str
    prior_sd: float
    nominal: float = 0.0
    channel: str = ""
    lower: float = -math.inf
    upper: float = math.inf

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            ConfigError: One is impossible.
        """
        owner = f"run parameter {self.name}"
        require_positive(owner, prior_sd=self.prior_sd)
        # With a channel the first measured value takes the place of the nominal one.
        require_bounds(owner, self.lower, self.lower if self.channel else self.nominal, self.upper)

    def key_in(self, run: "Run") -> ParameterKey:
        """Return this unknown in a run."""
        return ParameterKey(name=self.name, run=run.name)

    def nominal_in(self, run: "Run") -> float:
        """Return the nominal value in a run."""
        read = self._read_in(run)
        return self.nominal if read is None else read

    def is_read_in(self, run: "Run") -> bool:
        """Return True where the nominal value in a run is a measured one."""
        return self._read_in(run) is not None

    def _read_in(self, run: "Run") -> float | None:
        if self.channel in run.first:
            return run.first[self.channel]
        values = run.measured.get(self.channel, np.zeros(0))
        good = np.flatnonzero(np.isfinite(values))
        return float(values[good[0]]) if good.size else None


@dataclass(frozen=True, slots=True, kw_only=True)
class Run:
    """One experiment: conditions, inputs and measurements.

    Attributes:
        name: Unique within a data set.
        conditions: Numbers that were set, one per run (slope, load, ...); equal conditions are replicates.
        inputs: Input series, all of one length; empty for steady experiments.
        measured: Channel to values: one value for a steady experiment, else a series; NaN where missing.
        overlap: How many values at the start and end of each series are NaN on purpose, as they overlap with
            a neighbouring run; they do not count as missing.
        missing: Columns of the record that were bridged over gaps to make this run: missing values, of all.
        first: First value of a channel where it is known but not compared.
    """

    name: str
    conditions: Mapping[str, float]
    inputs: Mapping[str, Array] = field(default_factory=dict)
    measured: Mapping[str, Array] = field(default_factory=dict)
    overlap: tuple[int, int] = (0, 0)
    missing: Mapping[str, tuple[int, int]] = field(default_factory=dict)
    first: Mapping[str, float] = field(default_factory=dict)

    @property
    def count(self) -> int:
        """Number of samples."""
        return max((values.size for values in (*self.inputs.values(), *self.measured.values())), default=0)


@dataclass(frozen=True, slots=True, kw_only=True)
class EffectCard:
    """A physical effect that may be missing in a model.

    Attributes:
        name: Its identifier.
        sentence: The physics, in one sentence.
        place: Where it enters: equation, port, sensor channel, clock or supply.
        parameters: Its parameters; with all of them at `nominal` the model predicts what it does without.
            A bound at the nominal value is the sign rule. The first is the strength, the others are shapes.
        shape_grid: Values of the shape parameters to search where the effect is not smooth at its null.
        releases: The base parameter that this card sets free beyond its prior; None for a structural effect.
        claims: Symmetries in words: behaviour when mirrored, on level ground, with load, over time.
        experiment: The run that distinguishes it from other effects.
        source: Paper, equation, data sheet or reasoning.
    """

    name: str
    sentence: str
    place: str
    parameters: tuple[Parameter, ...]
    claims: tuple[str, ...]
    experiment: str
    source: str
    shape_grid: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    releases: str | None = None

    @property
    def strength_key(self) -> ParameterKey:
        """The key of its first parameter."""
        return ParameterKey(effect=self.name, name=self.parameters[0].name)


class Model(Protocol):
    """A simulator with effects that can be switched on."""

    @property
    def name(self) -> str:
        """Its identifier."""

    @property
    def channels(self) -> tuple[Channel, ...]:
        """What it predicts."""

    @property
    def condition_units(self) -> Mapping[str, str]:
        """The conditions it needs and their units."""

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Base parameters; all are uncertain by their prior."""

    @property
    def effects(self) -> tuple[EffectCard, ...]:
        """Effects that may be missing."""

    def predict(
        self, runs: Sequence[Run], parameters: Values, effects: Mapping[str, Values]
    ) -> list[dict[str, Array]]:
        """Predict every channel of every run.

        Args:
            runs: Their conditions and inputs; `measured` gives the lengths of series only.
            parameters: Values of base parameters; those left out are nominal.
            effects: Active effects with their parameters; those left out are nominal.

        Returns:
            One table per run: channel to values, shaped as measured. NaN where the model has no solution.
        """
        ...


@runtime_checkable
class RunReader(Protocol):
    """A model that knows the files its measured runs come in; without it a table of runs is read."""

    def read_runs(self, path: Path) -> list[Run]:
        """Return the runs in a file or folder.

        Raises:
            ConfigError: The data is unusable; the message contains the place.
            LogError: A log cannot be read.
        """
        ...


@runtime_checkable
class StretchReader(Protocol):
    """A model whose series may begin in the middle of a drive."""

    def stretches_of(self, run: Run) -> list[Run]:
        """Return a long run cut into shorter ones; itself where it is too short."""
        ...


@runtime_checkable
class DrivenModel(Protocol):
    """A model that is fed with series."""

    @property
    def input_units(self) -> Mapping[str, str]:
        """The inputs it needs and their units."""


@runtime_checkable
class EitherDriven(Protocol):
    """A driven model with inputs that replace each other."""

    @property
    def alternative_inputs(self) -> tuple[str, ...]:
        """Inputs of which a data set has one: the last that all of its runs have, else the first."""


@runtime_checkable
class Machine(Model, Protocol):
    """A model of a machine that moves; nothing of its inside needs to be known."""

    @property
    def states(self) -> Mapping[str, str]:
        """Signals inside that `trajectories` returns, and their units."""

    @property
    def inputs(self) -> Mapping[str, str]:
        """The inputs that drive it, and their units."""

    @property
    def input_units(self) -> Mapping[str, str]:
        """The same, with the time where the runs must have it."""

    @property
    def step_s(self) -> float | None:
        """Time between samples; None where the runs have an input `t_s`."""

    @property
    def run_parameters(self) -> tuple[RunParameter, ...]:
        """Unknowns of each run."""

    def predict_points(
        self, runs: Sequence[Run], points: Sequence[tuple[Values, Mapping[str, Values]]]
    ) -> list[list[dict[str, Array]]]:
        """Predict at several points at once: point, then run, to channel and values.

        A point is base parameters and effects; those of single runs are called by `ParameterKey.text`.
        """
        ...

    def trajectories(
        self, runs: Sequence[Run], parameters: Values, effects: Mapping[str, Values]
    ) -> list[dict[str, Array]]:
        """Return the signals inside and the inputs of each run over its samples."""
        ...

    def refined(self, runs: Sequence[Run]) -> "Machine":
        """Return the same model with steps that are small enough for these runs."""
        ...
