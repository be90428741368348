"""Logs that an estimator can be judged by, and what judges it."""

import hashlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from controllers.motion.kinematics import make_kinematics
from controllers.motion.rover_geometry import RoverSettings
from drivers.clock import nanoseconds
from drivers.errors import ConfigError, LogError
from drivers.files import LOG_COPY_BYTES, read_bytes
from rover_hil.config import Config
from rover_hil.drives.channels import POSE
from rover_hil.drives.drive import Drive, read_drive
from rover_hil.drives.ground_truth import TruePoses

POSE_PERIOD_S = 0.5
FIRST_M = 0.1
FIRST_RAD = 0.2
LEAST_FIXES = 4
START_RAD = 0.05
DIMENSION_SHARE = 0.1
DIMENSION_M = 0.002
HELD_OUT_EVERY = 3
JUDGED = ("t_ns", "x_m", "y_m", "yaw_rad", "position_sd_m", "yaw_sd_rad")


@dataclass(frozen=True, slots=True, kw_only=True)
class JudgedLog:
    """A log for another machine, and what judges the estimates of its replay.

    Attributes:
        name: The path as it was given.
        content: The file.
        source: What judges, in words.
        poses: Independent poses in the local frame that the filter has not used, all after the first motion;
            None where the pose fixes that the filter uses are the only ones. It then gets one in
            `withheld_s`, and each is compared with the prediction before it is used.
        withheld_s: See `poses`.
    """

    name: str
    content: bytes
    source: str
    poses: TruePoses | None
    withheld_s: float

    @property
    def digest(self) -> str:
        """SHA-256 of the content."""
        return hashlib.sha256(self.content).hexdigest()

    @property
    def setting(self) -> str:
        """SHA-256 of all that costs depend on: the content and what judges it."""
        digest = hashlib.sha256(self.content)
        if self.poses is not None:
            for column in JUDGED:
                digest.update(getattr(self.poses, column).tobytes())
        return digest.hexdigest()


def read_judged_logs(paths: Sequence[Path], config: Config, withheld_s: float) -> list[JudgedLog]:
    """Return logs of the rover of a configuration.

    Raises:
        LogError: A log cannot be read, or has nothing to judge by.
        ConfigError: A log is of another rover, or two are the same.
    """
    logs = [_read(path, config, withheld_s) for path in paths]
    names: dict[str, str] = {}
    for log in logs:
        if log.digest in names:
            raise ConfigError(
                f"{names[log.digest]} and {log.name} are the same log: give each once, to train or held out"
            )
        names[log.digest] = log.name
    return logs


def split(logs: Sequence[JudgedLog]) -> tuple[list[JudgedLog], list[JudgedLog]]:
    """Return training and held-out logs: every third is held out, of two the second.

    Raises:
        ConfigError: There are fewer than two.
    """
    if len(logs) < 2:
        raise ConfigError(
            "this is one log, but values that are tuned on a log must be judged on another: give more, "
            "or one with --held-out"
        )
    every = min(HELD_OUT_EVERY, len(logs))
    held_out = [log for index, log in enumerate(logs, start=1) if index % every == 0]
    return [log for log in logs if log not in held_out], held_out


def _read(path: Path, config: Config, withheld_s: float) -> JudgedLog:
    try:
        content = read_bytes(path, LOG_COPY_BYTES)
    except OSError as error:
        raise LogError(f"cannot read log {path}: {error.strerror}") from error
    drive = read_drive(path)
    _check_rover(path, drive.config.rover, config.rover)
    poses = drive.true_poses()
    by_fixes = POSE[0] not in drive.channels and drive.fixes() is not None
    if by_fixes:
        _check_fixes(path, poses, withheld_s)
    return JudgedLog(
        name=str(path),
        content=content,
        source=f"{poses.source}, each before its use" if by_fixes else poses.source,
        poses=None if by_fixes else _judge_poses(path, drive, poses),
        withheld_s=withheld_s,
    )


def _check_fixes(path: Path, fixes: TruePoses, withheld_s: float) -> None:
    span_s = float(fixes.t_ns[-1] - fixes.t_ns[0]) / 1e9
    if span_s < LEAST_FIXES * withheld_s:
        raise LogError(
            f"log {path} holds pose fixes over {span_s:.0f} s: at least {LEAST_FIXES * withheld_s:g} s are "
            "needed to judge by them, or a smaller tune.logs.withheld_s"
        )


def _judge_poses(path: Path, drive: Drive, poses: TruePoses) -> TruePoses:
    """Return poses half a second apart from the first motion on, in the local frame of the filter.

    Raises:
        LogError: The rover does not move, or the first pose is not that of the start.
    """
    _check_start(path, drive, poses)
    cosine, sine = np.cos(poses.yaw_rad[0]), np.sin(poses.yaw_rad[0])
    right_m, up_m = poses.x_m - poses.x_m[0], poses.y_m - poses.y_m[0]
    x_m, y_m = cosine * right_m + sine * up_m, cosine * up_m - sine * right_m
    yaw_rad = poses.yaw_rad - poses.yaw_rad[0]
    # The error of the first pose is in all others; that of its yaw counts as far away from it as they are.
    way_sd_m = np.hypot(x_m, y_m) * poses.yaw_sd_rad[0]
    position_sd_m = np.sqrt(poses.position_sd_m**2 + poses.position_sd_m[0] ** 2 + way_sd_m**2)
    yaw_sd_rad = np.hypot(poses.yaw_sd_rad, poses.yaw_sd_rad[0])
    moved = (np.hypot(x_m, y_m) > FIRST_M) | (np.abs(yaw_rad) > FIRST_RAD)
    kept: list[int] = []
    newest_ns = -nanoseconds(POSE_PERIOD_S)
    for index in np.flatnonzero(np.logical_or.accumulate(moved)).tolist():
        if poses.t_ns[index] - newest_ns >= nanoseconds(POSE_PERIOD_S):
            kept.append(index)
            newest_ns = int(poses.t_ns[index])
    if not kept:
        raise LogError(f"the rover does not move in log {path}: give a log of a drive")
    return TruePoses(
        source=poses.source,
        t_ns=poses.t_ns[kept],
        x_m=x_m[kept],
        y_m=y_m[kept],
        yaw_rad=yaw_rad[kept],
        position_sd_m=position_sd_m[kept],
        yaw_sd_rad=yaw_sd_rad[kept],
    )


def _check_start(path: Path, drive: Drive, poses: TruePoses) -> None:
    """Check that no wheel has turned before the first pose.

    Raises:
        LogError: One has.
    """
    for wheel in range(1, make_kinematics(drive.config.rover).wheel_count + 1):
        if _turn_rad(drive, wheel, int(poses.t_ns[0])) > START_RAD:
            raise LogError(
                f"log {path}: its first known position is after the first motion, so the rest cannot be "
                "compared with the estimate: measure where the rover starts, too"
            )


def _turn_rad(drive: Drive, wheel: int, until_ns: int) -> float:
    """Return by how much a wheel, counted from 1, has turned back and forth until a time."""
    position, speed = drive.channels[f"position{wheel}_rad"], drive.channels[f"speed{wheel}_rad_s"]
    if len(position):
        angle_rad = position.value[position.t_ns <= until_ns]
    else:
        steps_s = np.diff(speed.t_ns, prepend=speed.t_ns[:1]) / 1e9
        angle_rad = np.cumsum(speed.value * steps_s)[speed.t_ns <= until_ns]
    return float(np.ptp(angle_rad)) if angle_rad.size else 0.0


def _check_rover(path: Path, logged: RoverSettings, rover: RoverSettings) -> None:
    """Check that a log is of a rover of the same shape; a calibration may have changed its dimensions a bit.

    Raises:
        ConfigError: It is of another rover.
    """
    reason = ""
    if logged.kinematics != rover.kinematics:
        reason = f"rover.kinematics is '{logged.kinematics}' there and '{rover.kinematics}' here"
    elif make_kinematics(logged).wheel_count != make_kinematics(rover).wheel_count:
        reason = "the number of wheels differs"
    else:
        there = dict(_dimensions(logged.model_dump(), "rover"))
        here = dict(_dimensions(rover.model_dump(), "rover"))
        for key in [*there, *(key for key in here if key not in there)]:
            value, own = there.get(key, np.nan), here.get(key, np.nan)
            if not abs(value - own) <= DIMENSION_SHARE * max(abs(value), abs(own)) + DIMENSION_M:
                reason = f"{key} is {value:g} m there and {own:g} m here"
                break
    if reason:
        raise ConfigError(f"log {path} is of another rover than the configuration: {reason}")


def _dimensions(value: object, key: str) -> Iterator[tuple[str, float]]:
    if isinstance(value, dict):
        for name, inner in value.items():
            yield from _dimensions(inner, f"{key}.{name}")
    elif isinstance(value, list | tuple):
        for index, inner in enumerate(value):
            yield from _dimensions(inner, f"{key}[{index}]")
    elif isinstance(value, float) and key.endswith("_m"):
        yield key, value
