"""What the terrain commands compute with, and how they show what came out."""

import json
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Annotated, NamedTuple, TypeVar

from rich.progress import Progress

from drivers.errors import ConfigError
from drivers.files import read_text
from rover_hil.console.options import out_option
from rover_hil.pages.atomic_write import refuse_overwrite
from rover_hil.terminal import Terminal, progress_columns
from rover_hil.terrain.soil_files import load_terrain_soil
from rover_hil.terrain.table import Table
from sim_backends.terramechanics.slope.rover import SlopeRover, paper_rover
from sim_backends.terramechanics.soil.library import SoilSettings, load_wheel, parse_settings
from sim_backends.terramechanics.soil.numpy_kernel import numpy_kernel
from sim_backends.terramechanics.soil.wheel_contact import Kernel

ReportOption = Annotated[Path | None, out_option("Also write report.html and CSV into this folder.")]
PAPER_ROVER = "paper_001"
REPORT_NAME = "report.html"
COMPILE_FROM = 100
"""States from which compiled code saves more time than it takes to load."""
ItemT = TypeVar("ItemT")


class Choice(NamedTuple):
    """Names in the library, or paths of TOML files.

    Attributes:
        rover: `paper_001`, or a TOML file with the fields of `SlopeRover`.
        wheel: Instead of the rover's own; None keeps that.
        soil: Soil.
    """

    rover: str
    wheel: str | None
    soil: str

    def load(self) -> tuple[SlopeRover, SoilSettings]:
        """Return rover and soil; notes about the soil go to the standard error.

        Raises:
            ConfigError: No such rover, wheel or soil, not TOML, or a number outside its range.
        """
        rover = _load_rover(self.rover)
        if self.wheel is not None:
            rover = rover.model_copy(update={"wheel": load_wheel(self.wheel)})
        return rover, announced_soil(self.soil)

    def facts(self, rover: SlopeRover) -> list[tuple[str, str]]:
        """Return what the numbers hold for, as pairs of name and value."""
        radius, width = 1000.0 * rover.wheel.radius_m, 1000.0 * rover.wheel.width_m
        return [
            ("rover", f"{self.rover}, {len(rover.wheel_positions_m)} wheels"),
            ("centre of gravity", f"{1000.0 * rover.cog_height_m:g} mm over the surface"),
            ("wheel", f"{self.wheel or 'of the rover'}, radius {radius:g} mm, width {width:g} mm"),
            ("soil", "; ".join((self.soil, *load_terrain_soil(self.soil).notes))),
        ]


class Output(NamedTuple):
    """Where results go.

    Attributes:
        folder: For report and CSV; None writes none.
        as_json: Print JSON.
        force: Replace earlier results in the folder.
    """

    folder: Path | None
    as_json: bool
    force: bool = False

    def refuse_overwrite(self, *tables: str, others: Sequence[str] = ()) -> None:
        """Check, before anything is computed, that the folder holds no results of these names, unless forced.

        Args:
            tables: Names of tables, written as CSV beside the report.
            others: Names of further files.

        Raises:
            ConfigError: One exists.
        """
        if self.folder is not None:
            names = (REPORT_NAME, *(f"{table}.csv" for table in tables), *others)
            refuse_overwrite(*(self.folder / name for name in names), force=self.force)

    def show(self, tables: Sequence[Table], record: object) -> None:
        """Print the tables, or the record as JSON with numbers in full precision."""
        if self.as_json:
            print(json.dumps(record, indent=2, allow_nan=False))  # noqa: T201 - what a script reads
            return
        console = Terminal()
        for table in tables:
            console.print(table.rich())
            for note in table.notes():
                console.print(f"{note}\n", soft_wrap=True)
        if self.folder is not None:
            console.print(str(self.folder / REPORT_NAME), soft_wrap=True)


def choose_kernel(states: int) -> Kernel:
    """Return the kernel that is the faster for so many steady states; both give the same numbers.

    Says on standard error when code has to be compiled first.
    """
    if states < COMPILE_FROM:
        return numpy_kernel
    from sim_backends.terramechanics.soil.compiled import load_compiled

    return load_compiled(say)


def with_progress(items: Iterable[ItemT], count: int, what: str) -> list[ItemT]:
    """Return the items, with a bar on standard error while they are computed."""
    collected: list[ItemT] = []
    with _bar() as progress:
        task = progress.add_task(what, total=count)
        for item in items:
            collected.append(item)
            progress.advance(task)
    return collected


def waited_for(compute: Callable[[], ItemT], what: str) -> ItemT:
    """Return what is computed, with a bar on standard error while it runs."""
    with _bar() as progress:
        progress.add_task(what, total=None)
        return compute()


def _bar() -> Progress:
    console = Terminal(stderr=True)
    return Progress(*progress_columns(), console=console, transient=True, disable=not console.is_terminal)


def say(line: str) -> None:
    """Print a line on standard error."""
    Terminal(stderr=True, soft_wrap=True).print(line)


def announced_soil(name: str) -> SoilSettings:
    """Return a soil, see `load_terrain_soil`; notes about it go to the standard error.

    Raises:
        ConfigError: No such soil, not TOML, or a number outside its range.
    """
    terrain_soil = load_terrain_soil(name)
    for note in terrain_soil.notes:
        say(f"note: {note}")
    return terrain_soil.soil


def _load_rover(name: str) -> SlopeRover:
    if name == PAPER_ROVER:
        return paper_rover()
    if not name.endswith(".toml"):
        raise ConfigError(f"there is no rover '{name}'; give {PAPER_ROVER}, or the path of a .toml file.")
    try:
        text = read_text(Path(name))
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"{name}: cannot be read ({error}); give a readable TOML file.") from None
    return parse_settings(text, name, SlopeRover)
