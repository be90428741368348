"""The `rover-hil` program: loads the commands in a way that ctrl-C ends even that with one sentence."""

import signal
from types import FrameType

from rover_hil.app.exit_codes import exit_interrupted, exit_terminated


def main() -> None:
    """Load the commands and run the command line.

    SIGTERM ends a command like an error, so that its temporary files are removed.
    """

    def on_terminate(number: int, frame: FrameType | None) -> None:
        exit_terminated()

    signal.signal(signal.SIGTERM, on_terminate)
    try:
        from rover_hil.app.app import main as run_command_line

        run_command_line()
    except KeyboardInterrupt:
        exit_interrupted()
