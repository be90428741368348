"""A machine with effects named before; their parameters are now base parameters."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace

from rover_hil.gap.output.model_file import ExtendedModel, ModelFile, extended_parameters
from sim_backends.fmu.model import UnitModel
from sim_backends.models.interface import Array, EffectCard, Model, Run, Values
from sim_backends.models.parameter_key import joined_name
from sim_backends.state_model.integrate import Point
from sim_backends.state_model.model import StateModel
from sim_backends.state_model.port_effect import PortEffect

PART_OF_MODEL = "{} (part of the model)"
"""Name of an active effect inside, so that a term of the same name can be compared with it."""


@dataclass(frozen=True, kw_only=True)
class ExtendedMachine(StateModel):
    """A machine in which some effects always act; see `Equations` for the other arguments.

    Attributes:
        active_effects: By the name of their card. The parameters of the machine include theirs, called
            `card.parameter`.
    """

    active_effects: Mapping[str, PortEffect] = field(default_factory=dict)

    @property
    def active(self) -> tuple[str, ...]:
        """The effects that are part of the model."""
        return tuple(self.active_effects)

    def simulate_points(self, runs: Sequence[Run], points: Sequence[Point]) -> list[list[dict[str, Array]]]:
        """Return the channels of each run at each point. See `StateModel.simulate_points`."""
        return self._whole().simulate_points(runs, [self._translated(point) for point in points])

    def trajectories(
        self, runs: Sequence[Run], parameters: Values, effects: Mapping[str, Values]
    ) -> list[dict[str, Array]]:
        """Return states and inputs of each run over its samples."""
        point = self._translated(Point(parameters, effects))
        return self._whole().trajectories(runs, point.parameters, point.effects)

    def _whole(self) -> StateModel:
        """Return the machine with its active effects among the others."""
        parts = {one.name: getattr(self, one.name) for one in fields(StateModel)}
        active = [_renamed(name, effect) for name, effect in self.active_effects.items()]
        return StateModel(**{**parts, "port_effects": (*active, *self.port_effects)})

    def _translated(self, point: Point) -> Point:
        """Return a point with the parameters of the active effects moved from the base to the effects."""
        nominal = {item.name: item.nominal for item in self.parameters}
        own: dict[str, float] = {}
        active: dict[str, dict[str, float]] = {PART_OF_MODEL.format(name): {} for name in self.active_effects}
        for key, value in (nominal | dict(point.parameters)).items():
            name = next((one for one in self.active_effects if key.startswith(joined_name(one, ""))), "")
            part, parameter = PART_OF_MODEL.format(name), key.removeprefix(joined_name(name, ""))
            if name and key in nominal:
                active[part][parameter] = value
            else:  # deviations in single runs stay among those of the base
                own[joined_name(part, parameter) if name else key] = value
        return Point(own, {**active, **point.effects}, point.force)


def _renamed(name: str, effect: PortEffect) -> PortEffect:
    def build(units: Mapping[str, str]) -> EffectCard:
        return replace(effect.build(units), name=PART_OF_MODEL.format(name))

    return replace(effect, build=build)


def extend_model(base: Model, file: ModelFile) -> Model:
    """Return a model with the effects of a model file in it; a machine stays a machine.

    Raises:
        ConfigError: The file names parameters or effects that the model does not have.
    """
    if isinstance(base, UnitModel):
        return base.with_active(extended_parameters(base, file), tuple(file.effects))
    if not isinstance(base, StateModel):
        return ExtendedModel(base, file)
    parameters = extended_parameters(base, file)
    by_name = {card.name: effect for card, effect in zip(base.effects, base.port_effects, strict=True)}
    parts = {one.name: getattr(base, one.name) for one in fields(StateModel)}
    parts |= {
        "parameters": parameters,
        "port_effects": tuple(effect for name, effect in by_name.items() if name not in file.effects),
    }
    names = sorted(file.effects.keys() & by_name.keys(), key=list(by_name).index)
    # The sort is stable: effects without a place in the order keep that of the model.
    names.sort(key=lambda name: file.order.index(name) if name in file.order else len(file.order))
    return ExtendedMachine(**parts, active_effects={name: by_name[name] for name in names})
