"""The `rover-hil` program: loads the commands in a way that a signal ends even that with one sentence."""

from rover_hil.console.exit_codes import exit_interrupted, exit_terminated
from rover_hil.run.end_signals import Terminated, held_signals, take_signals


def main() -> None:
    """Load the commands and run the command line.

    A signal ends a command like an error, so that its temporary files are removed.
    """
    try:
        take_signals()
        with held_signals():
            from rover_hil.app.app import main as run_command_line

        run_command_line()
    except KeyboardInterrupt:
        exit_interrupted()
    except Terminated as end:
        exit_terminated(str(end))
