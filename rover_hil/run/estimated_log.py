"""Make the estimate of a log that was imported without one, and write it as a log that has it."""

from collections.abc import Callable, Iterator
from pathlib import Path

from drivers.clock import seconds
from rover_hil.config import Config
from rover_hil.recording.data_files import collect_data_files
from rover_hil.recording.findings import FindingList
from rover_hil.recording.reader import LogMessage, LogReader
from rover_hil.recording.schema import CYCLE, ESTIMATE, IMPORT, OPERATOR, SET_POINT, TRUTH
from rover_hil.recording.writer import LogWriter
from rover_hil.run.recorded_cycles import DRIVEN
from rover_hil.run.replay import Replayer, ReplayResult

COPIED = frozenset({IMPORT, OPERATOR, SET_POINT, TRUTH})
"""What an import writes in addition to bytes, samples and cycles."""


def lacks_estimate(log: LogReader) -> bool:
    """Return whether a log was imported without an estimate: its first cycle has none.

    Raises:
        LogError: The log is damaged.
    """
    if log.origin in DRIVEN:
        return False
    for message in log.messages():
        if message.topic == ESTIMATE:
            return False
        if message.topic == CYCLE:
            return True
    return False


def write_estimated(
    log: LogReader, config: Config, out: Path, final_path: Path, on_cycle: Callable[[], None]
) -> ReplayResult:
    """Write the log `out`: all that a log without an estimate holds, and the estimate.

    Args:
        log: As `lacks_estimate` says.
        config: Its devices, with the controller that estimates.
        out: Must not exist.
        final_path: Its name in the end, for messages.
        on_cycle: Called after each cycle.

    Raises:
        LogError: The log is damaged, or holds a device that its configuration does not have; or `out` cannot
            be written.
    """
    config_json = config.model_dump_json(by_alias=True).encode()
    with LogWriter(
        out,
        log.start_ns,
        config_json,
        collect_data_files(config),
        log.origin,
        final_path=final_path,
        wall_start_ns=log.wall_offset_ns + log.start_ns,
    ) as writer:
        estimating = _Estimating(log, config, writer)
        for _ in estimating.cycles():
            on_cycle()
    return estimating.result


class _Estimating(Replayer):
    """Runs each cycle, and writes what it got and computed."""

    def __init__(self, log: LogReader, config: Config, writer: LogWriter) -> None:
        super().__init__(log, config, writer)
        self.result = ReplayResult(has_end=True)
        self._writer = writer
        self._findings = FindingList()
        self.result.findings, self.result.doubts = self._findings.found, self._findings.doubts

    def _messages(self) -> Iterator[LogMessage]:
        for message in super()._messages():
            if message.topic in COPIED:
                self._writer.write_json(message.topic, message.t_ns, message.json())
            yield message

    def _run_cycle(self, t_ns: int) -> None:
        rig, writer = self._rig, self._writer
        rig.clock.sleep_until(t_ns)
        samples = [*rig.poll(), *self._fixes]
        output = rig.loop.step(t_ns, samples)
        writer.samples(t_ns, samples)
        writer.estimate(output)
        writer.write_json(CYCLE, t_ns, {"late_ns": 0, "work_ns": 0})
        self._findings.take(seconds(t_ns - self._log.start_ns), output.findings or (), output.suspicion)
        self.result.cycles += 1
