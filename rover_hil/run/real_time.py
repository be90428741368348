"""Real-time scheduling for the loop."""

import gc
import os

from drivers.errors import ConfigError

PRIORITY = 50


def enter_realtime() -> None:
    """Put this process under SCHED_FIFO and stop the garbage collector from pausing it.

    Raises:
        ConfigError: The user has no right to do so.
    """
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
    except PermissionError as error:
        raise ConfigError(
            "--realtime needs the right to use SCHED_FIFO: add 'USER - rtprio 99' to "
            "/etc/security/limits.conf and log in again, or run without --realtime"
        ) from error
    gc.collect()
    gc.disable()
