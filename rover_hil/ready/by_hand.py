"""Record sensors while the user turns them: nothing is driven."""

from collections.abc import Callable, Sequence
from pathlib import Path

from drivers.clock import SystemClock, nanoseconds
from drivers.device_settings import FrameDeviceSettings
from drivers.driver import AnyDriver
from drivers.samples import Sample
from rover_hil.config import Config
from rover_hil.pages.atomic_write import unfinished
from rover_hil.recording.data_files import collect_data_files
from rover_hil.recording.writer import LogWriter
from rover_hil.run.end_signals import END_REQUEST
from rover_hil.terminal import Terminal

POLL_S = 0.02
CONNECT_TIMEOUT_S = 2.0


def record_by_hand(
    config: Config, names: Sequence[str], log_path: Path, limit_s: float, take: Callable[[list[Sample]], bool]
) -> None:
    """Record devices into a log until `take` says that it is enough, or ctrl-C.

    Args:
        config: The rover.
        names: The devices; cameras among them are left out.
        log_path: The log.
        limit_s: Longest time.
        take: Gets the samples of each poll; returns whether that is enough.

    Raises:
        NotConnectedError: A device cannot be opened.
    """
    clock = SystemClock()
    drivers: list[AnyDriver] = []
    with unfinished(log_path) as part:
        config_json = config.model_dump_json(by_alias=True).encode()
        files = collect_data_files(config)
        log = LogWriter(part, clock.now_ns(), config_json, files, "real", final_path=log_path)
        try:
            for name in names:
                settings = config.devices[name]
                if isinstance(settings, FrameDeviceSettings):
                    continue
                driver: AnyDriver = settings.make_driver(name, settings.make_link(clock), clock, log)
                drivers.append(driver)
                driver.connect(CONNECT_TIMEOUT_S)
            _listen(drivers, log, clock, limit_s, take)
        finally:
            for driver in drivers:
                driver.close()
            log.close()


def _listen(
    drivers: Sequence[AnyDriver],
    log: LogWriter,
    clock: SystemClock,
    limit_s: float,
    take: Callable[[list[Sample]], bool],
) -> None:
    now_ns = clock.now_ns()
    end_ns = now_ns + nanoseconds(limit_s)
    try:
        while now_ns < end_ns:
            samples: list[Sample] = [sample for driver in drivers for sample in driver.poll()]
            log.samples(now_ns, samples)
            if take(samples):
                return
            now_ns += nanoseconds(POLL_S)
            clock.sleep_until(now_ns)
            now_ns = clock.now_ns()
    except KeyboardInterrupt:
        END_REQUEST.answer()
        Terminal(stderr=True).print("ended by ctrl-C; using what was recorded")
