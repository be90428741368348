"""`rover-hil bench` with an event loop that measures its longest work: `python -m ... OUT bench CONFIG ...`.

The work between two waits counts as processor time of the thread of the event loop: a loaded machine changes
nothing.
"""

import asyncio
import json
import resource
import selectors
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import uvicorn


class TimedSelector(selectors.DefaultSelector):
    """Reports how much the thread has computed between two waits.

    Attributes:
        works_ms: Each work of more than 5 ms.
    """

    def __init__(self) -> None:
        super().__init__()
        self.works_ms: list[float] = []
        self._begun_s: float | None = None

    def select(self, timeout: float | None = None) -> Any:
        """Wait."""
        if self._begun_s is not None:
            work_ms = 1000 * (_computed_s() - self._begun_s)
            if work_ms > 5.0:
                self.works_ms.append(work_ms)
        ready = super().select(timeout)
        self._begun_s = _computed_s()
        return ready


def _computed_s() -> float:
    usage = resource.getrusage(resource.RUSAGE_THREAD)
    return usage.ru_utime + usage.ru_stime


def main() -> None:
    from rover_hil.app.program import main as run_program

    out = Path(sys.argv.pop(1))
    selector = TimedSelector()

    def factory(config: object) -> Callable[[], asyncio.AbstractEventLoop]:
        return lambda: asyncio.SelectorEventLoop(selector)

    uvicorn.Config.get_loop_factory = factory  # type: ignore[method-assign, assignment]
    try:
        run_program()
    finally:
        out.write_text(json.dumps(selector.works_ms))


if __name__ == "__main__":
    main()
