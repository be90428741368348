"""All connections of a run with other programs, as operators."""

from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing, contextmanager

from drivers.clock import PacedClock
from rover_hil.config import Config
from rover_hil.connect.json_lines import JsonLines
from rover_hil.connect.ros2.connection import Ros2Connection
from rover_hil.run.executive import Operator
from rover_hil.run.operators import Operators


@contextmanager
def connected(
    config: Config,
    clock: PacedClock | None = None,
    odometry_to: str | None = None,
    others: tuple[Operator, ...] = (),
) -> Iterator[Operator | None]:
    """Connect a run as its configuration says; give its operator, or None where nobody operates it.

    Args:
        config: The rover.
        clock: The clock of a simulated run; None for a real rover.
        odometry_to: Where records are sent as JSON, `HOST:PORT`; None for nowhere.
        others: Further operators, the last of which counts most.

    Raises:
        ConfigError: A connection cannot be made.
    """
    sides: list[Operator] = []
    with ExitStack() as resources:
        if config.ros2 is not None:
            sides.append(resources.enter_context(Ros2Connection(config, _offset_of(clock))))
        if odometry_to is not None:
            sides.append(resources.enter_context(closing(JsonLines(odometry_to, config, _offset_of(clock)))))
        sides += others
        yield Operators(sides) if sides else None


def _offset_of(clock: PacedClock | None) -> Callable[[], int]:
    return (lambda: 0) if clock is None else (lambda: clock.offset_ns)
