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
    """A variable of the unit; by default it has the name of the quantity, and its unit is that of the FMU."""

    variable: str = ""
    unit: str = ""


class ChannelEntry(Quantity):
    """What is measured."""

    sigma: NotNegative | None = None
    quantum: NotNegative = 0.0
    tolerance: NotNegative = 0.0


class ParameterEntry(Quantity):
    """A base parameter; nominal value and bounds are those of the FMU where they are left out."""

    prior_sd: NotNegative
    nominal: float | None = None
    lower: float | None = None
    upper: float | None = None
    meaning: str = ""
    scatter_sd: NotNegative = 0.0
    scatter_by: str = ""


class RunParameterEntry(Quantity):
    """An unknown of each run."""

    prior_sd: Positive
    nominal: float | None = None
    channel: str = ""
    lower: float | None = None
    upper: float | None = None


class StrengthEntry(Settings):
    """The parameter of the FMU that is the strength of an effect."""

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
    """A further parameter of an effect."""

    prior_sd: NotNegative
    nominal: float | None = None
    lower: float | None = None
    upper: float | None = None
    grid: tuple[float, ...] = ()


class EffectEntry(Settings):
    """A physical effect that may be missing; without it, its strength is null."""

    sentence: str
    strength: StrengthEntry
    shapes: dict[Name, ShapeEntry] = Field(default_factory=dict)
    place: str = ""
    claims: tuple[str, ...] = ()
    experiment: str = ""
    source: str = ""
    releases: str = ""


class UnitFile(Settings):
    """Content of the file; see docs/reference/gap_fmu.md."""

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
