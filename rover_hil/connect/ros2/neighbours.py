"""What other programs of ROS 2 send in the domain, seen by a process that is there for a moment."""

import multiprocessing
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool

from drivers.clock import SystemClock, nanoseconds
from drivers.errors import ConfigError
from rover_hil.config.ros2_settings import Ros2Settings


def find_neighbours(settings: Ros2Settings, listen_s: float) -> list[tuple[str, str]]:
    """Return topic and type, by their names in DDS, of each writer of another program.

    Args:
        settings: The section [ros2].
        listen_s: Duration of listening; programs on this computer are found within a second.

    Raises:
        ConfigError: Interface or domain cannot be used.
    """
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(1, mp_context=context) as pool:
        try:
            return pool.submit(_look, settings, listen_s).result()
        except BrokenProcessPool as error:
            raise ConfigError("ros2: the process that looked at the domain has ended") from error


def _look(settings: Ros2Settings, listen_s: float) -> list[tuple[str, str]]:
    # Imported here because of the library, which parses untrusted datagrams in C.
    from rover_hil.connect.ros2.node import Node

    node = Node(settings)
    writers = node.writers_of_others()
    clock = SystemClock()
    clock.sleep_until(clock.now_ns() + nanoseconds(listen_s))
    return writers.take()
