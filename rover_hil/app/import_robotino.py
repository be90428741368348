"""`rover-hil import robotino`: a measured run becomes a log."""

from pathlib import Path

from rover_hil.config import load_config
from rover_hil.console.exit_codes import EXIT_OK
from rover_hil.console.steps import show_progress
from rover_hil.importing.robotino_csv import read_run
from rover_hil.importing.to_log import observing_config, write_run_as_log
from rover_hil.pages.atomic_write import check_file, unfinished
from rover_hil.terminal import Terminal


def import_run(
    file: Path, *, out: Path, millimetres_per_pixel: float, config_name: str, force: bool = False
) -> int:
    """Turn the measured run `file` into the log `out`; returns the exit code.

    Raises:
        ConfigError: The configuration is wrong, or `out` exists or cannot be written.
        LogError: The run cannot be read.
    """
    check_file(out, force=force)
    config = observing_config(load_config(config_name))
    run = read_run(file, millimetres_per_pixel)
    with unfinished(out) as part, show_progress() as progress:
        task = progress.add_task("importing", total=len(run.rows))
        for count in write_run_as_log(run, config, part):
            progress.update(task, completed=count)
    Terminal().print(f"{len(run.rows)} rows at {millimetres_per_pixel:g} mm per pixel: {out}", soft_wrap=True)
    return EXIT_OK
