"""`rover-hil identify scomp`: parameters of the slip-compensated odometry from a drive with known truth."""

import math
from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from controllers.slip.scomp.parameters import Provenance, RoverGeometry, ScompParameters
from drivers.clock import wall_time_text
from drivers.errors import ConfigError
from rover_hil.console.exit_codes import EXIT_OK
from rover_hil.console.json_text import print_json
from rover_hil.console.options import DriveArgument, ForceOption, JsonOption, out_option
from rover_hil.console.steps import show_progress
from rover_hil.drives.drive import read_drive
from rover_hil.drives.ground_truth import TruePoses
from rover_hil.identify.scomp.fit import Identification, identify
from rover_hil.identify.scomp.pictures import fit_pictures
from rover_hil.pages.atomic_write import check_file, refuse_overwrite, write_file, write_files
from rover_hil.scomp.drive import SensorRows, final_error_m
from rover_hil.scomp.files import (
    TRUTH,
    geometry_of,
    log_rows,
    log_truth,
    parameters_text,
    read_rows,
    read_truth,
)
from rover_hil.scomp.odometry import estimate_track
from rover_hil.terminal import Terminal


def identify_scomp(
    log: DriveArgument,
    *,
    truth: Annotated[
        Path | None,
        typer.Option(help="CSV file with the true path: t_s, x_m, y_m, yaw_rad. Default: that in the log."),
    ] = None,
    out: Annotated[
        Path | None, out_option("Write the parameters to this TOML file, not to standard output.")
    ] = None,
    pictures: Annotated[Path | None, typer.Option(help="Folder for pictures of the fit.")] = None,
    force: ForceOption = False,
    as_json: JsonOption = False,
) -> int:
    """Fit the slip-compensated odometry to a drive whose true path is known.

    Example: `rover-hil identify scomp drive.csv --truth tracker.csv --out sand.toml`

    Data: `rover-hil sample drive` writes these files; for your own drive and its tracked path,
    docs/reference/scomp_files.md names the columns.
    """
    check_file(out, force=force)
    if pictures is not None:
        refuse_overwrite(*pictures.glob("*.svg"), force=force, option="--pictures")
    rows, read_notes, rover, path = _read(log, truth)
    truth_name = path.source if truth is not None else f"{path.source} in {log.name}"
    with show_progress() as progress:
        task = progress.add_task("fitting", total=2)
        identification = identify(rows, path, rover)
        progress.advance(task)
        origin = Provenance(log=log.name, truth=truth_name, fitted_on=wall_time_text()[:8])
        parameters = identification.parameters.model_copy(update={"provenance": origin})
        result = estimate_track(rows, parameters)
    error_m = final_error_m(result.track, path)
    notes = [*read_notes, *identification.notes, *result.notes]
    if truth is None:
        notes.insert(0, f"truth: {truth_name}")
    if out is not None:
        write_file(out, parameters_text(parameters))
    if pictures is not None:
        write_files(pictures, fit_pictures(identification, result.track, path))
    if as_json:
        record = parameters.model_dump(mode="json", by_alias=True)
        fit = {"slip_rms": identification.slip_rms, "final_error_m": error_m}
        print_json({"parameters": record, **fit, "notes": notes})
    else:
        _print(identification, parameters, error_m, notes, is_written=out is not None)
    return EXIT_OK


def _read(log: Path, truth: Path | None) -> tuple[SensorRows, list[str], RoverGeometry, TruePoses]:
    """Return the readings of a drive, notes, the rover, and the true path."""
    if log.suffix == ".mcap":
        drive = read_drive(log, with_traces=True)
        path = log_truth(drive) if truth is None else read_truth(truth)
        return *log_rows(drive), geometry_of(drive.config, log), path
    rows = read_rows(log)
    if truth is None:
        raise ConfigError(
            f"{log} is a CSV file: give its true path with --truth, a CSV file with {', '.join(TRUTH)}"
        )
    return *rows, RoverGeometry(), read_truth(truth)


def _print(
    identification: Identification,
    parameters: ScompParameters,
    error_m: float,
    notes: list[str],
    *,
    is_written: bool,
) -> None:
    """Print the fit; without a file, the parameters go to standard output and the rest to the other one."""
    if not is_written:
        print(parameters_text(parameters), end="")  # noqa: T201 - the file itself
    console = Terminal(stderr=not is_written)
    law, pitch, roll, trace = parameters.two_segment_slip, parameters.pitch, parameters.roll, parameters.trace
    low, high = (math.degrees(angle) for angle in law.fit_range_rad)
    table = Table(title=f"{len(identification.windows.t_s)} windows of two seconds", title_justify="left")
    for name in ("parameter", "value", "accuracy"):
        table.add_column(name)
    table.add_row("c_rr", f"{pitch.rolling_resistance:.4f}", f"{pitch.rolling_resistance_sd:.4f}")
    table.add_row("C_x (N)", f"{pitch.model.c_x_n:.1f}", f"{100 * pitch.stiffness_sd:.0f} % for that c_rr")
    table.add_row(
        "two-segment slip s_x0, k (/rad), beta0 (deg)",
        f"{law.slip_0:.3f}, {law.k_per_rad:.3f}, {math.degrees(law.beta_0_rad):.1f}",
        f"rms {law.rms:.3f} over |beta| of {low:.0f} to {high:.0f} deg",
    )
    table.add_row("drift from roll, gain", f"{roll.gain:.2f}", f"{roll.gain_sd:.2f}")
    table.add_row("residual drift, rms (deg)", f"{math.degrees(roll.rest):.2f}", "")
    table.add_row(
        "trace noise (deg), memory (s)", f"{math.degrees(trace.noise_rad):.2f}, {trace.noise_time_s:.2f}", ""
    )
    table.add_row("rear axle b (m)", f"{parameters.rover.rear_axle_m:.3f}", "")
    console.print(table)
    if identification.slip_rms is not None:
        console.print(f"slip from pitch: rms {identification.slip_rms:.3f} over the windows")
    console.print(f"end of this drive with these parameters: {error_m:.3f} m off (a fit, no test)")
    for note in notes:
        console.print(f"note: {note}", soft_wrap=True)
