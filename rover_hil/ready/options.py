"""The options that calibrations share, each declared once, and the decorator that gives them to a command."""

from collections.abc import Callable
from inspect import Parameter, Signature, signature
from pathlib import Path
from typing import Annotated, Any

import typer

from rover_hil.console.options import (
    ConfigArgument,
    DriveOption,
    ForceOption,
    JsonOption,
    VirtualOption,
    out_option,
)
from rover_hil.ready.procedure import Procedure, Request, run

DeviceOption = Annotated[str | None, typer.Option(help="The sensor, where there are several.")]
OptionalOutOption = Annotated[
    Path | None,
    out_option("File to write, TOML; page and log beside it have its name [default: CONFIG-DEVICE.toml]."),
]
OPTIONS: dict[str, tuple[Any, Any]] = {
    "config": (ConfigArgument, Parameter.empty),
    "config_unless_logs": (
        Annotated[
            str,
            typer.Argument(
                help="Configuration whose rover is to move; none for logs, which know their rover.",
                metavar="CONFIG",
                show_default=False,
            ),
        ],
        "",
    ),
    "source": (
        Annotated[str, typer.Argument(help="Configuration whose rover is to move, or a log (.mcap).")],
        Parameter.empty,
    ),
    "log": (
        Annotated[Path | None, typer.Option(help="Use this log of a drive instead of driving.")],
        None,
    ),
    "virtual": (VirtualOption, False),
    "drive": (DriveOption, False),
    "by_hand": (
        Annotated[
            bool,
            typer.Option("--by-hand", help="Drive nothing; you turn the rover, or carry the sensor around."),
        ],
        False,
    ),
    "out": (
        Annotated[Path, out_option("File to write, TOML; page and logs beside it have its name.")],
        Parameter.empty,
    ),
    "enter": (
        Annotated[
            bool, typer.Option("--enter", help="Enter the result into the configuration; comments stay.")
        ],
        False,
    ),
    "as_json": (JsonOption, False),
    "force": (ForceOption, False),
}
"""Annotation and default of each, in the order of the help."""
CONFIGS = ("config", "config_unless_logs")
"""Options that name the source of a procedure by a configuration."""


def command(*shared: str) -> Callable[[Callable[..., Procedure[Any, Any]]], Callable[..., int]]:
    """Return the decorator of a function that makes a procedure from the options that are its own.

    The command has these, the `shared` ones, --json and --force. Its own option may replace a shared one of
    the same name.

    Args:
        shared: Names in `OPTIONS`.
    """

    def decorate(function: Callable[..., Procedure[Any, Any]]) -> Callable[..., int]:
        own = signature(function).parameters
        names = [name for name in OPTIONS if name in (*shared, "as_json", "force") and name not in own]

        def run_command(**options: Any) -> int:
            for name in CONFIGS:
                if name in options:
                    options["source"] = options.pop(name)
            wanted = (*names, "source", "out")
            request = {name: value for name, value in options.items() if name in wanted}
            procedure = function(**{name: options[name] for name in own})
            return run(procedure, Request(**request))

        parameters = {
            **{name: parameter.replace(kind=Parameter.KEYWORD_ONLY) for name, parameter in own.items()},
            **{
                name: Parameter(name, Parameter.KEYWORD_ONLY, annotation=kind, default=default)
                for name, (kind, default) in OPTIONS.items()
                if name in names
            },
        }
        first = [name for name in (*CONFIGS, "source") if name in parameters]
        order = dict.fromkeys((*first, *parameters))
        run_command.__signature__ = Signature([parameters[name] for name in order])  # type: ignore[attr-defined]
        run_command.__annotations__ = {name: parameters[name].annotation for name in order}
        run_command.__doc__ = function.__doc__
        return run_command

    return decorate
