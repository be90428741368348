"""What the user allows for the next run, as a TOML file; by default only what was done before."""

import fnmatch
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, ValidationError, model_validator

from drivers.errors import ConfigError
from drivers.settings import Settings, read_toml
from sim_backends.models.interface import Machine, Run

Shape = Literal["repeat", "step", "ramp", "sine", "sweep", "multi_sine", "square"]
SHAPES: tuple[Shape, ...] = ("repeat", "step", "ramp", "sine", "sweep", "multi_sine", "square")
FIX = "see docs/reference/gap_verdict.md, Keys of allowed.toml"


class Range(Settings):
    """Limits of a number, both allowed."""

    low: float
    high: float

    @model_validator(mode="after")
    def _is_ordered(self) -> Self:
        if self.low > self.high:
            raise ValueError(f"low = {self.low:g} is above high = {self.high:g}")
        return self

    def holds(self, values: Iterable[float]) -> bool:
        """Return True where all values are inside."""
        found = np.asarray(list(values), dtype=np.float64)
        slack = 1e-9 * max(abs(self.low), abs(self.high))
        return bool(np.all((found >= self.low - slack) & (found <= self.high + slack)))


class InputRange(Range):
    """What an input may do.

    Attributes:
        shapes: Its shapes over time; `repeat` is the input of a measured run, also scaled.
        amplitudes: Of the shapes, in its unit; by default 15, 40 and 100 % of what the limits leave.
        period_s: Shortest and longest period of sine, sweep, multi-sine and square, s.
        rate: Greatest change in a second; None for no limit.
    """

    shapes: tuple[Shape, ...] = SHAPES
    amplitudes: tuple[Annotated[float, Field(gt=0.0)], ...] = ()
    period_s: tuple[Annotated[float, Field(gt=0.0)], Annotated[float, Field(gt=0.0)]] | None = None
    rate: Annotated[float, Field(gt=0.0)] | None = None


class Allowed(Settings):
    """Which runs may be made next; see `docs/reference/gap_verdict.md`.

    Attributes:
        inputs: Inputs that may be chosen, by name; the others are those of a measured run. Without any, the
            inputs of measured runs are repeated, also scaled within the range of all runs.
        starts: Ranges of run parameters that the experimenter sets (initial states).
        conditions: Ranges of conditions.
        channels: Ranges that the predicted channels must not leave.
        duration_s: Least and greatest duration, or one; by default those of the measured runs.
        forbidden: Measured runs that must not be repeated; names with * and ?.
    """

    inputs: Mapping[str, InputRange] = {}
    starts: Mapping[str, Range] = {}
    conditions: Mapping[str, Range] = {}
    channels: Mapping[str, Range] = {}
    duration_s: Annotated[tuple[Annotated[float, Field(gt=0.0)], ...], Field(max_length=2)] = ()
    forbidden: tuple[str, ...] = ()

    def may_repeat(self, run: Run) -> bool:
        """Return True for a measured run that may be made again."""
        return not any(fnmatch.fnmatchcase(run.name, pattern) for pattern in self.forbidden)

    def require_names(self, machine: Machine) -> None:
        """Check that every name exists in a machine.

        Raises:
            ConfigError: One does not.
        """
        known: dict[str, tuple[Sequence[str], Sequence[str]]] = {
            "inputs": (list(self.inputs), list(machine.inputs)),
            "starts": (list(self.starts), [one.name for one in machine.run_parameters]),
            "conditions": (list(self.conditions), list(machine.condition_units)),
            "channels": (list(self.channels), [one.name for one in machine.channels]),
        }
        for section, (names, existing) in known.items():
            for name in names:
                if name not in existing:
                    raise ConfigError(
                        f"allowed runs, [{section}.{name}]: model {machine.name} has no such name; there are "
                        f"{', '.join(existing) or 'none'}"
                    )


def read_allowed(path: Path) -> Allowed:
    """Return the content of a file of allowed runs.

    Raises:
        ConfigError: It cannot be read, or holds an unknown key or a wrong value.
    """
    table = read_toml(path, f"the allowed runs {path}", FIX)
    try:
        return Allowed.model_validate(table)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"]) or "file"
        raise ConfigError(f"{path}, {where}: {first['msg']}; {FIX}") from error
