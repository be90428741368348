"""Errors of the estimates that a log gives with some values, and of their covariance."""

import math
import tempfile
from collections import defaultdict
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from controllers.control_loop import StepOutput
from controllers.estimation.filter.guarded_filter import Innovation
from controllers.estimation.filter.measurement_model import Measured
from controllers.estimation.positions.frames import DISPLACED, TURNED
from drivers.clock import nanoseconds
from drivers.errors import LogError
from drivers.samples import PoseFixSample, Sample
from rover_hil.config import Config
from rover_hil.drives.arrays import Array
from rover_hil.drives.ground_truth import TruePoses
from rover_hil.recording.data_files import restore_config, with_controller_of
from rover_hil.recording.reader import LogReader
from rover_hil.run.replay import estimate_again
from rover_hil.tune.logs.judged_log import JudgedLog

FLOOR_M = 0.001
FLOOR_RAD = 0.002
"""Error of a pose that counts as exact: it is interpolated between cycles."""
CONTRADICTED_NEES = 100.0
"""Of a fix that the filter took only after it had given up its own estimate."""
PARTS = ("x", "y", "yaw")


@dataclass(frozen=True, slots=True)
class ReplayErrors:
    """Errors of the estimates of one log.

    Attributes:
        name: Of the log.
        refused: Why the values are rejected; empty when they are acceptable.
        position_m: Error of the position at each judged pose, (n,).
        yaw_rad: Error of the yaw, (n,).
        position_nees: Normalised estimation error squared of the position over its dimension, 2, (n,).
        yaw_nees: The same of the yaw.
        innovations: Innovations over their standard deviation by kind of measurement, without the first of
            each kind, which ties frames together, and without those that judge.
    """

    name: str
    refused: str
    position_m: Array
    yaw_rad: Array
    position_nees: Array
    yaw_nees: Array
    innovations: dict[str, Array]


def replay_with(log: JudgedLog, config: Config) -> ReplayErrors:
    """Return the errors of a log's estimates with the controller of a configuration.

    Raises:
        LogError: The log is damaged.
    """
    with tempfile.TemporaryDirectory(prefix="rover_hil_") as folder:
        path = Path(folder) / "run.mcap"
        path.write_bytes(log.content)
        reader = LogReader(path)
        with restore_config(reader) as logged:
            # The mission stays: it is what the rover drove.
            controlled = with_controller_of(logged, config).model_copy(update={"mission": logged.mission})
            fixes = logged.fix_sources
            is_used = _every(log.withheld_s, fixes) if log.poses is None else lambda _: True
            outputs = list(estimate_again(reader, controlled, is_used))
    if not outputs:
        raise LogError(f"log {log.name} holds no complete cycle")
    if not all(output.estimate.is_finite for output in outputs):
        return ReplayErrors(log.name, "the estimate is not finite", *4 * (np.zeros(0),), innovations={})
    kinds, judged = _sort(outputs, () if log.poses is not None else fixes)
    errors = _errors_at_fixes(judged) if log.poses is None else _errors_at(log.poses, outputs)
    if not len(errors.position_m):
        raise LogError(f"log {log.name} holds no known pose that its estimates could be compared with")
    innovations = {name: np.array(values[1:]) for name, values in kinds.items()}
    return ReplayErrors(log.name, "", *errors, innovations=innovations)


def _every(period_s: float, devices: Sequence[str]) -> Callable[[Sample], bool]:
    """Return what takes one fix in a time, whichever device sent it, and every other sample."""
    next_ns = 0

    def is_used(sample: Sample) -> bool:
        nonlocal next_ns
        if not isinstance(sample, PoseFixSample) or sample.device not in devices:
            return True
        is_due = sample.t_capture_ns >= next_ns
        if is_due:
            next_ns = sample.t_capture_ns + nanoseconds(period_s)
        return is_due

    return is_used


def _sort(
    outputs: Iterable[StepOutput], judging: Iterable[str]
) -> tuple[dict[str, list[float]], list[tuple[Innovation, ...]]]:
    """Return scaled innovations by kind, and the innovations of each fix that judges, without the first."""
    kinds: defaultdict[str, list[float]] = defaultdict(list)
    fixes: defaultdict[str, list[tuple[Innovation, ...]]] = defaultdict(list)
    for output in outputs:
        innovations = {innovation.measured: innovation for innovation in output.innovations}
        for device in judging:
            is_displaced = Measured(device, DISPLACED) in innovations
            wanted = [Measured(device, part) for part in ((DISPLACED, TURNED) if is_displaced else PARTS)]
            of_fix = tuple(innovations[each] for each in wanted if each in innovations)
            if len(of_fix) == len(wanted) and all(each.residual is not None for each in of_fix):
                fixes[device].append(of_fix)
        of_judges = {Measured(device, part) for device in judging for part in PARTS}
        for innovation in output.innovations:
            if innovation.residual is None or not innovation.variance or innovation.measured in of_judges:
                continue
            kinds[innovation.name].append(innovation.residual / math.sqrt(innovation.variance))
    return kinds, [of_fix for device in fixes.values() for of_fix in device[1:]]


class _Errors(NamedTuple):
    """Errors at n poses; see `ReplayErrors`."""

    position_m: Array
    yaw_rad: Array
    position_nees: Array
    yaw_nees: Array


def _errors_at_fixes(fixes: Iterable[tuple[Innovation, ...]]) -> _Errors:
    """Return the errors by innovations before the update."""
    rows: list[tuple[float, float, float, float]] = []
    for of_fix in fixes:
        *position_m, yaw_rad = (innovation.residual or 0.0 for innovation in of_fix)
        *position_nees, yaw_nees = (
            CONTRADICTED_NEES if innovation.nis is None else innovation.nis for innovation in of_fix
        )
        rows.append(
            (math.hypot(*position_m), yaw_rad, math.fsum(position_nees) / len(position_nees), yaw_nees)
        )
    return _Errors(*np.array(rows, dtype=np.float64).reshape(-1, 4).T)


def _errors_at(poses: TruePoses, outputs: Iterable[StepOutput]) -> _Errors:
    """Return the errors at the times of independent poses."""
    rows = [
        (
            output.estimate.t_ns,
            output.estimate.x_m,
            output.estimate.y_m,
            output.estimate.yaw_rad,
            *output.estimate.covariance,
        )
        for output in outputs
    ]
    start_ns = rows[0][0]
    table = np.array([(row[0] - start_ns, *row[1:]) for row in rows], dtype=np.float64)
    table = table[np.concatenate((np.diff(table[:, 0]) > 0.0, [True]))]
    t_s, x_m, y_m, yaw_rad = table[:, :4].T
    judged_s = (poses.t_ns - start_ns).astype(np.float64)
    within = (judged_s >= t_s[0]) & (judged_s <= t_s[-1])
    at = judged_s[within]
    error = np.column_stack(
        (
            np.interp(at, t_s, x_m) - poses.x_m[within],
            np.interp(at, t_s, y_m) - poses.y_m[within],
            np.interp(at, t_s, np.unwrap(yaw_rad)) - poses.yaw_rad[within],
        )
    )
    error[:, 2] = np.angle(np.exp(1j * error[:, 2]))
    xx, xy, _, yy, _, tt = table[np.searchsorted(t_s, at), 4:].T
    position2 = poses.position_sd_m[within] ** 2 + FLOOR_M**2
    yaw2 = poses.yaw_sd_rad[within] ** 2 + FLOOR_RAD**2
    xx, yy = xx + position2, yy + position2
    x_error, y_error, yaw_error = error.T
    return _Errors(
        position_m=np.hypot(x_error, y_error),
        yaw_rad=yaw_error,
        position_nees=0.5
        * (yy * x_error**2 - 2.0 * xy * x_error * y_error + xx * y_error**2)
        / (xx * yy - xy**2),
        yaw_nees=yaw_error**2 / (tt + yaw2),
    )
