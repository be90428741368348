"""`rover-hil` with a log that hangs, in the middle of a write, while a file `hang` is in the folder."""

from pathlib import Path

from mcap.writer import Writer

from benchmarks.safety.faults.process_cases import HANG_FILE
from drivers.clock import SystemClock, nanoseconds
from rover_hil.app.program import main

CLOCK = SystemClock()


add_message = Writer.add_message


def add_message_when_allowed(writer: Writer, channel: int, log_ns: int, data: bytes, t_ns: int) -> None:
    """Wait while the log hangs, then write."""
    while Path(HANG_FILE).exists():
        CLOCK.sleep_until(CLOCK.now_ns() + nanoseconds(0.01))
    add_message(writer, channel, log_ns, data, t_ns)


if __name__ == "__main__":
    Writer.add_message = add_message_when_allowed  # type: ignore[method-assign,assignment]
    main()
