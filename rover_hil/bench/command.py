"""`rover-hil bench`: a page to look at a rover and operate it."""

import secrets
from pathlib import Path
from typing import Annotated

from drivers.clock import PacedClock
from drivers.errors import ConfigError
from rover_hil.bench.views import RunOrder
from rover_hil.config import load_config
from rover_hil.connect.connections import connected
from rover_hil.console.exit_codes import EXIT_OK
from rover_hil.console.options import ConfigArgument, number_option, out_option
from rover_hil.report.write import write_report
from rover_hil.run.checks import CONNECTION_CHECKS, ROVER_CHECKS
from rover_hil.run.drive_order import rover_words
from rover_hil.run.drive_permission import order_drive
from rover_hil.run.driving import run_real, run_virtual
from rover_hil.run.executive import Operator, RunResult
from rover_hil.terminal import Terminal

TOKEN_BYTES = 16
NO_NICEGUI = "the page needs NiceGUI: install it with `pip install rover-hil[bench]`"


def serve_bench(
    config_name: ConfigArgument,
    port: Annotated[int, number_option("Port of the page; 0 for any free one.", "", 0, 65535)] = 8484,
    out: Annotated[Path, out_option("Folder of the runs.")] = Path("runs"),
) -> int:
    """Serve a page to start and stop runs, look at them, drive by hand and move gains, until ctrl-C.

    Only browsers on this computer reach it; docs/how-to/use_the_bench.md shows how over ssh.

    Example: `rover-hil bench robotino`, then open the address that it prints in a browser
    """
    config = load_config(config_name, (*ROVER_CHECKS, *CONNECTION_CHECKS))
    try:
        from rover_hil.bench.guard import QUERY_KEY
        from rover_hil.bench.server import bind, serve
    except ModuleNotFoundError as error:
        if error.name is None or not error.name.startswith(("nicegui", "fastapi", "uvicorn", "starlette")):
            raise
        raise ConfigError(NO_NICEGUI) from error
    from rover_hil.bench.session import Session

    listener = bind(port)
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigError(f"cannot make {out}: {error.strerror}; choose another --out") from error
    stem = Path(config_name).stem
    session = Session(config, out, stem, run_order, report_order)
    console = Terminal(soft_wrap=True)
    token = secrets.token_urlsafe(TOKEN_BYTES)
    console.print(f"page: http://localhost:{listener.getsockname()[1]}/?{QUERY_KEY}={token}")
    console.print(f"Real runs move {rover_words(config_name, config.devices)}.")
    console.print("End with ctrl-C; a run that goes on then is ended too.")
    try:
        serve(session, stem, listener, token)
    except KeyboardInterrupt:
        pass
    finally:
        session.close()
    return EXIT_OK


def run_order(order: RunOrder, operator: Operator, clock: PacedClock | None) -> RunResult:
    """Run what the page ordered, as `run` does; raises RoverHilError as `run_virtual` and `run_real`."""
    # The page comes last: of two who drive, the user on it counts.
    with connected(order.config, clock, others=(operator,)) as operators:
        if clock is not None:
            return run_virtual(
                order.config, order.log_path, order.limit_s, None, clock=clock, operator=operators
            )
        return run_real(
            order.config,
            order.log_path,
            order.limit_s,
            None,
            order=order_drive(order.source, order.config),
            operator=operators,
        )


def report_order(order: RunOrder) -> None:
    """Write the report of a run beside its log; raises RoverHilError as `write_report`."""
    write_report(order.log_path, order.log_path.parent)
