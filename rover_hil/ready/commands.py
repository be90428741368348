"""`rover-hil calibrate`: each folder beside this file with a `calibration.py` is a command of its name.

A calibration is loaded when it runs, or when its own help is wanted: the list of them answers at once.
"""

import inspect
from collections.abc import Iterator, Mapping
from importlib import import_module
from pathlib import Path
from typing import Any

import typer
from typer.core import TyperCommand
from typer.main import get_command

from rover_hil.console.options import Group
from rover_hil.console.output import tell
from rover_hil.run.end_signals import held_signals

FOLDER = Path(__file__).parent
OLD_SPELLINGS = {
    "--motors": ("compass", "motors"),
    "--turns": ("imu", "mounting"),
    "--scale": ("camera", "scale"),
}
"""Options of a calibration that hid another one, for one version; `--turns` has a value and stays."""


class Calibrations(Mapping[str, Any]):
    """All calibrations as commands by name; each is loaded when it is taken."""

    def __getitem__(self, name: str) -> Any:
        """Return a calibration with its options.

        Raises:
            KeyError: There is none of this name.
        """
        if name not in set(self):
            raise KeyError(name)
        with held_signals():
            function = import_module(f"rover_hil.ready.{name}.calibration").calibrate
        alone = typer.Typer(add_completion=False)
        alone.command(name)(function)
        return get_command(alone)

    def __iter__(self) -> Iterator[str]:
        return iter(sorted(path.parent.name for path in FOLDER.glob("*/calibration.py")))

    def __len__(self) -> int:
        return len(list(iter(self)))


class CalibrationGroup(Group):
    """The group of all calibrations."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self.commands: Any = Calibrations()

    def list_commands(self, ctx: Any) -> list[str]:
        """Return their names."""
        return list(self.commands)

    def get_command(self, ctx: Any, cmd_name: str) -> TyperCommand | None:
        """Return a calibration by its name with its first line of help, without loading it."""
        if cmd_name not in self.list_commands(ctx):
            return None
        return TyperCommand(cmd_name, help=inspect.getdoc(import_module(f"rover_hil.ready.{cmd_name}")))

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Return name, command and arguments of the calibration to run."""
        name, command, remaining = super().resolve_command(ctx, _new_spelling(args))
        return name, command and self.commands[str(name)], remaining


def _new_spelling(arguments: list[str]) -> list[str]:
    """Return arguments with the name that a calibration has now; an old one is told."""
    for option, (old, new) in OLD_SPELLINGS.items():
        places = [
            place
            for place, text in enumerate(arguments)
            if text == option or (option == "--turns" and text.startswith("--turns="))
        ]
        if arguments[:1] == [old] and places:
            tell(f"`calibrate {old} {option}` is now `calibrate {new}`; the old spelling will go")
            kept = arguments[1:]
            if option != "--turns":
                kept = [text for text in kept if text != option]
            return [new, *kept]
    return arguments


calibrate_app = typer.Typer(cls=CalibrationGroup, help="Calibrate sensors.")
