"""Groups of commands that stand where they work: each is loaded when it runs, or when its own help is wanted.

The list of commands answers at once: of a command that only is listed the source is read, not its libraries.
"""

import ast
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import wraps
from importlib import import_module
from pathlib import Path
from typing import Any, ClassVar, Literal, NamedTuple, TypeAlias

import typer
from typer.core import TyperCommand
from typer.main import get_command

from rover_hil.console.options import Group
from rover_hil.run.end_signals import held_signals

ROOT = Path(__file__).parents[2]
MARKUP: Literal["markdown"] = "markdown"
"""Of all help; in the other, a text between square brackets would be left out."""


class Place(NamedTuple):
    """Where a command stands.

    Attributes:
        module: Name of the module.
        function: Name of the function in it; its parameters are the options, its text is the help, and it
            returns the exit code.
    """

    module: str
    function: str

    def summary(self) -> str:
        """Return the first line of the help, without loading the module."""
        path = ROOT.joinpath(*self.module.split(".")).with_suffix(".py")
        for node in ast.parse(path.read_text("utf-8")).body:
            if isinstance(node, ast.FunctionDef) and node.name == self.function:
                return (ast.get_docstring(node) or "").partition("\n")[0]
        return ""

    def load(self, name: str) -> Any:
        """Return the command with its options."""
        with held_signals():
            function = getattr(import_module(self.module), self.function)
        alone = typer.Typer(add_completion=False, rich_markup_mode=MARKUP)
        alone.command(name)(_exiting(function))
        return get_command(alone)


class Room(NamedTuple):
    """A group of commands.

    Attributes:
        summary: What `--help` says of it.
        places: Its commands by name.
        has_default: The name of the first one may be left out.
    """

    summary: str
    places: Mapping[str, Place]
    has_default: bool = False


Entries: TypeAlias = Mapping[str, Place | Room]


class Commands(Mapping[str, Any]):
    """Commands and groups by name; each is loaded when it is taken."""

    def __init__(self, entries: Entries) -> None:
        self._entries = entries

    def __getitem__(self, name: str) -> Any:
        """Return a command with its options, or a group.

        Raises:
            KeyError: There is none of this name.
        """
        entry = self._entries[name]
        return _group_of(name, entry) if isinstance(entry, Room) else entry.load(name)

    def __iter__(self) -> Iterator[str]:
        return iter(self._entries)

    def __len__(self) -> int:
        return len(self._entries)

    def listed(self, name: str) -> Any:
        """Return a group, or a command that is not loaded yet; None where there is none of this name."""
        entry = self._entries.get(name)
        if entry is None:
            return None
        return _group_of(name, entry) if isinstance(entry, Room) else ListedCommand(name, entry)


class ListedCommand(TyperCommand):
    """A command that is loaded once it has arguments."""

    def __init__(self, name: str, place: Place) -> None:
        super().__init__(name, help=place.summary(), rich_markup_mode=MARKUP)
        self._place = place

    def make_context(
        self, info_name: str | None, args: list[str], parent: Any = None, **settings: Any
    ) -> Any:
        """Return the context of the command itself."""
        return self._place.load(str(self.name)).make_context(info_name, args, parent, **settings)


class LazyGroup(Group):
    """A group whose commands are loaded when they run; the first may be left out where `has_default` says so.

    A group with a default takes all arguments that begin with no command.
    """

    entries: ClassVar[Entries] = {}
    has_default: ClassVar[bool] = False

    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings)
        self.lazy = Commands(self.entries)
        self.commands: Any = self.lazy

    def list_commands(self, ctx: Any) -> list[str]:
        """Return the names of its commands."""
        return list(self.entries)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Return a command by its name, without loading it."""
        return self.lazy.listed(cmd_name)

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Return the arguments, with the first command where none is named."""
        return super().parse_args(ctx, self.completed(args))

    def completed(self, arguments: Sequence[str]) -> list[str]:
        """Return arguments with the name of the command that may be left out."""
        if self.has_default and arguments and arguments[0] not in (*self.entries, "--help"):
            return [next(iter(self.entries)), *arguments]
        return list(arguments)


def _group_of(name: str, room: Room) -> LazyGroup:
    kind = type("RoomGroup", (LazyGroup,), {"entries": room.places, "has_default": room.has_default})
    group: LazyGroup = kind(name=name, help=room.summary, rich_markup_mode=MARKUP)
    return group


def _exiting(function: Callable[..., int]) -> Callable[..., None]:
    @wraps(function)
    def run(**options: Any) -> None:
        sys.exit(function(**options))

    return run
