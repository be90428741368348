"""Path of a log: its cycles run again by the estimator that drove, smoothed backwards."""

import math
import tempfile
from collections import Counter
from collections.abc import Callable
from typing import BinaryIO

from controllers.control_loop import StepOutput
from controllers.estimation.filter.guarded_filter import Innovation
from controllers.estimation.filter.pose_filter import PoseFilter
from controllers.motion.steering import mean_steering_rad
from controllers.slip.scomp.states import ScompStates
from drivers.clock import seconds
from drivers.errors import LogError
from drivers.samples import HeadingReference
from rover_hil.config import Config
from rover_hil.recording.reader import LogReader
from rover_hil.run.replay import estimate_again
from rover_hil.scomp.kept_steps import KeptSteps
from rover_hil.scomp.odometry import Result, Row, learnt_of, path_of, turned_by_compass

LEAST_SHARE = 0.01
"""A reason that leaves the slip uncertain in a smaller share of the cycles is not reported."""

KNOWN_RAD = 1.0
"""An offset of headings with a greater standard deviation was never measured."""


class _Cycles:
    """Collects the rows of a replay."""

    def __init__(self, start_ns: int, file: BinaryIO) -> None:
        self._start_ns, self._file = start_ns, file
        self._filter: PoseFilter | None = None
        self._odometry: object = None
        self._steps: KeptSteps | None = None
        self.rows: list[Row] = []
        self.innovations: list[Innovation] = []
        self.reasons: Counter[str] = Counter()

    def take_filter(self, pose_filter: PoseFilter) -> None:
        """Keep the steps of a filter from now on."""
        self._filter = pose_filter
        self._steps = KeptSteps(pose_filter.keep_steps(), self._file)

    @property
    def pose_filter(self) -> PoseFilter:
        """The filter of the replay."""
        if self._filter is None:
            raise RuntimeError("no replay has begun")
        return self._filter

    @property
    def steps(self) -> KeptSteps:
        """Its steps."""
        if self._steps is None:
            raise RuntimeError("no replay has begun")
        return self._steps

    @property
    def states(self) -> ScompStates:
        """The states of slip and trace in the filter."""
        states = self.pose_filter.slip
        if not isinstance(states, ScompStates):
            raise RuntimeError("the replayed rover is without sComp")
        return states

    def take(self, output: StepOutput) -> None:
        """Take what a cycle computed; wheel positions that are not newer give no row."""
        self.innovations += output.innovations
        self.steps.save()
        t_s = seconds(output.estimate.t_ns - self._start_ns)
        if output.scomp is None or (self.rows and t_s <= self.rows[-1].t_s):
            return
        self.reasons[output.scomp.reason] += 1
        odometry, self._odometry = self._odometry, output.odometry
        self.rows.append(
            Row(
                t_s=t_s,
                steps=len(self.steps) - 1,
                tilt=self.states.tilt,
                steering_rad=mean_steering_rad(output.steering_rad or ()),
                is_turning=odometry is not None and odometry != output.odometry,
            )
        )


def replay_track(
    log: LogReader, config: Config, on_cycle: Callable[[], None] = lambda: None, *, online: bool = False
) -> Result:
    """Return the path of a log, one row for each cycle with new wheel positions.

    Args:
        log: Of a rover with four wheels.
        config: Its devices, with the parameters of sComp to use.
        on_cycle: Called after each cycle.
        online: Each row as the rover knew it then, not by the whole drive. The last row is the same.

    Raises:
        LogError: The log is damaged, or has fewer than two cycles with wheel positions.
    """
    with tempfile.TemporaryFile() as file:
        cycles = _Cycles(log.start_ns, file)
        for output in estimate_again(log, config, take_filter=cycles.take_filter):
            cycles.take(output)
            on_cycle()
        if len(cycles.rows) < 2:
            raise LogError(
                f"log {log.path} has fewer than two cycles with wheel positions: give a longer log"
            )
        layout, last = cycles.pose_filter.layout, cycles.steps.last
        blocks = cycles.steps.estimates(layout.angles, online=online)
        track = path_of(cycles.rows, blocks, cycles.states.model, layout)
    notes = _notes(cycles.reasons)
    compass = _compass(config, cycles.pose_filter)
    if config.scomp is not None and compass is not None:
        track, note = turned_by_compass(track, config.scomp.parameters, layout, last, compass)
        notes += note
    return Result(
        track=track,
        innovations=tuple(cycles.innovations),
        learnt=learnt_of(layout, last),
        notes=tuple(notes),
    )


def _compass(config: Config, pose_filter: PoseFilter) -> tuple[str, HeadingReference] | None:
    """Return the first heading device whose offset is known at the end."""
    covariance = pose_filter.kalman.covariance
    for name in config.roles.headings:
        for (device, reference), index in pose_filter.layout.offsets.items():
            if device == name and covariance[index][index] < KNOWN_RAD**2:
                return device, reference
    return None


def _notes(reasons: Counter[str]) -> list[str]:
    """Return a note for each reason that left the slip uncertain, the most frequent first."""
    count = reasons.total()
    return [
        f"{reason}: in {math.ceil(100.0 * number / count)} % of the cycles"
        for reason, number in reasons.most_common()
        if reason and number >= LEAST_SHARE * count
    ]
