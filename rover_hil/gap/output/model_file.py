"""Model file: base model, parameters, named effects, provenance."""

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Literal

from pydantic import ValidationError

from drivers.errors import ConfigError
from drivers.files import parse_toml, read_text
from drivers.settings import Settings
from rover_hil.gap.evidence.sizes import Size
from rover_hil.gap.fit.base_parameters import HALF_WIDTHS
from rover_hil.gap.verdict import FittedBase
from sim_backends.models.interface import (
    Array,
    Channel,
    DrivenModel,
    EffectCard,
    EitherDriven,
    Model,
    Parameter,
    Run,
    Values,
)
from sim_backends.models.parameter_key import ParameterKey, joined_name, read_key

SCHEMA: Literal["rover-hil-model/1"] = "rover-hil-model/1"


class Number(Settings):
    """A parameter: value, unit, standard deviation, and for effects the 95 % interval."""

    value: float
    unit: str
    sd: float
    ci95: tuple[float, float] | None = None


class Provenance(Settings):
    """Origin of the numbers."""

    date: str
    verdict: str
    data_sha256: str
    plan_sha256: str
    seed: int
    alternatives: tuple[tuple[str, ...], ...] = ()


class ModelFile(Settings):
    """Content of the file; effects in `order` act in this order, the others after them."""

    schema_name: Literal["rover-hil-model/1"] = SCHEMA
    base: str
    order: tuple[str, ...] = ()
    provenance: Provenance
    parameters: dict[str, Number]
    effects: dict[str, dict[str, Number]]


class ExtendedModel:
    """A model with effects named before; their parameters are now base parameters.

    Raises:
        ConfigError: The file names parameters or effects that the model does not have.
    """

    input_units: Mapping[str, str]
    alternative_inputs: tuple[str, ...]

    def __init__(self, base: Model, file: ModelFile) -> None:
        self._base = base
        self._cards = {card.name: card for card in base.effects if card.name in file.effects}
        self.parameters: tuple[Parameter, ...] = extended_parameters(base, file)
        self.name: str = base.name
        self.channels: tuple[Channel, ...] = tuple(base.channels)
        self.condition_units: Mapping[str, str] = base.condition_units
        self.effects: tuple[EffectCard, ...] = tuple(
            card for card in base.effects if card.name not in file.effects
        )
        self._nominal = {item.name: item.nominal for item in self.parameters}
        if isinstance(base, DrivenModel):
            self.input_units = base.input_units
        if isinstance(base, EitherDriven):
            self.alternative_inputs = base.alternative_inputs

    @property
    def active(self) -> tuple[str, ...]:
        """The effects that are part of the model."""
        return tuple(self._cards)

    def predict(
        self, runs: Sequence[Run], parameters: Values, effects: Mapping[str, Values]
    ) -> list[dict[str, Array]]:
        """Predict as the base model with its active effects; see `Model.predict`."""
        values = {**self._nominal, **parameters}
        own = {name: value for name, value in values.items() if read_key(name).is_base}
        active: dict[str, Values] = {
            card.name: {item.name: values[joined_name(card.name, item.name)] for item in card.parameters}
            for card in self._cards.values()
        }
        return self._base.predict(runs, own, {**active, **effects})


def extended_parameters(base: Model, file: ModelFile) -> tuple[Parameter, ...]:
    """Return the base parameters of a model with the effects of a file in it, with the values of the file.

    Raises:
        ConfigError: The file names parameters or effects that the model does not have.
    """
    _check(base, file)
    cards = [card for card in base.effects if card.name in file.effects]
    released = {card.releases for card in cards}
    own = [
        _known(item, file.parameters.get(item.name), is_fixed=item.name in released)
        for item in base.parameters
    ]
    added = [
        replace(_known(item, file.effects[card.name].get(item.name)), name=joined_name(card.name, item.name))
        for card in cards
        for item in card.parameters
    ]
    return (*own, *added)


def _known(item: Parameter, number: Number | None, *, is_fixed: bool = False) -> Parameter:
    if number is None:
        return replace(item, prior_sd=0.0 if is_fixed else item.prior_sd)
    inside = min(max(number.value, item.lower), item.upper)
    return replace(item, nominal=inside, prior_sd=0.0 if is_fixed else number.sd)


def _check(base: Model, file: ModelFile) -> None:
    parameters = {item.name: item.unit for item in base.parameters}
    cards = {card.name: {item.name: item.unit for item in card.parameters} for card in base.effects}
    for owner, numbers, known in (
        ("parameters", file.parameters, parameters),
        *((f"effects.{name}", numbers, cards.get(name)) for name, numbers in file.effects.items()),
    ):
        if known is None:
            raise ConfigError(f"model file: {base.name} has no effect '{owner.removeprefix('effects.')}'")
        for name, number in numbers.items():
            if name not in known:
                raise ConfigError(f"model file, {owner}.{name}: {base.name} has no such parameter")
            if number.unit != known[name]:
                raise ConfigError(
                    f"model file, {owner}.{name}: unit is {number.unit}, {base.name} has {known[name]}"
                )


def read_model_file(path: Path) -> ModelFile:
    """Read a model file.

    Raises:
        ConfigError: It cannot be read, or contains an unknown key.
    """
    try:
        table = parse_toml(read_text(path))
    except OSError as error:
        raise ConfigError(f"cannot read {path}: {error.strerror}; use the model.toml of a gap run") from error
    except ValueError as error:
        raise ConfigError(f"{path} is not a TOML file: {error}") from error
    table["schema_name"] = table.pop("schema", None)
    table.setdefault("parameters", {})
    table.setdefault("effects", {})
    try:
        return ModelFile.model_validate(table)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"]).replace("schema_name", "schema")
        raise ConfigError(f"{path}, {where}: {first['msg']}") from error


def describe_model(
    model: Model, base: str, provenance: Provenance, sizes: Mapping[ParameterKey, Size]
) -> ModelFile:
    """Return the model file after a fit.

    The standard deviation of each number is that of a normal with the interval of the verdict, so that it
    covers the scatter between runs.
    """
    parameters: dict[str, Number] = {}
    effects: dict[str, dict[str, Number]] = {}
    for item in model.parameters:
        key = read_key(item.name)
        number = _number(item, ParameterKey(name=item.name), sizes)
        if key.effect:
            effects.setdefault(key.effect, {})[key.name] = number
        else:
            parameters[item.name] = number.model_copy(update={"ci95": None})
    found = {key.effect for key in sizes if key.effect}
    for card in model.effects:
        if card.name in found:
            effects[card.name] = {
                item.name: _number(item, ParameterKey(effect=card.name, name=item.name), sizes)
                for item in card.parameters
            }
    return ModelFile(base=base, provenance=provenance, parameters=parameters, effects=effects)


def with_found(file: ModelFile, bases: Sequence[FittedBase]) -> ModelFile:
    """Return a model file with the fitted values of the base parameters that are the finding."""
    parameters, effects = dict(file.parameters), {name: dict(one) for name, one in file.effects.items()}
    for one in bases:
        if one.is_named:
            half = 0.5 * (one.ci95[1] - one.ci95[0])
            number = Number(value=one.value, unit=one.unit, sd=half / HALF_WIDTHS)
            key = read_key(one.name)
            (effects[key.effect] if key.effect else parameters)[key.name] = number
    return file.model_copy(update={"parameters": parameters, "effects": effects})


def _number(item: Parameter, key: ParameterKey, sizes: Mapping[ParameterKey, Size]) -> Number:
    if key not in sizes:
        return Number(value=item.nominal, unit=item.unit, sd=item.prior_sd)
    size = sizes[key]
    sd = max(size.high - size.value, size.value - size.low) / HALF_WIDTHS
    return Number(value=size.value, unit=item.unit, sd=sd, ci95=(size.low, size.high))


def model_file_text(file: ModelFile) -> str:
    """Return the TOML text of a model file."""
    lines = [f'schema = "{SCHEMA}"', f"base = {json.dumps(file.base)}"]
    lines += [f"order = {json.dumps(file.order)}"] if file.order else []
    lines += ["", "[provenance]"]
    source = file.provenance.model_dump(mode="json")
    lines += [f"{name} = {json.dumps(value)}" for name, value in source.items()]
    for name, number in file.parameters.items():
        lines += ["", f"[parameters.{_toml_key(name)}]", *_number_lines(number)]
    for effect, numbers in file.effects.items():
        for name, number in numbers.items():
            lines += ["", f"[effects.{_toml_key(effect)}.{_toml_key(name)}]", *_number_lines(number)]
    return "\n".join(lines) + "\n"


def _toml_key(name: str) -> str:
    """Return a key of TOML; a draft term is called by its equation, which needs quotes."""
    return name if re.fullmatch("[A-Za-z0-9_-]+", name) else json.dumps(name)


def _number_lines(number: Number) -> list[str]:
    lines = [
        f"value = {float(number.value)!r}",
        f"unit = {json.dumps(number.unit)}",
        f"sd = {float(number.sd)!r}",
    ]
    if number.ci95 is not None:
        lines.append(f"ci95 = [{float(number.ci95[0])!r}, {float(number.ci95[1])!r}]")
    return lines
