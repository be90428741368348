"""A machine as a right-hand side with named ports."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from types import SimpleNamespace
from typing import TypeAlias

from drivers.errors import ConfigError
from sim_backends.models.interface import Array, Channel, EffectCard, Parameter, Port, RunParameter
from sim_backends.models.ranges import require_positive
from sim_backends.state_model.port_effect import Action, PortEffect

Signal: TypeAlias = Callable[[str, Array], Array]
"""Name of a port and its signal -> the signal with effects and forces."""
Derivative: TypeAlias = Callable[
    [SimpleNamespace, SimpleNamespace, SimpleNamespace, Signal], Mapping[str, Array]
]
"""States, inputs, parameters, ports -> rate of each state."""
Output: TypeAlias = Callable[[SimpleNamespace, SimpleNamespace, SimpleNamespace, Signal], Mapping[str, Array]]
"""States, inputs, parameters, ports -> each channel."""
Start: TypeAlias = Callable[[SimpleNamespace, SimpleNamespace], Mapping[str, Array | float]]
"""Parameters, first inputs -> each state at the first sample."""


@dataclass(frozen=True, kw_only=True)
class Equations:
    """Equations of a machine, and the effects that may be missing in them.

    All arguments of the three functions are arrays of one number per run and trial of parameters: use numpy
    functions and `np.where`, never `if` on a value.

    Attributes:
        name: Its identifier.
        states: State to unit.
        inputs: Input to unit.
        channels: What is measured.
        parameters: Base parameters.
        derivative: `derivative(x, u, p, port)` returns the rate of each state. A signal that effects or a
            random force may change is written `port("name", value)`.
        start: `start(p, u)` returns the states at the first sample.
        output: `output(x, u, p, port)` returns each channel.
        step_s: Time between samples; None where the runs have an input `t_s`.
        run_parameters: Unknowns of each run: initial states, release times, offsets.
        ports: The named signals in `derivative`. Inputs and channels are ports without a declaration.
        port_effects: Effects that may be missing.
        condition_units: Conditions, as in `Model`; `p` holds them too.
        is_held: Inputs hold their value until the next sample, as a digital output does; otherwise they are
            interpolated, as a measured signal.
        substeps: Integration steps per sample, or per quarter of one where an effect is a delay or a lag.
        effect_substeps: The same where an effect acts that needs more.
        known_forces: Forces that act besides the equations: run, then port, to values at the samples.
    """

    name: str
    states: Mapping[str, str]
    inputs: Mapping[str, str]
    channels: tuple[Channel, ...]
    parameters: tuple[Parameter, ...]
    derivative: Derivative
    start: Start
    output: Output
    step_s: float | None = None
    run_parameters: tuple[RunParameter, ...] = ()
    ports: tuple[Port, ...] = ()
    port_effects: tuple[PortEffect, ...] = ()
    condition_units: Mapping[str, str] = field(default_factory=dict)
    is_held: bool = True
    substeps: int = 1
    effect_substeps: Mapping[str, int] = field(default_factory=dict)
    known_forces: Mapping[str, Mapping[str, Array]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Check that every effect is attached to something that exists.

        Raises:
            ConfigError: A port, input, channel or state of an effect is unknown, a name appears twice, or
                `step_s` is not above 0.
        """
        if self.step_s is not None:
            require_positive(f"model {self.name}", step_s=self.step_s)
        unknowns = [*(one.name for one in self.parameters), *(one.name for one in self.run_parameters)]
        self._require_different("quantities", [*self.states, *self.inputs, *self.condition_units, *unknowns])
        signals = [*self.inputs, *(one.name for one in self.channels), *(one.name for one in self.ports)]
        self._require_different("signals (inputs, channels, ports)", signals)
        known = self._units
        for effect in self.port_effects:
            for name in (effect.port, *effect.states, *effect.elsewhere):
                if name not in known:
                    raise ConfigError(
                        f"model {self.name}: an effect refers to '{name}', which is no port, input, channel, "
                        f"state or parameter; there are {', '.join(known)}"
                    )
            self._require_port(effect)
        self._require_different("effects", [card.name for card in self.effects])
        self._require_scatter()

    def _require_scatter(self) -> None:
        """Raise ConfigError where a parameter cannot scatter as it declares."""
        strengths = [card.parameters[0] for card in self.effects]
        conditions = sorted({one.scatter_by for one in (*self.parameters, *strengths) if one.scatter_by})
        if len(conditions) > 1:
            raise ConfigError(
                f"model {self.name}: parameters scatter by {' and by '.join(conditions)}: use one condition, "
                "the unit under test"
            )
        for one in (*self.parameters, *strengths):
            if one.scatter_by and one.scatter_by not in self.condition_units:
                raise ConfigError(
                    f"model {self.name}: {one.name} scatters by '{one.scatter_by}', not a condition: "
                    f"there are {', '.join(self.condition_units) or 'none'}"
                )
        for effect, card in zip(self.port_effects, self.effects, strict=True):
            if any(one.scatter_sd for one in card.parameters[1:]):
                raise ConfigError(f"model {self.name}: of effect {card.name} only the strength may scatter")
            if card.parameters[0].scatter_sd and effect.action is not Action.CHANGE:
                raise ConfigError(
                    f"model {self.name}: {card.name} cannot scatter: a {effect.action.value} has one size in "
                    "all runs"
                )

    def _require_port(self, effect: PortEffect) -> None:
        """Raise ConfigError where an effect cannot act at the kind of signal that it is attached to."""
        is_inside = effect.port in {one.name for one in self.ports}
        if effect.states and effect.action is Action.CHANGE and not is_inside:
            raise ConfigError(
                f"model {self.name}: an effect at '{effect.port}' depends on {', '.join(effect.states)}: "
                "attach it to a port inside the equations"
            )
        if effect.action in (Action.DELAY, Action.LAG) and is_inside:
            raise ConfigError(
                f"model {self.name}: a {effect.action.value} cannot act at the port '{effect.port}': attach "
                "it to an input or a channel"
            )

    def _require_different(self, what: str, names: Sequence[str]) -> None:
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise ConfigError(f"model {self.name}: two {what} are called '{twice[0]}': give one another name")

    def require_port(self, name: str) -> None:
        """Check that the equations name a declared port.

        Raises:
            ConfigError: They do not.
        """
        if not any(one.name == name for one in self.ports):
            raise ConfigError(
                f"model {self.name}: its equations name a port '{name}' that `ports` does not declare; there "
                f"are {', '.join(one.name for one in self.ports) or 'none'}"
            )

    @property
    def signal_units(self) -> dict[str, str]:
        """Units of the states, inputs, channels and ports."""
        channels = {one.name: one.unit for one in self.channels}
        return {**self.states, **self.inputs, **channels, **{one.name: one.unit for one in self.ports}}

    @property
    def _units(self) -> dict[str, str]:
        return {**self.signal_units, **{one.name: one.unit for one in self.parameters}}

    @property
    def input_units(self) -> Mapping[str, str]:
        """The inputs it needs and their units."""
        return self.inputs if self.step_s is not None else {"t_s": "s", **self.inputs}

    @cached_property
    def effects(self) -> tuple[EffectCard, ...]:
        """The cards of its effects."""
        units = self._units
        return tuple(
            self._within_bounds(effect.build(units))
            if effect.action is Action.RELEASE
            else effect.build(units)
            for effect in self.port_effects
        )

    def _within_bounds(self, card: EffectCard) -> EffectCard:
        """Return the card of a wrong parameter whose error keeps the parameter inside its bounds."""
        base = next(one for one in self.parameters if one.name == card.releases)
        error = card.parameters[0]
        inside = replace(error, lower=base.lower - base.nominal, upper=base.upper - base.nominal)
        return replace(card, parameters=(inside, *card.parameters[1:]))
