"""`rover-hil` with a log that hangs, in the middle of a write, while a file `hang` is in the folder."""

from pathlib import Path
from typing import Any

from benchmarks.safety.faults.process_cases import HANG_FILE, HUNG_FILE
from drivers.clock import SystemClock, nanoseconds
from rover_hil.app.program import main
from rover_hil.recording.chunked_file import ChunkedFile

CLOCK = SystemClock()


add_message = ChunkedFile.add_message


def add_message_when_allowed(file: ChunkedFile, *message: Any) -> None:
    """Wait while the log hangs, then write."""
    while Path(HANG_FILE).exists():
        Path(HUNG_FILE).touch()
        CLOCK.sleep_until(CLOCK.now_ns() + nanoseconds(0.01))
    add_message(file, *message)


if __name__ == "__main__":
    ChunkedFile.add_message = add_message_when_allowed  # type: ignore[method-assign,assignment]
    main()
