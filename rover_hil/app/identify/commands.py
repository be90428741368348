"""`rover-hil identify`: arguments, help and exit codes; heavy modules are imported inside the commands."""

import sys
from pathlib import Path
from typing import Annotated

import typer

from drivers.errors import ConfigError
from rover_hil.console.options import (
    ClusterOption,
    ForceOption,
    Group,
    JsonOption,
    out_option,
)
from rover_hil.run.end_signals import held_signals

identify_app = typer.Typer(cls=Group, help="Fit models from logs or measured data.")


@identify_app.command("slip")
def identify_slip(
    train: Annotated[list[Path], typer.Argument(help="Logs, measured CSV files or folders to learn from.")],
    test: Annotated[list[Path] | None, typer.Option(help="Logs, files or folders to test on.")] = None,
    out: Annotated[Path | None, out_option("Write the best map to this TOML file.")] = None,
    cluster: ClusterOption = None,
    force: ForceOption = False,
    json: JsonOption = False,
) -> None:
    """Fit slip maps, how much each wheel slips for the effort it takes, and compare them.

    Example: `rover-hil identify slip floors --test floors_test --out floors.toml`

    Data: `rover-hil sample floors` writes these folders; measured ones are in `datasets` of
    github.com/BrOleg5/research-wheel-slippage.
    """
    with held_signals():
        from rover_hil.app.identify.slip import identify_slip as identify

    sys.exit(identify(train, test=test or [], force=force, as_json=json, out=out, cluster=cluster))


@identify_app.command(
    "probe", hidden=True, context_settings={"allow_extra_args": True, "ignore_unknown_options": True}
)
def identify_probe() -> None:
    """Say what has replaced this command."""
    raise ConfigError(
        "`identify probe` was removed, the yaw excitation needs no fitted map: give mass_kg and "
        "body_radius_m of your rover in [slip.excitation], and run `rover-hil calibrate imu`"
    )


@identify_app.command("motor")
def identify_motor(
    logs: Annotated[list[Path], typer.Argument(help="Logs, measured CSV files or folders.")],
    out: Annotated[Path | None, out_option("Write the parameters to this TOML file.")] = None,
    cluster: ClusterOption = None,
    force: ForceOption = False,
    json: JsonOption = False,
) -> None:
    """Fit motor, friction and speed loop, with intervals, and list what the data cannot determine.

    Exit code 1: nothing was determined.

    Example: `rover-hil identify motor runs/first/run.mcap`

    Data: `rover-hil sample runs` writes such a log; a whole run is
    `rover-hil run robotino --virtual --out runs/first`.
    """
    with held_signals():
        from rover_hil.app.identify.motor import identify_motor as identify

    sys.exit(identify(logs, out=out, force=force, as_json=json, cluster=cluster))


@identify_app.command("scomp")
def identify_scomp(
    log: Annotated[
        Path, typer.Argument(help="A log written by `run`, or a CSV file; see docs/reference/scomp_files.md.")
    ],
    truth: Annotated[
        Path | None,
        typer.Option(help="CSV file with the true path: t_s, x_m, y_m, psi_rad. Default: that in the log."),
    ] = None,
    out: Annotated[
        Path | None, out_option("Write the parameters to this TOML file, not to standard output.")
    ] = None,
    pictures: Annotated[Path | None, typer.Option(help="Folder for pictures of the fit.")] = None,
    force: ForceOption = False,
    json: JsonOption = False,
) -> None:
    """Fit the slip-compensated odometry to a drive whose true path is known.

    Example: `rover-hil identify scomp drive.csv --truth tracker.csv --out sand.toml`

    Data: `rover-hil sample drive` writes these files; for your own drive and its tracked path,
    docs/reference/scomp_files.md names the columns.
    """
    with held_signals():
        from rover_hil.app.identify.scomp import identify_scomp as identify

    sys.exit(identify(log, truth=truth, out=out, pictures=pictures, force=force, as_json=json))
