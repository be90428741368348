"""Who may move a real rover: the one place that decides it, for all commands."""

import sys

from drivers.device_settings import DriveSettings
from drivers.errors import ConfigError
from rover_hil.config import Config
from rover_hil.console.ask import ask_yes
from rover_hil.console.exit_codes import exit_unfinished
from rover_hil.run.drive_order import DriveOrder, port_of, rover_words


def order_drive(source: str, config: Config) -> DriveOrder:
    """Return the order of a command that is itself one: `run`, and the start on the page."""
    return DriveOrder(rover_words(source, config.devices))


def permit_drive(source: str, config: Config, *, virtual: bool, drive: bool) -> DriveOrder | None:
    """Return the order to move the real rover of a configuration; None for the simulated one.

    Without an option the user is asked, at a terminal only: a command that got no answer must not drive.

    Args:
        source: Name of the configuration.
        config: The configuration.
        virtual: `--virtual` was given.
        drive: `--drive` was given.

    Raises:
        ConfigError: Both options were given, or none and nobody sits at a terminal.
        SystemExit: The user did not confirm.
    """
    if virtual and drive:
        raise ConfigError("--virtual drives the simulated rover, --drive the real one: leave one out")
    if virtual:
        return None
    order = order_drive(source, config)
    if drive:
        return order
    if not sys.stdin.isatty():
        raise ConfigError(
            f"this would move {order.rover}: add --drive to allow it, or --virtual for the simulated rover"
        )
    if not ask_yes(f"This moves {order.rover}. Drive it?", default=False):
        exit_unfinished("not confirmed: nothing was driven")
    return order


def permit_turning(what: str, settings: DriveSettings, *, drive: bool) -> DriveOrder | None:
    """Ask whether the wheels of a drive may be turned one by one; None where not.

    Args:
        what: The drive, in words.
        settings: The drive.
        drive: `--drive` was given: the answer may come from a file.

    Raises:
        ConfigError: The answer is yes, and comes neither from a terminal nor with `--drive`.
    """
    order = DriveOrder(f"{what} at {port_of(settings)}")
    question = f"Are ALL wheels of {order.rover} lifted off the ground and free, and is nobody near them?"
    if not ask_yes(question, default=False):
        return None
    if not drive and not sys.stdin.isatty():
        raise ConfigError(f"this would turn the wheels of {order.rover}: add --drive to allow it")
    return order
