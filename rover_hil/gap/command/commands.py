"""`rover-hil gap`: arguments, help and exit codes."""

from pathlib import Path
from typing import Annotated, Any

import typer

from drivers.errors import ConfigError
from rover_hil.console.options import (
    LONGEST_S,
    ClusterOption,
    ForceOption,
    JsonOption,
    number_option,
    out_option,
)
from rover_hil.console.output import tell
from rover_hil.gap.command.find import Shortening, check_effects, find_gap, named_model
from rover_hil.gap.command.rover import rover_subject

ModelArgument = Annotated[
    str,
    typer.Argument(
        help="`side-slope`, `single-wheel`, `robotino-motor`, `robotino-drive`, `four-wheel-drive`, or "
        "`file.py:factory` for a model of your own, `unit.toml` for a functional mock-up unit."
    ),
]
ExtendedOption = Annotated[
    Path | None, typer.Option("--model", help="The model.toml of an earlier analysis.")
]
ConfirmOption = Annotated[
    str, typer.Option(help="Runs to lock for the proof, like 'slope_deg >= 20' [default: drawn].")
]
CutOption = Annotated[
    float | None,
    number_option("Cut long records of a StateModel into runs of this many seconds.", "s", 1e-6, LONGEST_S),
]
WarmUpOption = Annotated[
    float,
    number_option(
        "Do not compare this many seconds at the start of each record of a StateModel or unit.",
        "s",
        0.0,
        LONGEST_S,
    ),
]
SeedOption = Annotated[int, number_option("Of all random numbers.", "", 0, 2**32 - 1)]


def _old(words: str, *spelling: str) -> Any:
    """Return an option of the version before, which works once more."""
    return typer.Option(*spelling, help=words, hidden=True)


def gap_find(
    model: ModelArgument,
    data: Annotated[list[Path] | None, typer.Argument(help="Measured runs: a folder, CSV or log.")] = None,
    config: Annotated[str | None, _old("Now `gap rover CONFIG LOGS`.")] = None,
    out: Annotated[Path | None, out_option("Folder for verdict, model, plan and report; required.")] = None,
    extended: ExtendedOption = None,
    confirm: ConfirmOption = "",
    cut: CutOption = None,
    warm_up: WarmUpOption = 0.0,
    allowed: Annotated[
        Path | None,
        typer.Option(help="TOML file of the runs that may be made next [default: like those measured]."),
    ] = None,
    check: Annotated[bool, _old("Now `gap check MODEL DATA`.", "--check")] = False,
    seed: SeedOption = 0,
    cluster: Annotated[str | None, _old("Now an option of `gap rover`.")] = None,
    force: ForceOption = False,
    as_json: JsonOption = False,
) -> int:
    """Compare a model with measured runs, name the effect that is missing, and prove it.

    `rover-hil gap side-slope measured/ --out gap` is the same. A model file is Python code, and it is run:
    use only files that you trust. So is a functional mock-up unit, which is native code and has your rights.

    Exit code 1: the data cannot be used; the verdict gives the reason, and nothing is written.

    Example: `rover-hil gap find side-slope measured/ --out gap`

    Data: `rover-hil sample slope` writes runs; of your own: docs/reference/gap_data.md names the columns.
    """
    shortening = Shortening(cut_s=cut, warm_up_s=warm_up)
    if config is None and len(data or ()) != 1:
        raise ConfigError("gap needs a model and one file or folder of measured runs")
    if config is not None and (check or allowed is not None or shortening != Shortening()):
        raise ConfigError("--check, --allowed, --cut and --warm-up are for a StateModel: leave out --config")
    if config is None and cluster is not None:
        raise ConfigError(
            "--cluster: the logs of `gap rover` are read there; the analysis of a model by its name is one "
            "computation: leave it out"
        )
    if check:
        tell("Note: this version still knows --check; write `rover-hil gap check MODEL DATA`.")
        return check_effects(model, (data or [])[0], as_json=as_json, shortening=shortening)
    if out is None:
        raise ConfigError("--out is missing: give a folder for verdict, model, plan and report")
    if config is not None:
        subject = rover_subject(config, [Path(model), *(data or ())], cluster)
        tell("Note: this version still knows --config; write `rover-hil gap rover CONFIG LOGS`.")
    else:
        subject = named_model(model, (data or [])[0])
    return find_gap(
        subject,
        out=out,
        extended=extended,
        confirm=confirm,
        seed=seed,
        force=force,
        as_json=as_json,
        shortening=shortening,
        allowed=allowed,
    )


def gap_rover(
    rover: Annotated[
        str,
        typer.Argument(
            help="Whose wheels are the model: a configuration, a file of columns, or the first log itself."
        ),
    ],
    drives: Annotated[
        list[Path] | None,
        typer.Argument(help="Logs of its drives, and folders of them; tables for a file of columns."),
    ] = None,
    *,
    out: Annotated[Path, out_option("Folder for verdict, model, plan and report.")],
    extended: ExtendedOption = None,
    confirm: ConfirmOption = "",
    seed: SeedOption = 0,
    cluster: ClusterOption = None,
    force: ForceOption = False,
    as_json: JsonOption = False,
) -> int:
    """Compare the wheels of a rover with its drives: radii, track, steering, marker, gyro, slip.

    A log knows its rover: `rover-hil gap rover drives --out gap`. Tables are converted as by `import table`.
    Exit code 1: the drives cannot be used; the verdict gives the reason, and nothing is written.

    Example: `rover-hil gap rover my_wheels.toml drives --out gap`

    Data: `rover-hil sample wheels` writes the configuration and its drives.
    """
    subject = rover_subject(rover, drives or (), cluster)
    return find_gap(
        subject, out=out, extended=extended, confirm=confirm, seed=seed, force=force, as_json=as_json
    )


def gap_check(
    model: Annotated[
        str, typer.Argument(help="`file.py:factory` of a StateModel, or `unit.toml` of a mock-up unit.")
    ],
    data: Annotated[Path, typer.Argument(help="Runs: a folder or CSV; their inputs are used.")],
    cut: CutOption = None,
    warm_up: WarmUpOption = 0.0,
    as_json: JsonOption = False,
) -> int:
    """Print what the inputs of the runs can show of each effect of a StateModel or a functional mock-up unit.

    Exit code 1: the data cannot be used, or an effect of the model changes no prediction of any run.

    Example: `rover-hil gap check my_machine.py:make axis.csv`

    docs/tutorials/gap.md writes such a model and its runs.
    """
    shortening = Shortening(cut_s=cut, warm_up_s=warm_up)
    return check_effects(model, data, as_json=as_json, shortening=shortening)
