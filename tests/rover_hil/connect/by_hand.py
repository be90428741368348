"""A simulated Robotino that is driven over ROS 2, and a script of what others do meanwhile."""

import os
from collections.abc import Callable, Generator
from pathlib import Path

from controllers.operator import OperatorInput
from drivers.clock import PacedClock, SystemClock
from rover_hil.config import Config, load_config
from rover_hil.connect.ros2.connection import Ros2Connection
from rover_hil.recording.data_files import restore_config
from rover_hil.recording.reader import LogReader
from rover_hil.recording.schema import ESTIMATE, ESTIMATE_SHAPE, EstimateRecord
from rover_hil.run.driving import run_virtual
from rover_hil.run.executive import CycleView, End, RunResult
from rover_hil.run.operators import Operators
from rover_hil.run.replay import replay
from sim_backends.world.plant import Truth

LIMIT_S = 60.0
"""Of a script, on a loaded machine."""
Steps = Generator[None, None, None]


def own_domain() -> int:
    """Return a domain that tests in other processes do not use at the same time."""
    return 1 + os.getpid() % 100


def hand_config(**keys: object) -> Config:
    """Return the shipped Robotino without excitation, driven over ROS 2."""
    table = load_config("robotino").model_dump(by_alias=True, exclude={"slip", "mission"})
    return Config.model_validate(
        {
            **table,
            "mission": {"type": "by_hand", "speed_m_s": 0.3, "yaw_rate_limit_rad_s": 1.0},
            "safety": {**table["safety"], "settle_s": 0.3},
            "ros2": {"domain": own_domain(), "commands": True, **keys},
        }
    )


class Scripted:
    """Goes through a script, a step in each cycle, and ends the run after it.

    Attributes:
        mode: Mode in the newest cycle.
        reason: Why the rover was stopped in it.
        set_rad_s: Setpoints that were sent in it.
        now_ns: Real monotonic time of it.
        truth: The true state then.
        pose: The estimate then.
        wants: What it wants as the page of a run does, once.
    """

    def __init__(self, script: Callable[["Scripted"], Steps]) -> None:
        self.mode = self.reason = ""
        self.set_rad_s: tuple[float, ...] = ()
        self.now_ns = 0
        self.is_over = False
        self.truth: Truth | None = None
        self.pose = (0.0, 0.0, 0.0)
        self.wants: OperatorInput | None = None
        self._clock = SystemClock()
        self._steps = script(self)

    @property
    def is_driven(self) -> bool:
        """Whether setpoints are not zero."""
        return any(self.set_rad_s)

    def wait(self, is_so: Callable[[], bool], each: Callable[[], None] = lambda: None) -> Steps:
        """Go on with the next step when something is so; do something in each cycle until then."""
        while not is_so():
            each()
            yield

    def stay(self, cycles: int, each: Callable[[], None] = lambda: None) -> Steps:
        """Let cycles pass, doing something in each."""
        for _ in range(cycles):
            each()
            yield

    def wanted(self) -> OperatorInput | None:
        """Return what the script wants; None for nothing."""
        wanted, self.wants = self.wants, None
        return wanted

    def end(self) -> tuple[End, str] | None:
        """End the run after the script."""
        return (End.STOPPED_BY_USER, "the script is over") if self.is_over else None

    def show(self, view: CycleView) -> None:
        """Go on with the script."""
        self.now_ns = self._clock.now_ns()
        self.mode, self.reason = view.output.mode.value, view.output.reason
        self.set_rad_s = view.sent.speed_rad_s
        self.truth = view.truth
        estimate = view.output.estimate
        self.pose = estimate.x_m, estimate.y_m, estimate.yaw_rad
        self.is_over = next(self._steps, self) is self


def drive(
    config: Config, path: Path, script: Callable[[Scripted, Ros2Connection], Steps]
) -> tuple[Scripted, RunResult]:
    """Run the rover in real time until the script or the run has ended; return both."""
    clock = PacedClock()
    with Ros2Connection(config, lambda: clock.offset_ns) as connection:
        scripted = Scripted(lambda each: script(each, connection))
        sides = Operators([connection, scripted])
        result = run_virtual(config, path, LIMIT_S, None, clock=clock, operator=sides)
    return scripted, result


def replays_exactly(path: Path) -> bool:
    """Return whether a replay of a log gives every output again."""
    log = LogReader(path)
    with restore_config(log) as config:
        return not replay(log, config, lambda: None).differences


def estimates_of(path: Path) -> list[EstimateRecord]:
    """Return what the cycles of a log computed."""
    log = LogReader(path)
    return [log.parse(each, ESTIMATE_SHAPE) for each in log.messages() if each.topic == ESTIMATE]
