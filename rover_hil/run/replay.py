"""Run a log again with the same raw bytes at the same times.

Either as it was, to compare estimates and commands; or with other parameters, to see their estimates.
"""

import json
import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from typing import TypeVar

from controllers.control_loop import StepOutput
from controllers.estimation.filter.pose_filter import PoseFilter
from controllers.motion.kinematics import make_kinematics
from controllers.operator import OperatorInput
from drivers.clock import VirtualClock, seconds
from drivers.errors import LogError
from drivers.link import CameraImage, LinkChange, NoTap, RawTap, Received
from drivers.samples import PoseFixSample, Sample, WheelCommand
from rover_hil.config import Config
from rover_hil.recording.findings import FindingList, FoundFinding
from rover_hil.recording.images import decode_image
from rover_hil.recording.reader import LogMessage, LogReader
from rover_hil.recording.schema import (
    COMMAND,
    COMMAND_SHAPE,
    END,
    END_SHAPE,
    ESTIMATE,
    LINK_SHAPE,
    OPERATOR_SHAPE,
    SENT,
    EndRecord,
)
from rover_hil.recording.text import command_text, estimate_text, samples_text
from rover_hil.run.composition import build_replay_rig
from rover_hil.run.executive import End, end_by_controller, end_by_time
from rover_hil.run.recorded_cycles import DRIVEN, RecordedCycles
from rover_hil.run.replay_link import ReplayLink

PayloadT = TypeVar("PayloadT", bytes, CameraImage)
NO_TAP = NoTap()


@dataclass(slots=True)
class Difference:
    """One field that differs from the log.

    Attributes:
        count: In how many cycles.
        first_t_ns: When for the first time.
        largest: Largest distance between the two, where both are numbers; else None.
        recorded: Value in the log, the last time.
        replayed: Value in the replay, the last time.
    """

    field: str
    first_t_ns: int
    count: int = 0
    largest: float | None = None
    recorded: object = None
    replayed: object = None

    def note(self, recorded: object, replayed: object) -> None:
        """Add one more cycle."""
        self.count += 1
        self.recorded, self.replayed = recorded, replayed
        if isinstance(recorded, int | float) and isinstance(replayed, int | float):
            self.largest = max(self.largest or 0.0, abs(replayed - recorded))


@dataclass(slots=True)
class ReplayResult:
    """Outcome of a replay.

    Attributes:
        cycles: How many were run.
        by_field: The differences by name of the field.
        has_end: Whether the log says how the run ended, or is of a run that was imported.
        findings: What the rules find wrong with the drive.
        doubts: What widens the estimate although it may happen to a healthy rover.
    """

    cycles: int = 0
    by_field: dict[str, Difference] = field(default_factory=dict)
    has_end: bool = False
    findings: list[FoundFinding] = field(default_factory=list)
    doubts: list[FoundFinding] = field(default_factory=list)

    @property
    def differences(self) -> list[Difference]:
        """The differences in the order of first occurrence."""
        return list(self.by_field.values())

    def note(self, t_ns: int, name: str, recorded: object, replayed: object) -> None:
        """Add one difference."""
        self.by_field.setdefault(name, Difference(name, t_ns)).note(recorded, replayed)


def replay(log: LogReader, config: Config, on_cycle: Callable[[], None]) -> ReplayResult:
    """Replay a log and compare every output; `on_cycle` is called after each cycle.

    Raises:
        LogError: The log is damaged, lacks cycles, or holds a device that its configuration does not have.
    """
    replayer = _Comparer(log, config)
    for _ in replayer.cycles():
        on_cycle()
    replayer.finish(is_complete=log.is_complete)
    return replayer.result


def estimate_again(
    log: LogReader,
    config: Config,
    is_used: Callable[[Sample], bool] = lambda _: True,
    take_filter: Callable[[PoseFilter], None] = lambda _: None,
) -> Iterator[StepOutput]:
    """Yield what each cycle of a log would have computed with other parameters.

    The rover moves as in the log: the setpoints that the estimator knows are those of the log, not those
    that the other parameters would have given.

    Args:
        log: The log.
        config: Its devices, with the other parameters.
        is_used: Says of each sample whether the controller gets it.
        take_filter: Gets the filter before the first cycle, for what its estimates do not contain.

    Raises:
        LogError: The log is damaged, or holds a device that its configuration does not have.
    """
    replayer = _Estimates(log, config, is_used)
    take_filter(replayer.pose_filter)
    for _ in replayer.cycles():
        if replayer.output is not None:
            yield replayer.output


class Replayer(ABC):
    """Collects the messages of one cycle, then runs it.

    Args:
        log: The log.
        config: Its devices, and the controller.
        tap: Gets what the devices send, again.
    """

    def __init__(self, log: LogReader, config: Config, tap: RawTap = NO_TAP) -> None:
        self._log = log
        self._rig, self._links = build_replay_rig(config, VirtualClock(log.start_ns), tap)
        self._drive_link = self._links.bytes_links[self._rig.drive.name]
        self._expected: dict[str, LogMessage] = {}
        self._expected_sent: list[LogMessage] = []
        self._stops_ns: list[int] = []
        self._end: LogMessage | None = None
        self._fixes: tuple[PoseFixSample, ...] = ()
        self._recorded = RecordedCycles(log, config.loop.rate_hz)

    def cycles(self) -> Iterator[int]:
        """Run all cycles of the log; yield the time of each.

        Raises:
            LogError: The log is damaged, lacks cycles, or has a device that the configuration does not have.
        """
        self._rig.connect(timeout_s=0.0)
        for message in self._messages():
            kind, _, device = message.topic[1:].partition("/")
            if device:
                self._feed(kind, device, message)
            elif kind == "cycle":
                self._recorded.take(message)
                self._operate(message.t_ns)
                self._run_cycle(message.t_ns)
                self._expected.clear()
                self._drive_link.sent.clear()
                self._drive_link.outcomes.clear()
                yield message.t_ns
            elif kind == "watchdog":
                self._stops_ns.append(message.t_ns)
            elif message.topic == END:
                self._end = message
            else:
                self._expected[kind] = message

    def _messages(self) -> Iterator[LogMessage]:
        """Yield the messages of the log in the order in which they are run."""
        return _in_order(self._log.messages())

    @abstractmethod
    def _run_cycle(self, t_ns: int) -> None:
        """Run one cycle."""

    def _feed(self, kind: str, device: str, message: LogMessage) -> None:
        if kind in ("sent", "unsent"):
            self._expected_sent.append(message)
        elif device in self._links.image_links:
            image = decode_image(message.data) if kind == "raw" else _link_change(message, self._log)
            _feed_link(self._links.image_links[device], message.t_ns, image)
        elif device in self._links.bytes_links:
            payload = message.data if kind == "raw" else _link_change(message, self._log)
            _feed_link(self._links.bytes_links[device], message.t_ns, payload)
        else:
            raise LogError(f"the log holds data of a device '{device}' that its configuration does not have")

    def _operate(self, t_ns: int) -> None:
        log = self._log
        self._fixes = ()
        message = self._expected.pop("operator", None)
        if message is None:
            return
        record = log.parse(message, OPERATOR_SHAPE)
        motion = record["motion"]
        if motion is not None and len(motion) != 3:
            raise LogError(f"{log.path} is damaged: {message.topic} at {t_ns} ns: a motion has three numbers")
        self._fixes = tuple(PoseFixSample(**fix) for fix in record.get("fixes", ()))
        self._rig.loop.operate(
            t_ns,
            OperatorInput(
                is_paused=record["is_paused"],
                motion=None if motion is None else (motion[0], motion[1], motion[2]),
                gains=record["gains"],
                stop_reason=record.get("stop_reason"),
                is_confirmed=record.get("is_confirmed", False),
            ),
        )

    def _prepare_drive(self, until_ns: int) -> list[bytes]:
        """Stop the drive as the watchdog did before `until_ns`; return what was sent until then.

        The watchdog may have stopped the drive while a cycle was being logged. By its time that stop belongs
        to the next cycle.
        """
        # By time, because loop and watchdog log what they have sent afterwards, each on its own.
        sent = sorted(self._expected_sent, key=lambda message: message.t_ns)
        due = [message for message in sent if message.t_ns <= until_ns]
        self._expected_sent = sent[len(due) :]
        self._drive_link.outcomes.extend(message.topic.startswith(SENT) for message in due)
        while self._stops_ns and self._stops_ns[0] <= until_ns:
            del self._stops_ns[0]
            self._rig.drive.stop()
        return [message.data for message in due]


class _Comparer(Replayer):
    """Runs each cycle as it was, and compares."""

    def __init__(self, log: LogReader, config: Config) -> None:
        super().__init__(log, config)
        self.result = ReplayResult()
        self._has_commanded = False
        self._findings = FindingList()
        self.result.findings, self.result.doubts = self._findings.found, self._findings.doubts
        self._output: StepOutput | None = None

    def _run_cycle(self, t_ns: int) -> None:
        rig = self._rig
        rig.clock.sleep_until(t_ns)
        samples = [*rig.poll(), *self._fixes]
        output = self._output = rig.loop.step(t_ns, samples)
        self._findings.take(seconds(t_ns - self._log.start_ns), output.findings or (), output.suspicion)
        self._compare("samples", t_ns, samples_text(samples))
        self._compare("estimate", t_ns, estimate_text(output))
        command = self._expected.get("command")
        if command is not None:
            recorded_sent = self._prepare_drive(command.t_ns)
            rig.clock.sleep_until(command.t_ns)
            self._compare("command", t_ns, command_text(rig.drive.command(output.command)))
            self._compare_sent(t_ns, recorded_sent, "sent bytes")
            self._has_commanded = True
        elif self._log.origin in DRIVEN:
            self.result.note(t_ns, COMMAND[1:], None, list(output.command.speed_rad_s))
        self.result.cycles += 1

    def finish(self, *, is_complete: bool) -> None:
        """Compare how the run ended, and the stop after the last cycle, where the run was not killed.

        A log that was cut off may end anywhere in the stop, and a run that was interrupted twice in the
        middle of a cycle: there the stop is not compared.

        Raises:
            LogError: The log holds fewer cycles than its end counts.
        """
        self._compare_end()
        if not is_complete or not self._has_commanded or self._expected.keys() & {"samples", "estimate"}:
            return
        stop_ns = max((message.t_ns for message in self._expected_sent), default=0)
        recorded = self._prepare_drive(max(stop_ns, *self._stops_ns, self._rig.clock.now_ns()))
        self._rig.clock.sleep_until(stop_ns)
        self._rig.drive.stop()
        self._compare_sent(self._rig.clock.now_ns(), recorded, "bytes of the final stop")

    def _compare_end(self) -> None:
        self.result.has_end = self._end is not None or self._log.origin not in DRIVEN
        if self._end is None or self._output is None:
            return
        recorded = self._log.parse(self._end, END_SHAPE)
        if recorded["cycles"] > self.result.cycles:
            raise LogError(
                f"log {self._log.path} is damaged: its run had {recorded['cycles']} cycles, "
                f"the log holds {self.result.cycles}"
            )
        for name, was, now in _unequal_fields(
            END[1:], dict(recorded), self._end_again(recorded, self._output)
        ):
            self.result.note(self._end.t_ns, name, was, now)

    def _end_again(self, recorded: EndRecord, last: StepOutput) -> dict[str, object]:
        """Return the record of the end as the replayed cycles give it.

        What came from outside is taken from the log: a stop by the user, an emergency stop on the page, a
        signal, a device that failed, how often the watchdog stopped the drive.
        """
        ended = end_by_controller(last)
        if ended is None and recorded["end"] == End.TIME_OVER:
            ended = end_by_time(last)
        end, reason = recorded["end"], recorded["reason"]
        if ended is not None:
            end, reason = ended[0].value, ended[1]
        elif end == End.FINISHED:
            end, reason = None, ""
        return {
            **recorded,
            "end": end,
            "reason": reason,
            "mode": last.mode.value,
            "cycles": self._recorded.count,
            "skipped": self._recorded.skipped,
            "duration_s": self._recorded.duration_s,
        }

    def _compare(self, topic: str, t_ns: int, replayed: bytes) -> None:
        expected = self._expected.get(topic)
        if replayed != (b"" if expected is None else expected.data):
            recorded = None if expected is None else expected.json()
            for name, was, now in _unequal_fields(topic, recorded, json.loads(replayed or b"null")):
                self.result.note(t_ns, name, was, now)

    def _compare_sent(self, t_ns: int, recorded: list[bytes], name: str) -> None:
        sent = self._drive_link.sent
        if sent != recorded:
            was, now = (b" ".join(payloads).hex(" ") for payloads in (recorded, sent))
            self.result.note(t_ns, name, was, now)


class _Estimates(Replayer):
    """Runs each cycle with other parameters and the setpoints of the log."""

    def __init__(self, log: LogReader, config: Config, is_used: Callable[[Sample], bool]) -> None:
        super().__init__(log, config)
        self._is_used = is_used
        self._steering_count = len(make_kinematics(config.rover).steering_rates_rad_s)
        self.output: StepOutput | None = None

    @property
    def pose_filter(self) -> PoseFilter:
        """The filter that estimates."""
        return self._rig.loop.pose_filter

    def _run_cycle(self, t_ns: int) -> None:
        rig = self._rig
        rig.clock.sleep_until(t_ns)
        samples = [*rig.poll(), *self._fixes]
        self.output = rig.loop.step(t_ns, [sample for sample in samples if self._is_used(sample)])
        estimate = self._expected.get(ESTIMATE[1:])
        if estimate is None:
            return
        record = self._log.parse(estimate, COMMAND_SHAPE)["command"]
        given = WheelCommand(
            t_ns=record["t_ns"],
            expires_ns=record["expires_ns"],
            speed_rad_s=record["speed_rad_s"],
            steering_rad=record.get("steering_rad"),
        )
        if len(given.speed_rad_s) != rig.drive.wheel_count or (
            given.steering_rad is not None and len(given.steering_rad) != self._steering_count
        ):
            raise LogError(f"{self._log.path} is damaged: {ESTIMATE} at {t_ns} ns: setpoints of other wheels")
        rig.loop.follow_log(given)
        command = self._expected.get(COMMAND[1:])
        if command is not None:
            self._prepare_drive(command.t_ns)
            rig.clock.sleep_until(command.t_ns)
            rig.drive.command(given)


def _in_order(messages: Iterable[LogMessage]) -> Iterator[LogMessage]:
    """Yield what the watchdog logged a cycle late in the cycle before whose command it was sent."""
    cycle: list[LogMessage] = []
    commanded_ns = -1
    following: list[LogMessage] = []
    for message in messages:
        kind = message.topic[1:].partition("/")[0]
        if kind in ("sent", "unsent", "watchdog") and message.t_ns < commanded_ns:
            cycle.insert(len(cycle) - 1, message)
            continue
        following.append(message)
        if kind == "cycle":
            yield from cycle
            cycle, following = following, []
            commanded_ns = next((m.t_ns for m in cycle if m.topic == COMMAND), -1)
    yield from cycle
    yield from following


def _link_change(message: LogMessage, log: LogReader) -> LinkChange:
    change = log.parse(message, LINK_SHAPE)
    return replace(change, t_ns=message.t_ns)


def _feed_link(link: ReplayLink[PayloadT], t_ns: int, item: PayloadT | LinkChange) -> None:
    link.feed(item if isinstance(item, LinkChange) else Received(t_ns, item))


def _unequal_fields(name: str, recorded: object, replayed: object) -> Iterator[tuple[str, object, object]]:
    if isinstance(recorded, dict) and isinstance(replayed, dict):
        for key in {**recorded, **replayed}:
            yield from _unequal_fields(f"{name}.{key}", recorded.get(key), replayed.get(key))
    elif isinstance(recorded, list) and isinstance(replayed, list) and len(recorded) == len(replayed):
        for index, (was, now) in enumerate(zip(recorded, replayed, strict=True)):
            yield from _unequal_fields(f"{name}[{index}]", was, now)
    elif repr(_finite(recorded)) != repr(_finite(replayed)):  # repr, so that -0.0 differs from 0.0
        yield name, recorded, replayed


def _finite(value: object) -> object:
    """Return None for a number that is not finite: older logs spell it as NaN, newer ones as null."""
    return None if isinstance(value, float) and not math.isfinite(value) else value
