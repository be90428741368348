"""Slip that pose fixes or a camera measure: it labels the readings of the excitation, and teaches."""

from controllers.estimation.ground.travel import GroundPair
from controllers.estimation.wheels.odometry import BodyIncrement
from controllers.slip.effort.ground_knowledge import GroundKnowledge
from controllers.slip.effort.labelled_windows import LabelledReading, LabelledWindows
from controllers.slip.effort.parameters import EFFORT
from controllers.slip.effort.slip_bracket import DrivenTravel, SlipReading
from controllers.slip.effort.slip_by_fixes import SlipByFixes
from controllers.slip.effort.slip_by_ground import SlipByGround
from controllers.slip.effort.wheel_efforts import WheelEfforts
from drivers.clock import seconds
from drivers.samples import PoseFixSample


class SlipLabels:
    """Finds the slip between fixes and between frames, and joins it with the readings of the same time.

    Args:
        fixes: Devices that measure the pose.
        window_s: Duration of a window of the excitation.
        ground: Is taught the slip between fixes; None where nothing is to be learned.
        efforts: Work of the wheels, and the time up to which their motion is known.
    """

    def __init__(
        self,
        fixes: tuple[str, ...],
        window_s: float,
        ground: GroundKnowledge | None,
        efforts: WheelEfforts,
    ) -> None:
        self._fixes, self._ground, self._efforts = fixes, ground, efforts
        self._by_fixes, self._by_ground = SlipByFixes(), SlipByGround()
        self._windows = LabelledWindows(window_s)
        self._fix_ns: int | None = None

    def take_fix(self, sample: PoseFixSample, t_ns: int) -> None:
        """Take a fix as of `t_ns`; one of another device has no effect."""
        if sample.device not in self._fixes:
            return
        self._fix_ns = t_ns
        found = self._by_fixes.take(sample)
        if found is None:
            return
        if self._ground is not None and found.force_n is not None:
            self._ground.learn(found.slip, found.force_n)
        self._windows.wait(found)

    def take_ground(self, pair: GroundPair) -> None:
        """Take a motion over the ground."""
        found = self._by_ground.take(pair)
        if found is not None:
            self._windows.wait(found)

    def move(self, increment: BodyIncrement, gyro_rate_rad_s: float | None) -> None:
        """Take an increment of rolling wheels, and the gyro's rate in it; None without one."""
        if not self._fixes:
            return
        turn_rad = increment.turn_rad if gyro_rate_rad_s is None else gyro_rate_rad_s * increment.duration_s
        work_j = self._efforts.work_j(increment) if self._efforts.unknown_work is None else None
        # The odometry is known up to the oldest of the newest positions.
        self._by_fixes.move(self._efforts.positions_ns, increment, turn_rad, work_j)

    def add(self, reading: SlipReading, travel: DrivenTravel) -> None:
        """Take the reading of a window of the excitation that ends now."""
        self._windows.add(self._efforts.positions_ns, reading, travel)

    def label(self) -> LabelledReading | None:
        """Return the oldest slip that is due, with the readings of its time; None for nothing."""
        return self._windows.label(self._efforts.positions_ns)

    @property
    def are_fixes_recent(self) -> bool:
        """Whether the newest fix is recent: it then measures the slip."""
        if self._fix_ns is None:
            return False
        return seconds(self._efforts.positions_ns - self._fix_ns) < EFFORT.fixes.absent_s

    def forget_gyro(self) -> None:
        """Forget the travel since the last fixes: its turns are those of the gyro."""
        self._by_fixes = SlipByFixes()
