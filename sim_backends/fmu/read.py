"""From the TOML file beside a functional mock-up unit to a model."""

import math
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from drivers.errors import ConfigError
from sim_backends.fmu.instance import INTEGERS, Fixed, Layout
from sim_backends.fmu.model import UnitModel
from sim_backends.fmu.unit import NUMBERS, Unit, Variable, open_unit
from sim_backends.fmu.unit_file import (
    EffectEntry,
    ParameterEntry,
    Quantity,
    RunParameterEntry,
    UnitFile,
    read_unit_file,
)
from sim_backends.fmu.workers import Workers
from sim_backends.models.interface import Channel, EffectCard, Parameter, RunParameter
from sim_backends.models.parameter_key import joined_name


def read_unit_model(path: Path) -> UnitModel:
    """Return the model that a TOML file makes of a functional mock-up unit.

    The unit is unpacked into a temporary folder, which is removed when the program ends. Its code is native
    and has the rights of the user; it is first run when something is predicted.

    Args:
        path: The TOML file; it names the FMU, relative to its own folder.

    Raises:
        ConfigError: A file cannot be read, or they do not fit; the message names the key.
    """
    file = read_unit_file(path)
    unit = open_unit(path.parent / file.fmu)
    try:
        return _Assembly(path, file, unit).model()
    except BaseException:
        unit.close()
        raise


class _Assembly:
    """Matches the entries of a file with the variables of a unit."""

    def __init__(self, path: Path, file: UnitFile, unit: Unit) -> None:
        self._path = path
        self._file = file
        self._unit = unit
        self._settings: dict[str, Variable] = {}
        self._outputs: dict[str, Variable] = {}
        self._inputs: dict[str, Variable] = {}
        self._errors: dict[str, str] = {}

    def model(self) -> UnitModel:
        """Return the model."""
        file = self._file
        inputs = {name: self._input(name, entry) for name, entry in file.inputs.items()}
        channels = tuple(
            Channel(
                name=name,
                unit=self._output("channels", name, entry),
                sigma=entry.sigma,
                quantum=entry.quantum,
                tolerance=entry.tolerance,
            )
            for name, entry in file.channels.items()
        )
        states = {name: self._output("signals", name, entry) for name, entry in file.signals.items()}
        parameters = tuple(self._parameter(name, entry) for name, entry in file.parameters.items())
        run_parameters = tuple(
            self._run_parameter(name, entry) for name, entry in file.run_parameters.items()
        )
        conditions = {
            name: self._unit_of(
                entry.unit,
                self._setting(f"conditions.{name}", name, name, entry.variable),
                f"conditions.{name}",
            )
            for name, entry in file.conditions.items()
        }
        base = {one.name: one for one in parameters}
        effects = tuple(self._effect(name, entry, base) for name, entry in file.effects.items())
        fixed = tuple(self._fixed(name, value) for name, value in file.fixed.items())
        self._require_names(inputs, states, conditions)
        layout = Layout(
            settings=tuple(one.reference for one in self._settings.values()),
            inputs=tuple(one.reference for one in self._inputs.values()),
            outputs=tuple(one.reference for one in self._outputs.values()),
            fixed=fixed,
            is_reset=file.reset,
        )
        return UnitModel(
            name=file.name or self._path.stem,
            inputs=inputs,
            states=states,
            channels=channels,
            parameters=parameters,
            run_parameters=run_parameters,
            condition_units=conditions,
            effects=effects,
            settings=tuple(self._settings),
            outputs=tuple(self._outputs),
            errors=self._errors,
            workers=Workers(self._unit, layout),
            step_s=file.step_s,
            is_held=file.held,
            communication_step_s=file.communication_step_s or self._unit.fixed_step_s,
        )

    def _require_names(self, *quantities: Mapping[str, str]) -> None:
        """Raise ConfigError where a column of the data would have two meanings."""
        names = [name for one in quantities for name in one]
        names += [*self._file.parameters, *self._file.run_parameters]
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise ConfigError(f"{self._path}: two quantities are called '{twice[0]}': give one another name")
        if not self._file.channels:
            raise ConfigError(f"{self._path}: channels is empty: name what was measured")
        for name, entry in self._file.run_parameters.items():
            if entry.channel and entry.channel not in self._file.channels:
                raise ConfigError(
                    f"{self._path}, run_parameters.{name}: there is no channel '{entry.channel}'; there are "
                    f"{', '.join(self._file.channels)}"
                )

    def _variable(self, key: str, name: str) -> Variable:
        with self._at(key):
            quantity = self._unit.variable(name)
        if not quantity.is_scalar:
            raise ConfigError(f"{self._path}, {key}: '{name}' is an array; only single numbers can be used")
        return quantity

    def _number(self, key: str, name: str) -> Variable:
        quantity = self._variable(key, name)
        if quantity.type not in NUMBERS:
            raise ConfigError(
                f"{self._path}, {key}: '{name}' is of type {quantity.type}; a floating-point number "
                "of 64 bits is needed"
            )
        return quantity

    def _input(self, name: str, entry: Quantity) -> str:
        key = f"inputs.{name}"
        quantity = self._number(key, entry.variable or name)
        if quantity.causality != "input":
            raise ConfigError(
                f"{self._path}, {key}: '{quantity.name}' is no input of the unit: it is {quantity.causality}"
            )
        self._inputs[name] = quantity
        return self._unit_of(entry.unit, quantity, key)

    def _output(self, table: str, name: str, entry: Quantity) -> str:
        key = f"{table}.{name}"
        if name in self._outputs:
            raise ConfigError(f"{self._path}, {key}: a channel has the same name: give one another name")
        quantity = self._number(key, entry.variable or name)
        self._outputs[name] = quantity
        return self._unit_of(entry.unit, quantity, key)

    def _setting(self, key: str, name: str, plain: str, variable: str) -> Variable:
        """Return the variable that a setting sets."""
        quantity = self._number(key, variable or plain)
        if not quantity.is_settable:
            raise ConfigError(
                f"{self._path}, {key}: '{quantity.name}' cannot be set: the unit computes it; use a "
                "parameter or a start value"
            )
        self._require_free(key, quantity)
        self._settings[name] = quantity
        return quantity

    def _require_free(self, key: str, quantity: Variable) -> None:
        for other, one in self._settings.items():
            if one.reference == quantity.reference:
                raise ConfigError(f"{self._path}, {key}: '{quantity.name}' is set by {other} already")

    def _parameter(self, name: str, entry: ParameterEntry) -> Parameter:
        key = f"parameters.{name}"
        quantity = self._setting(key, name, name, entry.variable)
        lower, upper = self._bounds(key, quantity, entry.lower, entry.upper)
        return Parameter(
            name=name,
            unit=self._unit_of(entry.unit, quantity, key),
            nominal=self._nominal(key, quantity, entry.nominal, lower, upper),
            prior_sd=entry.prior_sd,
            lower=lower,
            upper=upper,
            meaning=entry.meaning,
            scatter_sd=entry.scatter_sd,
            scatter_by=self._condition(key, entry.scatter_by),
        )

    def _run_parameter(self, name: str, entry: RunParameterEntry) -> RunParameter:
        key = f"run_parameters.{name}"
        quantity = self._setting(key, name, name, entry.variable)
        lower, upper = self._bounds(key, quantity, entry.lower, entry.upper)
        is_read = bool(entry.channel)
        return RunParameter(
            name=name,
            unit=self._unit_of(entry.unit, quantity, key),
            prior_sd=entry.prior_sd,
            nominal=0.0 if is_read else self._nominal(key, quantity, entry.nominal, lower, upper),
            channel=entry.channel,
            lower=lower,
            upper=upper,
        )

    def _effect(self, name: str, entry: EffectEntry, base: Mapping[str, Parameter]) -> EffectCard:
        parameters = [self._strength(name, entry, base)]
        for shape, one in entry.shapes.items():
            key = f"effects.{name}.shapes.{shape}"
            quantity = self._setting(key, joined_name(name, shape), shape, one.variable)
            lower, upper = self._bounds(key, quantity, one.lower, one.upper)
            parameters.append(
                Parameter(
                    name=shape,
                    unit=self._unit_of(one.unit, quantity, key),
                    nominal=self._nominal(key, quantity, one.nominal, lower, upper),
                    prior_sd=one.prior_sd,
                    lower=lower,
                    upper=upper,
                )
            )
        return EffectCard(
            name=name,
            sentence=entry.sentence,
            place=entry.place or entry.releases or self._unit.path.stem,
            parameters=tuple(parameters),
            claims=entry.claims,
            experiment=entry.experiment,
            source=entry.source or self._path.name,
            shape_grid={shape: one.grid for shape, one in entry.shapes.items() if one.grid},
            releases=entry.releases or None,
        )

    def _strength(self, effect: str, entry: EffectEntry, base: Mapping[str, Parameter]) -> Parameter:
        key, one = f"effects.{effect}.strength", entry.strength
        if entry.releases:
            return self._error(effect, entry, base)
        if not one.variable:
            raise ConfigError(f"{self._path}: {key}.variable is missing: name the parameter of the unit")
        name = one.name or re.sub(r"\W+", "_", one.variable.rpartition(".")[2]).strip("_")
        quantity = self._setting(key, joined_name(effect, name), "", one.variable)
        lower, upper = self._bounds(key, quantity, one.lower, one.upper)
        return Parameter(
            name=name,
            unit=self._unit_of(one.unit, quantity, key),
            nominal=self._nominal(key, quantity, one.null, lower, upper),
            prior_sd=one.size,
            lower=lower,
            upper=upper,
            scatter_sd=one.scatter_sd,
            scatter_by=self._condition(key, one.scatter_by),
        )

    def _error(self, effect: str, entry: EffectEntry, base: Mapping[str, Parameter]) -> Parameter:
        """Return the error of the base parameter that an effect releases."""
        if entry.releases not in base:
            raise ConfigError(
                f"{self._path}, effects.{effect}.releases: there is no parameter '{entry.releases}'; "
                f"there are {', '.join(base) or 'none'}"
            )
        if entry.strength.variable or entry.shapes or entry.strength.scatter_sd:
            raise ConfigError(
                f"{self._path}, effects.{effect}: what releases a parameter has no variable, no shapes "
                "and no scatter of its own"
            )
        parameter, name = base[entry.releases], entry.strength.name or "error"
        self._errors[joined_name(effect, name)] = parameter.name
        return Parameter(
            name=name,
            unit=parameter.unit,
            nominal=0.0,
            prior_sd=entry.strength.size,
            lower=parameter.lower - parameter.nominal,
            upper=parameter.upper - parameter.nominal,
        )

    def _condition(self, key: str, name: str) -> str:
        if name and name not in self._file.conditions:
            raise ConfigError(
                f"{self._path}, {key}.scatter_by: there is no condition '{name}'; there are "
                f"{', '.join(self._file.conditions) or 'none'}"
            )
        return name

    def _bounds(
        self, key: str, quantity: Variable, lower: float | None, upper: float | None
    ) -> tuple[float, float]:
        low = lower if lower is not None else float(quantity.low or -math.inf)
        high = upper if upper is not None else float(quantity.high or math.inf)
        if not low < high:
            raise ConfigError(f"{self._path}, {key}: lower = {low:g} is not below upper = {high:g}")
        return low, high

    def _nominal(
        self, key: str, quantity: Variable, given: float | None, lower: float, upper: float
    ) -> float:
        if given is None and not quantity.start:
            raise ConfigError(
                f"{self._path}: {key}.nominal is missing, and '{quantity.name}' has no start value"
            )
        value = float(quantity.start) if given is None else given
        if not lower <= value <= upper:
            raise ConfigError(f"{self._path}, {key}: {value:g} is outside of {lower:g} to {upper:g}")
        return value

    def _unit_of(self, given: str, quantity: Variable, key: str) -> str:
        """Return the unit of a quantity: that of the file, which must be that of the FMU."""
        if not (given or quantity.unit):
            raise ConfigError(f'{self._path}: {key}.unit is missing: write it, "1" for a pure number')
        if given and quantity.unit and _plain(given) != _plain(quantity.unit):
            raise ConfigError(
                f"{self._path}, {key}: unit is '{given}', but '{quantity.name}' of the FMU is in "
                f"'{quantity.unit}': write that, values are not converted"
            )
        return given or quantity.unit

    def _fixed(self, name: str, value: bool | int | float | str) -> Fixed:
        key = f"fixed.{name}"
        quantity = self._variable(key, name)
        if not quantity.is_settable:
            raise ConfigError(f"{self._path}, {key}: '{name}' cannot be set: the unit computes it")
        self._require_free(key, quantity)
        wanted = _kind(quantity.type)
        if wanted is None or not isinstance(value, wanted) or isinstance(value, bool) != (wanted is bool):
            raise ConfigError(f"{self._path}, {key}: {value!r} is no value of type {quantity.type}")
        return quantity.type, quantity.reference, float(value) if wanted == (int, float) else value

    @contextmanager
    def _at(self, key: str) -> Iterator[None]:
        try:
            yield
        except ConfigError as error:
            raise ConfigError(f"{self._path}, {key}: {error}") from error


def _kind(type_name: str) -> type | tuple[type, ...] | None:
    if type_name in (*NUMBERS, "Float32"):
        return (int, float)
    if type_name in INTEGERS:
        return int
    return {"Boolean": bool, "String": str}.get(type_name)


def _plain(unit: str) -> str:
    """Return a unit without what tools write differently: N.m/s^2, N m/s2 and N*m/s2 are the same."""
    text = unit.replace("°", "deg").replace("²", "2").replace("³", "3")
    return "".join(one for one in text if one not in " .*·^()")
