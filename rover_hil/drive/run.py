"""`rover-hil run`: put the rover together, run the loop, write log, summary and report."""

from pathlib import Path
from typing import Annotated

import typer

from rover_hil.console.exit_codes import EXIT_INTERRUPTED, EXIT_NO, EXIT_OK
from rover_hil.console.options import (
    LIVE_PORT,
    LOG_NAME,
    LONGEST_S,
    ConfigArgument,
    ForceOption,
    JsonOption,
    LiveOption,
    LivePortOption,
    PlantModelOption,
    number_option,
    out_option,
)


def run_rover(
    config_name: ConfigArgument,
    *,
    virtual: Annotated[
        bool,
        typer.Option(
            "--virtual",
            help="Drive the embedded simulated rover, in step with simulated time: no watchdog is needed.",
        ),
    ] = False,
    duration_s: Annotated[
        float | None,
        number_option(
            "End after this many seconds instead of with the mission.", "s", 0.1, LONGEST_S, "--duration"
        ),
    ] = None,
    out: Annotated[
        Path | None, out_option("Folder for log, summary and report [default: runs/NAME-DATE].")
    ] = None,
    realtime: Annotated[
        bool,
        typer.Option(
            "--realtime",
            help="Use the SCHED_FIFO scheduler; needs the right to. With --virtual: simulated time passes "
            "like real time, so that other programs can take part.",
        ),
    ] = False,
    model: PlantModelOption = None,
    live: LiveOption = False,
    live_port: LivePortOption = LIVE_PORT,
    odometry_to: Annotated[
        str | None,
        typer.Option(
            "--odometry-to",
            metavar="HOST:PORT",
            help="Send pose, velocity and state of each cycle there, as a line of JSON over UDP.",
        ),
    ] = None,
    force: ForceOption = False,
    as_json: JsonOption = False,
) -> int:
    """Run the loop, on real devices or on the simulated rover, and write log, summary and report.

    Exit code 1: the rover could not finish the mission, or drive until you or --duration ended the run.

    Example: `rover-hil run robotino --virtual`
    """
    # The help of this command needs none of these.
    import json

    from rich.live import Live

    from drivers.clock import PacedClock, wall_time_text
    from rover_hil.config import load_config
    from rover_hil.console.json_text import print_json_text
    from rover_hil.drive import run_surroundings as around
    from rover_hil.drive.check_manoeuvre import offer, permit_check_manoeuvre
    from rover_hil.pages.atomic_write import refuse_overwrite
    from rover_hil.report.write import REPORT_NAME, SUMMARY_NAME
    from rover_hil.run.checks import RUN_CHECKS, VIRTUAL_RUN_CHECKS
    from rover_hil.run.drive_permission import order_drive
    from rover_hil.run.driving import run_real, run_virtual
    from rover_hil.run.excitation import for_real_rover
    from rover_hil.terminal import Terminal

    config = load_config(config_name, VIRTUAL_RUN_CHECKS if virtual else RUN_CHECKS)
    messages = Terminal(stderr=True)
    if model is not None:
        config = around.extended(config, model, messages, virtual=virtual)
    config, note = (config, "") if virtual else for_real_rover(config)
    folder = out or Path("runs") / f"{Path(config_name).stem}-{wall_time_text()}"
    log_path = folder / LOG_NAME
    reports = [folder / name for name in (SUMMARY_NAME, REPORT_NAME)]
    refuse_overwrite(log_path, *reports, force=force)
    wanted = config
    config, manoeuvre = permit_check_manoeuvre(config, virtual=virtual)
    limit_s = duration_s or config.loop.time_limit_s
    clock = PacedClock() if virtual and realtime else None
    connection = around.connection(config, clock, messages, odometry_to, is_paced=realtime or not virtual)
    with (
        around.live_mirror(live_port if live else None, messages) as mirror,
        connection as operator,
        Live(console=messages, transient=True, auto_refresh=False) as display,
    ):
        show = around.display(display, messages, config, manoeuvre, note)

        try:
            if virtual:
                result = run_virtual(
                    config,
                    log_path,
                    limit_s,
                    show,
                    mirror,
                    clock=clock,
                    operator=operator,
                    check_manoeuvre=True,
                )
            else:
                order = order_drive(config_name, config)
                result = run_real(
                    config,
                    log_path,
                    limit_s,
                    show,
                    order=order,
                    realtime=realtime,
                    mirror=mirror,
                    operator=operator,
                    check_manoeuvre=True,
                )
        except KeyboardInterrupt:
            if not log_path.exists():
                raise
            messages.print(
                f"interrupted: the drive was commanded to stop; the log so far is {log_path}", soft_wrap=True
            )
            return EXIT_INTERRUPTED
        except Exception as error:
            raise around.without_memory(error, "the drive was commanded to stop", log_path, folder) from error
    for path in reports:
        path.unlink(missing_ok=True)
    summary_json = around.report(log_path, folder, messages)
    if summary_json is None:
        return EXIT_INTERRUPTED
    summary = json.loads(summary_json)
    stops = len(summary["stops"])
    if as_json:
        print_json_text(summary_json)
    else:
        Terminal(soft_wrap=True).print(around.end_text(result, folder, summary))
    if offered := offer(wanted, stops):
        messages.print(offered, soft_wrap=True)
    around.tell_slowness(result, config.loop.rate_hz, messages, virtual=virtual)
    return EXIT_OK if around.went_well(result, duration_s) else EXIT_NO
