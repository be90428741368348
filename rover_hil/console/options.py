"""What the commands share: groups, options, and ranges of numbers."""

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from drivers.errors import ConfigError, LogError
from rover_hil.console.exit_codes import exit_interrupted

JsonOption = Annotated[bool, typer.Option("--json", help="Print the result as JSON on standard output.")]
SHIPPED_CONFIGS = ("robotino", "robotino-camera", "el-dorado", "el-dorado-camera", "el-dorado-crab")


def _shipped_configs(incomplete: str) -> list[str]:
    """Return shipped configurations for the completion of the shell; it completes files itself."""
    return [name for name in SHIPPED_CONFIGS if name.startswith(incomplete)]


ConfigArgument = Annotated[
    str,
    typer.Argument(
        metavar="config",
        help="A TOML file, or a shipped configuration: `robotino`, `robotino-camera`, `el-dorado`, "
        "`el-dorado-camera`, `el-dorado-crab`.",
        autocompletion=_shipped_configs,
    ),
]
LogArgument = Annotated[
    Path,
    typer.Argument(metavar="log", help="A log written by `run` or `import`, or the folder of a run."),
]
DriveArgument = Annotated[
    Path, typer.Argument(help="A log written by `run`, or a CSV file; see docs/reference/scomp_files.md.")
]
PlantModelOption = Annotated[
    Path | None,
    typer.Option("--model", help="Give the simulated Robotino the effects in this model.toml of `gap`."),
]
VirtualOption = Annotated[bool, typer.Option("--virtual", help="Drive the simulated rover.")]
DriveOption = Annotated[
    bool, typer.Option("--drive", help="Drive the real rover without a question; needed without a terminal.")
]
ForceOption = Annotated[bool, typer.Option("--force", help="Overwrite earlier results.")]
RigOption = Annotated[
    Path | None,
    typer.Option(
        "--rig", help="Rig file, JSON, schema rear-camera-rig/1; a log holds that of its configuration."
    ),
]
ClusterOption = Annotated[
    str | None,
    typer.Option(
        help="Run on the workers of this Dask scheduler, e.g. tcp://192.168.1.5:8786.", metavar="ADDRESS"
    ),
]
LiveOption = Annotated[
    bool, typer.Option("--live", help="Also stream the records to Foxglove or Lichtblick on this computer.")
]
LIVE_PORT = 8765
"""The port that viewers propose."""
LONGEST_S = 1e6
LOG_SUFFIX = ".mcap"
LOG_NAME = f"run{LOG_SUFFIX}"
"""In the folder of a run."""


class Group(TyperGroup):
    """A group of commands: prints its help when called without one, and ends on ctrl-C with one sentence."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Return the arguments that are left, those of `--help` for none."""
        return super().parse_args(ctx, args or ["--help"])

    def invoke(self, ctx: Any) -> object:
        """Run the command."""
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt:
            exit_interrupted()


def check_inputs(*paths: Path) -> None:
    """Check that files or folders to be read exist.

    Raises:
        LogError: One does not.
    """
    for path in paths:
        if not path.exists():
            raise LogError(f"no file or folder {path}: correct the path; it starts at the current folder")


def log_at(path: Path) -> Path:
    """Return a log given by its path, or by the folder of its run."""
    return path / LOG_NAME if path.is_dir() else path


def out_option(words: str) -> Any:
    """Return the option that names where results go."""
    return typer.Option("--out", "-o", help=words)


def number_option(words: str, unit: str, lower: float, upper: float, *spelling: str) -> Any:
    """Return an option for a finite number within `lower` to `upper`, both included."""
    return typer.Option(*spelling, help=words, callback=_within(unit, lower, upper))


def _within(
    unit: str, lower: float, upper: float
) -> Callable[[typer.CallbackParam, float | None], float | None]:
    def check(parameter: typer.CallbackParam, value: float | None) -> float | None:
        if value is not None and not lower <= value <= upper:
            of_unit = f" {unit}" if unit else ""
            limits = f"{lower:g} .. {upper:g}{of_unit}"
            raise ConfigError(f"{parameter.opts[0]} is {value:g}{of_unit}, outside {limits}: correct it")
        return value

    return check


LivePortOption = Annotated[int, number_option("Port of --live on 127.0.0.1.", "", 1, 65535)]
