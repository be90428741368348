"""How a mission went whose control loop received rendered pictures: errors, slip, and what was reported."""

import math
import re
from collections import Counter
from collections.abc import Iterable
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.gates.floors import Way
from benchmarks.safety.faults.measures import RESOLUTION
from benchmarks.safety.healthy_missions import greatest_radius_m
from benchmarks.safety.missions import Driven, Moment
from controllers.control_loop import StepOutput
from controllers.estimation.ground.travel import GroundReport
from controllers.safety import Mode
from rover_hil.config import Config
from rover_hil.report.tracks import Track
from rover_hil.tune.metrics import TruePath, closure_m, path_rms_m
from tests.nature.ambiguous_ground.live_camera import LiveScene

Floats = NDArray[np.float64]

RMS_RATIO, RMS_M, SLIP_OFF = 0.5, 0.015, 0.05
STUCK, STUCK_M, STUCK_SHARE = re.compile("rover: stuck"), 0.15, 0.1
"""A rover is stuck where it truly moves less than this share of the last travel of its wheels."""
LEAST_TIMES = 25
SLIP_WINDOW_M = 0.05
"""Travel of the wheels over which the loop reports its slip, in the newest `SLIP_WINDOW_S` at most."""
SLIP_WINDOW_S = 2.0
NUMBER = re.compile(r"-?\d+(?:\.\d+)?")


class Finding(NamedTuple):
    """What was reported, or why nothing was measured: the text without its numbers.

    Attributes:
        text: Each number is replaced by #.
        first_s: Time of the first one.
        times: Number of cycles, or of frames.
    """

    text: str
    first_s: float
    times: int

    def __str__(self) -> str:
        return f"{self.first_s:.1f} s, {self.times} times: {self.text}"


class Result(NamedTuple):
    """How a mission went; lengths in m, NaN where nothing was measured.

    Attributes:
        frames: Number of frames that were rendered.
        mode: The last one.
        stops: Number of stops.
        is_stuck: It was truly stuck when it stopped for that reason, at the end.
        path_m: True length of the path.
        end_m: Error of the estimate at the end.
        rms_m: Rms error of the estimate over the true path.
        wheels_rms_m: The same of the wheels alone.
        nees: Greatest NEES without a report; errors of 1 mm and 1 mrad count for nothing.
        radius_m: Greatest radius of the 95 % region of the position.
        valid: Share of the frames with a valid pair, since the rover may move.
        slip_off: Mean of measured less true slip.
        slip_rms: Rms of it.
        true_slip: Mean true slip where slip was measured.
        way: The true way.
        reports: What was reported, by cycles.
        reasons: Other reasons of the ground motion, by frames.
        unconfirmed: What the mission has not confirmed about the camera by its end, and which motion the
            ground leaves open; empty for nothing.
    """

    frames: int
    mode: Mode
    stops: int
    is_stuck: bool
    path_m: float
    end_m: float
    rms_m: float
    wheels_rms_m: float
    nees: float
    radius_m: float
    valid: float
    slip_off: float
    slip_rms: float
    true_slip: float
    way: Way
    reports: tuple[Finding, ...]
    reasons: tuple[Finding, ...]
    unconfirmed: str

    @property
    def is_near(self) -> bool:
        """Whether the estimate of a right mission is within its bars."""
        is_near = self.rms_m <= max(RMS_RATIO * self.wheels_rms_m, RMS_M)
        has_slip = abs(self.slip_off) <= SLIP_OFF
        has_finished = self.mode is Mode.FINISHED and not self.stops
        return (has_finished or self.is_stuck) and is_near and has_slip

    def names(self, causes: Iterable[str]) -> bool:
        """Return whether one of the causes was reported, for longer than the false alarms of right rigs.

        Or is in the report of the mission, as ground that leaves some motion open.
        """
        found = [each.text for each in (*self.reports, *self.reasons) if each.times >= LEAST_TIMES]
        return any(cause in text for text in (*found, self.unconfirmed) for cause in causes)

    @property
    def blames_camera(self) -> bool:
        """Whether a report asks to check the camera or its rig."""
        texts = [each.text for each in self.reports if "check" in each.text]
        return any("camera" in text or "rig" in text for text in texts)


def judge(driven: Driven, config: Config, scene: LiveScene) -> Result:
    """Compare a mission with the truth of its cycles, and with that along the ground at its exposures."""
    true, estimate, wheels = _true_poses(driven), _estimates(driven), _odometry(driven)
    steps_m = np.hypot(*np.diff(true[:, 1:3], axis=0).T)
    errors_m, wheel_errors_m = (_distances(poses, true) for poses in (estimate, wheels))
    measured, truth = _slips(driven, wheels, scene)
    off = measured - truth
    silent = [_nees(moment) for moment in driven.moments if not _reports(moment.output)]
    seen = _ground_frames(driven)
    reports = [(t_s, text) for t_s, output in _cycles(driven) for text in _reports(output)]
    reasons = [(t_s, ground.reason) for t_s, ground in seen if ground.reason and not _asks(ground)]
    return Result(
        frames=len(scene.truths),
        mode=driven.mode,
        stops=len(driven.stops()),
        is_stuck=_is_stuck(driven, true, wheels),
        path_m=float(steps_m.sum()),
        end_m=float(errors_m[-1]),
        rms_m=_rms(errors_m[1:], steps_m),
        wheels_rms_m=_rms(wheel_errors_m[1:], steps_m),
        nees=max(silent, default=math.nan),
        radius_m=greatest_radius_m(driven),
        valid=_mean(np.array([not ground.reason for _, ground in seen], np.float64)),
        slip_off=_mean(off),
        slip_rms=math.sqrt(_mean(off**2)),
        true_slip=_mean(truth),
        way=_way(config, driven, true),
        reports=_findings(reports),
        reasons=_findings(reasons),
        unconfirmed=seen[-1][1].unconfirmed if seen else "",
    )


def _is_stuck(driven: Driven, true: Floats, wheels: Floats) -> bool:
    """Return whether the one stop is that of a stuck rover, and the truth agrees."""
    stops = driven.stops()
    if len(stops) != 1 or driven.mode is not Mode.EMERGENCY_STOP or not STUCK.match(stops[0].output.reason):
        return False
    end = next(k for k, moment in enumerate(driven.moments) if moment is stops[0])
    rolled_m = np.concatenate(([0.0], np.cumsum(np.abs(np.diff(_travelled(wheels[: end + 1]))))))
    if rolled_m[-1] < STUCK_M:
        return False
    begin = int(np.flatnonzero(rolled_m <= rolled_m[-1] - STUCK_M)[-1])
    moved_m = float(np.hypot(*(true[end, 1:3] - true[begin, 1:3])))
    return moved_m < STUCK_SHARE * STUCK_M


def _nees(moment: Moment) -> float:
    xx, xy, xt, yy, yt, tt = moment.output.estimate.covariance
    covariance = np.array([[xx, xy, xt], [xy, yy, yt], [xt, yt, tt]]) + RESOLUTION**2 * np.eye(3)
    return float(moment.error @ np.linalg.solve(covariance, moment.error))


def _cycles(driven: Driven) -> list[tuple[float, StepOutput]]:
    """Return time and output of every cycle since the rover may move."""
    each = [(moment.t_s, moment.output) for moment in driven.moments]
    return [(t_s, output) for t_s, output in each if output.mode is not Mode.SETTLING]


def _true_poses(driven: Driven) -> Floats:
    """Return time in s and true pose of every cycle, relative to the start."""
    return np.array([(1e-9 * moment.output.t_ns, *moment.truth) for moment in driven.moments])


def _estimates(driven: Driven) -> Floats:
    """Return the estimates, each with the time of the wheel positions that it is based on."""
    each = [moment.output.estimate for moment in driven.moments]
    return np.array([(1e-9 * pose.t_ns, pose.x_m, pose.y_m, pose.yaw_rad) for pose in each])


def _odometry(driven: Driven) -> Floats:
    """Return the poses by the wheels alone, likewise."""
    each = [(moment.output.estimate.t_ns, moment.output.odometry) for moment in driven.moments]
    poses = np.array([(1e-9 * t_ns, pose.x_m, pose.y_m, pose.yaw_rad) for t_ns, pose in each])
    poses[:, 3] = np.unwrap(poses[:, 3])
    return poses


def _distances(poses: Floats, true: Floats) -> Floats:
    """Return how far poses are from the true ones at their times."""
    x_m, y_m = (np.interp(poses[:, 0], true[:, 0], true[:, column]) for column in (1, 2))
    return np.asarray(np.hypot(poses[:, 1] - x_m, poses[:, 2] - y_m))


def _rms(errors_m: Floats, steps_m: Floats) -> float:
    """Return the root mean square over the path."""
    return math.sqrt(float(errors_m**2 @ steps_m) / max(float(steps_m.sum()), 1e-9))


def _mean(values: Floats) -> float:
    return float(values.mean()) if len(values) else math.nan


def _travelled(poses: Floats) -> NDArray[np.complex128]:
    """Return the sum of the steps in the rover's own axes, to the left imaginary."""
    steps = np.diff(poses[:, 1]) + 1j * np.diff(poses[:, 2])
    middle = 0.5 * (poses[1:, 3] + poses[:-1, 3])
    return np.concatenate(([0j], np.cumsum(steps * np.exp(-1j * middle))))


def _slips(driven: Driven, wheels: Floats, scene: LiveScene) -> tuple[Floats, Floats]:
    """Return the slips of the loop, and the true ones over the same travel of the wheels."""
    track = scene.track()
    moved_m, rolled_m = _travelled(track), np.interp(track[:, 0], wheels[:, 0], _travelled(wheels))
    length_m = np.concatenate(([0.0], np.cumsum(np.abs(np.diff(rolled_m)))))
    measured, true = [], []
    for _, ground in _ground_frames(driven):
        if ground.slip is None:
            continue
        end = int(np.argmin(np.abs(track[:, 0] - 1e-9 * ground.t_ns)))
        begin = max(
            int(np.searchsorted(length_m, length_m[end] - SLIP_WINDOW_M, side="right")) - 1,
            int(np.searchsorted(track[:, 0], track[end, 0] - SLIP_WINDOW_S)),
            0,
        )
        rolled = rolled_m[end] - rolled_m[begin]
        if abs(rolled) < 0.5 * SLIP_WINDOW_M:  # forth and back, or a rotation: it has no slip
            continue
        share = (moved_m[end] - moved_m[begin]) / rolled
        measured.append(ground.slip)
        true.append(1.0 - float(share.real))
    return np.array(measured), np.array(true)


def _asks(ground: GroundReport) -> bool:
    """Return whether a reason of the ground motion is a finding that asks to check something."""
    return "check" in ground.reason


def _reports(output: StepOutput) -> list[str]:
    """Return what is reported in a cycle."""
    texts = [output.reason, output.suspicion]
    if output.ground is not None and _asks(output.ground):
        texts.append(output.ground.reason)
    return [text for text in texts if text]


def _ground_frames(driven: Driven) -> list[tuple[float, GroundReport]]:
    """Return the report after every frame whose motion was measured or not, with the time of its cycle."""
    each = [(t_s, output.ground) for t_s, output in _cycles(driven) if output.ground is not None]
    return [after for before, after in pairwise(each) if before[1].t_ns != after[1].t_ns]


def _findings(texts: Iterable[tuple[float, str]]) -> tuple[Finding, ...]:
    """Return each text once."""
    counts, first_s = Counter[str](), dict[str, float]()
    for t_s, text in texts:
        alike = NUMBER.sub("#", text)
        counts[alike] += 1
        first_s.setdefault(alike, t_s)
    return tuple(Finding(text, first_s[text], count) for text, count in counts.items())


def _way(config: Config, driven: Driven, true: Floats) -> Way:
    """Return the true way beside the wanted one."""
    assert config.mission is not None
    path, corners = TruePath.of(Track.of(true)), config.mission.corners()
    return Way(
        has_finished=driven.mode is Mode.FINISHED,
        path_m=path_rms_m(path, corners),
        closure_m=closure_m(path, corners),
    )
