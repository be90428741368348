"""The `rover-hil` program: loads the commands in a way that ctrl-C ends even that with one sentence."""

from rover_hil.app.exit_codes import exit_interrupted


def main() -> None:
    """Load the commands and run the command line."""
    try:
        from rover_hil.app.app import main as run_command_line

        run_command_line()
    except KeyboardInterrupt:
        exit_interrupted()
