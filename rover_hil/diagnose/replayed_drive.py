"""A recorded drive and its estimate: replayed once, with everything that the page is about."""

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from controllers.control_loop import StepOutput
from controllers.motion.rover_geometry import wheels_reach_m
from drivers.clock import seconds
from drivers.errors import LogError
from drivers.samples import PoseFixSample, Sample
from rover_hil.config import Config
from rover_hil.diagnose.trajectory_errors import Trajectory
from rover_hil.drives.arrays import Array
from rover_hil.drives.drive import Drive, drive_name
from rover_hil.drives.marks import marks_beside, read_marks
from rover_hil.drives.quality.drive_paths import POSITIONS, DrivePath, places_of
from rover_hil.drives.quality.judge import findings_of, with_causes
from rover_hil.drives.quality.position_use import PositionUse
from rover_hil.drives.quality.references import LEAST_TURN_RAD
from rover_hil.ready.wheels.motion_kinds import BY_HAND, kind_of
from rover_hil.ready.wheels.trajectory import LEAST_STEPS, STEP_S
from rover_hil.recording.data_files import restore_config
from rover_hil.recording.findings import FindingList, FoundFinding
from rover_hil.recording.reader import LogReader
from rover_hil.run.replay import estimate_again

MARKS = "marks measured by hand"
COPIED_DISTANCE = "the distances of the wheels are those of the ground truth, step by step"
TRIANGLE = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
LEAST_CYCLES = 10
SAME_YAW = 1e-6
"""Two sensors of yaw differ by more than this share of what they turned: no gyro's scale is as exact."""
SAME_DISTANCE = 1e-3
"""Steps of wheels and of measured places differ by more than this share, by the noise of the places alone."""


@dataclass(slots=True)
class Use:
    """What became of the measurements of a device.

    Attributes:
        outcomes: Number of measured quantities by what became of them.
        normalised: Squared innovations over their variance, of those that were compared.
    """

    outcomes: Counter[str] = field(default_factory=Counter)
    normalised: list[float] = field(default_factory=list)


@dataclass(frozen=True, slots=True, kw_only=True)
class Replay:
    """What the cycles of a replay have computed, n of them with different times.

    Attributes:
        t_s: Times since the start of the log, (n,).
        estimate: x, y and unwrapped yaw of the filter, (n, 3).
        odometry: The same by the wheels alone.
        covariance: Of the estimate, (n, 3, 3).
        use: What became of the measurements of each device.
        findings: What the rules found.
        suspected: What they suspected.
        position_fault: Why no position was used; "" where one was, or there is none.
    """

    t_s: Array
    estimate: Array
    odometry: Array
    covariance: Array
    use: dict[str, Use]
    findings: list[FoundFinding]
    suspected: list[FoundFinding]
    position_fault: str

    def at(self, t_s: Array, track: Array) -> Trajectory:
        """Return estimate or odometry at times, which must lie within the replay."""
        x_m, y_m, yaw_rad = (np.interp(t_s, self.t_s, column) for column in track.T)
        return Trajectory(x_m + 1j * y_m, yaw_rad)


@dataclass(frozen=True, slots=True, kw_only=True)
class ReplayedDrive:
    """A drive, its estimate and its ground truth.

    Attributes:
        drive: The log, read to its end.
        replay: With everything that was measured.
        truth: Known places; None without ground truth and positions.
        source: What measured them; "" without.
        copied: What ground truth and wheels have from one measurement, so that it is left out: "yaw",
            "distance" (then all of the ground truth), or "".
        findings: Of the whole drive and of the rules, causes first, and what remains suspected.
        kind: Of its motion, by its wheels.
    """

    drive: Drive
    replay: Replay
    truth: DrivePath | None
    source: str
    copied: str
    findings: list[FoundFinding]
    kind: str

    @property
    def name(self) -> str:
        """Name of the drive, see `drive_name`."""
        return drive_name(self.drive.log.path)

    @property
    def is_independent(self) -> bool:
        """Whether the estimate has not used the known places."""
        return self.truth is not None and self.source != POSITIONS

    @property
    def distance_m(self) -> float:
        """Length of the path by the wheels."""
        return float(np.hypot(*np.diff(self.replay.odometry[:, :2], axis=0).T).sum())

    @property
    def rotations(self) -> float:
        """Number of rotations by the wheels, back and forth added."""
        return float(np.abs(np.diff(self.replay.odometry[:, 2])).sum() / (2.0 * np.pi))


def replay_drive(path: Path, on_cycle: Callable[[int], None]) -> ReplayedDrive:
    """Return a drive with its estimate.

    Args:
        path: The log.
        on_cycle: Gets how many bytes of it are read.

    Raises:
        LogError: The log cannot be read, is damaged, or holds no cycles.
    """
    drive = Drive(path, with_devices=True).read()
    replay = replay_of(path, on_cycle)
    source, truth = _truth_of(drive)
    copied = "" if truth is None or drive.log.origin == "virtual" else _copied(truth, replay)
    if copied == "distance":
        truth = None
    elif copied and truth is not None:
        truth = replace(truth, yaw_rad=None)
    findings, suspected = with_causes(
        findings_of(drive.channels, drive.config), replay.findings, replay.suspected
    )
    return ReplayedDrive(
        drive=drive,
        replay=replay,
        truth=truth,
        source=source,
        copied=copied,
        findings=[*findings, *suspected],
        kind=_kind_of(replay, wheels_reach_m(drive.config.rover)),
    )


def replay_of(
    path: Path,
    on_cycle: Callable[[int], None],
    changed: Callable[[Config], Config] = lambda config: config,
    is_used: Callable[[Sample], bool] = lambda _: True,
) -> Replay:
    """Return what a replay of a log computes.

    Args:
        path: The log.
        on_cycle: Gets how many bytes of it are read.
        changed: Returns the configuration to replay with.
        is_used: Says of each sample whether the estimator gets it.

    Raises:
        LogError: The log cannot be read, is damaged, or holds no cycles.
    """
    log = LogReader(path)
    positions, rows, use = PositionUse(), list[tuple[float, ...]](), dict[str, Use]()
    found = FindingList()

    def given(sample: Sample) -> bool:
        is_given = is_used(sample)
        if is_given and isinstance(sample, PoseFixSample):
            positions.give((sample,))
        return is_given

    with restore_config(log) as logged:
        for output in estimate_again(log, changed(logged), given):
            rows.append(_row(output))
            _count(output, use)
            positions.take(output)
            found.take(seconds(output.t_ns - log.start_ns), output.findings or (), output.suspicion)
            on_cycle(log.bytes_read)
    table = np.array(rows, np.float64).reshape(-1, 13)
    table = table[np.isfinite(table).all(axis=1)]
    table = table[np.concatenate((np.diff(table[:, 0]) > 0.0, np.ones(min(len(table), 1), np.bool_)))]
    if len(table) < LEAST_CYCLES:
        raise LogError(f"log {path} holds {len(table)} cycles with an estimate, too few: give a whole drive")
    covariance = np.zeros((len(table), 3, 3))
    for place, (row, column) in enumerate(TRIANGLE):
        covariance[:, row, column] = covariance[:, column, row] = table[:, 7 + place]
    estimate, odometry = table[:, 1:4].copy(), table[:, 4:7].copy()
    estimate[:, 2], odometry[:, 2] = np.unwrap(estimate[:, 2]), np.unwrap(odometry[:, 2])
    return Replay(
        t_s=(table[:, 0] - log.start_ns) / 1e9,
        estimate=estimate,
        odometry=odometry,
        covariance=covariance,
        use=use,
        findings=found.found,
        suspected=found.doubts,
        position_fault=positions.fault(),
    )


def _row(output: StepOutput) -> tuple[float, ...]:
    pose, wheels = output.estimate, output.odometry
    own = (pose.x_m, pose.y_m, pose.yaw_rad, wheels.x_m, wheels.y_m, wheels.yaw_rad)
    return (pose.t_ns, *own, *pose.covariance)


def _count(output: StepOutput, use: dict[str, Use]) -> None:
    for innovation in output.innovations:
        of_device = use.setdefault(innovation.measured.device, Use())
        of_device.outcomes[innovation.outcome.value] += 1
        if innovation.nis is not None:
            of_device.normalised.append(innovation.nis)


def _truth_of(drive: Drive) -> tuple[str, DrivePath | None]:
    """Return the known places of a drive with times from the start of the log, and what measured them."""
    start_s = drive.log.start_ns / 1e9
    for source, path in places_of(drive.channels):
        return source, DrivePath(path.t_s - start_s, path.x_m, path.y_m, path.yaw_rad, path.sd_m, path.arm_m)
    file = marks_beside(drive.log.path)
    if file is None:
        return "", None
    marks = read_marks(file)
    yaw_rad = np.unwrap(np.radians(marks.yaw_deg)) if np.isfinite(marks.yaw_deg).all() else None
    return MARKS, DrivePath(marks.t_s, marks.x_m, marks.y_m, yaw_rad, float(marks.sigma_m.max()))


def _copied(truth: DrivePath, replay: Replay) -> str:
    """Return what known places and wheels have from one measurement, see `ReplayedDrive.copied`."""
    inside = (truth.t_s >= replay.t_s[0]) & (truth.t_s <= replay.t_s[-1])
    if inside.sum() < LEAST_CYCLES:
        return ""
    by_wheels = replay.at(truth.t_s[inside], replay.odometry)
    true_m = np.abs(np.diff(truth.x_m[inside] + 1j * truth.y_m[inside]))
    apart_m = np.abs(np.abs(np.diff(by_wheels.place_m)) - true_m)[true_m > 0.0]
    if apart_m.size and np.median(apart_m / true_m[true_m > 0.0]) < SAME_DISTANCE:
        return "distance"
    if truth.yaw_rad is None or by_wheels.yaw_rad is None:
        return ""
    turned_rad = float(np.abs(np.diff(by_wheels.yaw_rad)).sum())
    difference_rad = np.unwrap(truth.yaw_rad[inside]) - by_wheels.yaw_rad
    is_same = turned_rad > LEAST_TURN_RAD and float(np.ptp(difference_rad)) < SAME_YAW * turned_rad
    return "yaw" if is_same else ""


def _kind_of(replay: Replay, size_m: float) -> str:
    """Return the kind of motion of a drive by its odometry."""
    t_s = np.arange(replay.t_s[0], replay.t_s[-1], STEP_S)
    if len(t_s) < LEAST_STEPS:
        return BY_HAND
    path = replay.at(t_s, replay.odometry)
    assert path.yaw_rad is not None  # noqa: S101 the wheels have one
    middle_rad = 0.5 * (path.yaw_rad[1:] + path.yaw_rad[:-1])
    steps_m = np.diff(path.place_m) * np.exp(-1j * middle_rad)
    return kind_of(np.column_stack((steps_m.real, steps_m.imag, np.diff(path.yaw_rad))), size_m)
