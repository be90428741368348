"""The TOML file that makes a model of a functional mock-up unit: its keys."""

from pathlib import Path
from typing import Annotated

from pydantic import Field, ValidationError
from pydantic_core import ErrorDetails

from drivers.errors import ConfigError
from drivers.settings import Settings, direct_mistakes, read_toml

Positive = Annotated[float, Field(gt=0.0)]
NotNegative = Annotated[float, Field(ge=0.0)]
Name = Annotated[str, Field(pattern=r"^[A-Za-z_][A-Za-z0-9_]*$")]


class Quantity(Settings):
    """A variable of the unit.

    Attributes:
        variable: Variable of the unit, a floating-point number of 64 bits, no array; without it, the
            name of the quantity.
        unit: Without it, that of the FMU; it must be the same, since values are not converted.
    """

    variable: str = ""
    unit: str = ""


class ChannelEntry(Quantity):
    """What is measured: a column of the data, read at each sample after the input of this sample was set.

    Attributes:
        sigma: Standard deviation of one reading; `sigma` or `quantum` is needed.
        quantum: Step of the sensor.
        tolerance: Greatest model error that counts as agreement; 0 is the noise of the sensor.
    """

    sigma: NotNegative | None = None
    quantum: NotNegative = 0.0
    tolerance: NotNegative = 0.0


class ParameterEntry(Quantity):
    """A base parameter.

    Attributes:
        prior_sd: Standard deviation of the nominal value; 0 keeps it fixed.
        nominal: Value without other knowledge; without it, the start value of the unit.
        lower: Least possible value; without it, `min` of the unit.
        upper: Greatest possible value; without it, `max` of the unit.
        meaning: One sentence for the page.
        scatter_sd: Standard deviation between runs, or between units under test.
        scatter_by: Condition with the number of the unit under test; without it, each run is separate.
    """

    prior_sd: NotNegative
    nominal: float | None = None
    lower: float | None = None
    upper: float | None = None
    meaning: str = ""
    scatter_sd: NotNegative = 0.0
    scatter_by: str = ""


class RunParameterEntry(Quantity):
    """An unknown of each run, usually where it starts.

    Attributes:
        prior_sd: Standard deviation of the nominal value.
        nominal: Value without other knowledge; without it, the start value of the unit.
        channel: The nominal value is the first reading of this channel.
        lower: Least possible value; without it, `min` of the unit.
        upper: Greatest possible value; without it, `max` of the unit.
    """

    prior_sd: Positive
    nominal: float | None = None
    channel: str = ""
    lower: float | None = None
    upper: float | None = None


class StrengthEntry(Settings):
    """The parameter of the FMU that is the strength of an effect.

    Attributes:
        variable: Parameter of the unit; not with `releases`.
        name: Name in the verdict; without it, the last part of the variable.
        unit: Without it, that of the FMU.
        size: Natural size, one that is plausible.
        null: Value without the effect.
        lower: Least possible value; equal to `null` it is a sign rule: the other sign is never named.
        upper: Greatest possible value.
        scatter_sd: Standard deviation between runs, or between units under test.
        scatter_by: Condition with the number of the unit under test.
    """

    variable: str = ""
    name: Name | None = None
    unit: str = ""
    size: Positive
    null: float = 0.0
    lower: float | None = None
    upper: float | None = None
    scatter_sd: NotNegative = 0.0
    scatter_by: str = ""


class ShapeEntry(Quantity):
    """A further parameter of an effect.

    Attributes:
        prior_sd: Standard deviation of the nominal value.
        nominal: Value without other knowledge; without it, the start value of the unit.
        lower: Least possible value.
        upper: Greatest possible value.
        grid: Values to search where the effect is not smooth at its null, for example places of thresholds.
    """

    prior_sd: NotNegative
    nominal: float | None = None
    lower: float | None = None
    upper: float | None = None
    grid: tuple[float, ...] = ()


class EffectEntry(Settings):
    """A physical effect that may be missing; without it, its strength is null.

    Attributes:
        sentence: The physics.
        strength: Its size.
        shapes: Further parameters.
        place: Where it acts, for the page.
        claims: What it does to the readings, for the page.
        experiment: What separates it from others, for the page.
        source: Literature, for the page.
        releases: A base parameter instead of `strength.variable`: the effect is its error beyond its prior.
    """

    sentence: str
    strength: StrengthEntry
    shapes: dict[Name, ShapeEntry] = Field(default_factory=dict)
    place: str = ""
    claims: tuple[str, ...] = ()
    experiment: str = ""
    source: str = ""
    releases: str = ""


class UnitFile(Settings):
    """Names of quantities have letters, digits and `_`; they are columns of the data or names in the verdict.

    Attributes:
        fmu: The unit, relative to this file.
        name: Name of the model; without it, that of this file.
        step_s: Time between samples; without it, from the column `time [s]`.
        communication_step_s: Step of the unit; it must divide the time between the samples of each run.
            Without it, the step is halved until predictions move by less than a tenth of the sensor noise.
        held: Inputs keep their value until the next sample; false: straight lines between samples.
        reset: One instance is reset for each run; false: a new instance for each run.
        inputs: Series in the data that are inputs of the unit.
        conditions: Numbers that were set once per run: parameters of the unit.
        signals: Variables that the page compares the error with.
        channels: What is measured.
        parameters: Numbers that are known, more or less.
        run_parameters: Unknowns of each run.
        fixed: Parameters of the unit with another value than its start value, the same in every run.
        effects: What may be missing.
    """

    fmu: str
    name: str = ""
    step_s: Positive | None = None
    communication_step_s: Positive | None = None
    held: bool = True
    reset: bool = True
    inputs: dict[Name, Quantity] = Field(default_factory=dict)
    conditions: dict[Name, Quantity] = Field(default_factory=dict)
    signals: dict[Name, Quantity] = Field(default_factory=dict)
    channels: dict[Name, ChannelEntry]
    parameters: dict[Name, ParameterEntry] = Field(default_factory=dict)
    run_parameters: dict[Name, RunParameterEntry] = Field(default_factory=dict)
    fixed: dict[str, bool | int | float | str] = Field(default_factory=dict)
    effects: dict[Name, EffectEntry] = Field(default_factory=dict)


def read_unit_file(path: Path) -> UnitFile:
    """Read the file.

    Raises:
        ConfigError: It cannot be read, lacks a key, or has an unknown one.
    """
    table = read_toml(path, str(path), "give the TOML file of a functional mock-up unit")
    if "fmu" not in table and "base" in table:
        raise ConfigError(f"{path} is the result of an analysis: give it with --model")
    try:
        return UnitFile.model_validate(table)
    except ValidationError as error:
        raise ConfigError(f"{path}: {_words(direct_mistakes(error.errors())[0])}") from error


def _words(mistake: ErrorDetails) -> str:
    where = ".".join(str(part) for part in mistake["loc"] if part != "[key]")
    if mistake["type"] == "missing":
        return f"{where} is missing"
    if mistake["type"] == "extra_forbidden":
        return f"{where} is no key of this file"
    if mistake["type"] == "string_pattern_mismatch":
        return f"{where} is no name: use letters, digits and _"
    return f"{where}: {mistake['msg']}"
