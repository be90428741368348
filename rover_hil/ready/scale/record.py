"""A drive as its camera and what is known of it measure the travel, pair of frames by pair of frames."""

import math
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from controllers.ground_motion.estimator import GroundMotionEstimator
from controllers.ground_motion.ground_patch import GroundPatch
from controllers.ground_motion.ground_view import GroundView
from controllers.ground_motion.motion import GroundMotion, Rates
from controllers.ground_motion.parameters import DEFAULTS
from controllers.ground_motion.prior import MotionPrior, turned
from controllers.ground_motion.rig import RigFile
from controllers.ground_motion.settings import GroundMotionSettings
from controllers.motion.kinematics import make_kinematics
from drivers.clock import nanoseconds, seconds
from drivers.errors import LogError
from drivers.samples import Image
from rover_hil.config import Config
from rover_hil.drives.arrays import Array, Times
from rover_hil.drives.channels import Channels
from rover_hil.drives.drive import Drive
from rover_hil.drives.ground_truth import TruePoses
from rover_hil.ground.picture import draw

RATES = ("gyro_x_rad_s", "gyro_y_rad_s", "gyro_z_rad_s")
WHEELS = "wheels"
FREE_TURN_SD_RAD = 0.05
"""Of a pair, where the camera alone is to measure the turn: many times what the picture leaves open."""


class NothingToCompareError(LogError):
    """A log without frames of the camera, or without positions of the wheels."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Travel:
    """Travel between two frames, in the axes of the later one, forward and left as a complex number.

    Attributes:
        known_m: Of the measured point, by fixes or wheels.
        camera_m: The same by the camera; None where not valid.
    """

    known_m: complex
    camera_m: complex | None


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraTravels:
    """Travel in a drive by its camera, and by what is known.

    Attributes:
        path: The log.
        wall_ns: When it was recorded, ns since 1970.
        reference: What is known, in words: the pose fixes, or the wheels.
        known_sd_m: Standard deviation of a position by the fixes; 0 for wheels.
        rig: Calibration of the camera.
        travels: Pair by pair; one that is not valid ends a piece of the drive.
        reasons: Why pairs are not valid, and how many.
        picture: The ground from above at the last valid pair, with what is left out; None without one.
    """

    path: Path
    wall_ns: int
    reference: str
    known_sd_m: float
    rig: RigFile
    travels: tuple[Travel, ...]
    reasons: dict[str, int]
    picture: Image | None

    @property
    def height_m(self) -> float:
        """Height of the camera above the ground, by its rig."""
        return self.rig.t_vehicle_camera[2]


def read_scale_record(path: Path) -> CameraTravels:
    """Return the travel in a log by its camera, and by pose fixes, or by the wheels where there are none.

    The camera's travel is that of its rig alone: a scale in the configuration is left out, and without fixes
    the usual sinkage, for the wheels must then roll on firm ground.

    Raises:
        LogError: The log is damaged, or holds no [ground_motion], no frames or no wheels.
    """
    drive = Drive(path)
    log, config = drive.log, drive.config
    settings = config.ground_motion
    if settings is None or config.roles.camera is None:
        raise LogError(f"log {path} is of a rover without [ground_motion]: its camera has no rig")
    wheels = _Wheels(config, drive.read().channels, path)
    fixes = drive.fixes()
    sinkage_m = 0.0 if fixes is None else settings.tolerance.sinkage_m
    tolerance = settings.tolerance.model_copy(update={"scale": 1.0, "scale_sd": None, "sinkage_m": sinkage_m})
    alone = settings.model_copy(update={"tolerance": tolerance})
    point_m = complex(*settings.rig.geometry().point_m)
    travels: list[Travel] = []
    reasons: Counter[str] = Counter()
    meter = _meter(alone)
    view, picture = GroundView(GroundPatch(settings.rig.geometry())), None
    for image, motion in _pairs(drive, alone, wheels, meter):
        if motion.invalid_because:
            reasons[motion.invalid_because] += 1
        if motion.is_valid:
            picture = draw(image, view, meter, path.name)
        if not motion.is_open:
            travels.append(_travel(motion, wheels, fixes, point_m))
    sds = np.zeros(1) if fixes is None else fixes.position_sd_m
    return CameraTravels(
        path=path,
        wall_ns=log.start_ns + log.wall_offset_ns,
        reference=WHEELS if fixes is None else fixes.source,
        known_sd_m=float(np.sqrt(np.mean(sds**2))),
        rig=settings.rig,
        travels=tuple(travels),
        reasons=dict(reasons),
        picture=picture,
    )


def read_ground_yaw(drive: Drive) -> tuple[Times, Array] | None:
    """Return frame times and the yaw by the camera alone, over its longest run of valid pairs.

    Times are those of the frames, without `camera_delay_s`. None without [ground_motion], frames or wheels.

    Args:
        drive: Read to its end.

    Raises:
        LogError: The log is damaged.
    """
    settings = drive.config.ground_motion
    if settings is None or drive.config.roles.camera is None:
        return None
    stamped = settings.model_copy(update={"camera_delay_s": 0.0})
    runs: list[list[tuple[int, float]]] = [[]]
    try:
        wheels = _Wheels(drive.config, drive.channels, drive.log.path)
        meter = _meter(stamped)
        for _, motion in _pairs(drive, stamped, wheels, meter, turn_sd_rad=FREE_TURN_SD_RAD):
            if motion.is_open:
                continue
            if not motion.is_valid:
                runs.append([])
                continue
            if not runs[-1]:
                runs[-1].append((motion.from_ns, 0.0))
            runs[-1].append((motion.to_ns, runs[-1][-1][1] + motion.turn_rad))
    except NothingToCompareError:
        return None
    longest = max(runs, key=len)
    return np.array([t_ns for t_ns, _ in longest], np.int64), np.array([yaw for _, yaw in longest])


def _pairs(
    drive: Drive,
    settings: GroundMotionSettings,
    wheels: "_Wheels",
    meter: GroundMotionEstimator,
    *,
    turn_sd_rad: float | None = None,
) -> Iterator[tuple[Image, GroundMotion]]:
    """Yield frame and motion of each pair of frames.

    Args:
        drive: Read to its end.
        settings: Those of the camera.
        wheels: Where the search begins.
        meter: Measures the motion.
        turn_sd_rad: Standard deviation of the turn by the wheels, which is then used instead of the gyro's.
    """
    point_m = complex(*settings.rig.geometry().point_m)
    before: tuple[int, Rates | None] | None = None
    for t_ns, image in _frames(drive, settings):
        if before is not None and t_ns <= before[0]:
            continue
        rates = None if turn_sd_rad is not None else _rates_at(drive.channels, t_ns)
        from_ns, old_rates = (t_ns, None) if before is None else before
        before = t_ns, rates
        rolled_m, turn_rad = wheels.between(from_ns, t_ns, point_m)
        angles, deviations = turned(rates, old_rates, seconds(t_ns - from_ns), DEFAULTS.turn)
        if rates is None:
            angles = (0.0, 0.0, turn_rad)
        if turn_sd_rad is not None:
            deviations = (*deviations[:2], turn_sd_rad)
        prior = MotionPrior(
            forward_m=rolled_m.real, left_m=rolled_m.imag, turn_rad=angles, turn_sd_rad=deviations
        )
        motion = meter.step(t_ns, image, prior)
        if motion is not None:
            yield image, motion


def _meter(settings: GroundMotionSettings) -> GroundMotionEstimator:
    return GroundMotionEstimator(GroundView(GroundPatch(settings.rig.geometry())), settings.tolerance)


class _Wheels:
    """Motion by rolling wheels between two times.

    Raises:
        NothingToCompareError: The log holds no positions of the wheels.
    """

    def __init__(self, config: Config, rows: Channels, path: Path) -> None:
        self._kinematics = make_kinematics(config.rover)
        positions = [rows[f"position{wheel + 1}_rad"] for wheel in range(self._kinematics.wheel_count)]
        if not all(len(each) > 1 for each in positions):
            raise NothingToCompareError(
                f"log {path} holds no positions of the wheels: record a drive with `rover-hil run`"
            )
        orders = [np.argsort(each.t_ns, kind="stable") for each in positions]
        self._t_ns = [each.t_ns[order] for each, order in zip(positions, orders, strict=True)]
        self._angles_rad = [each.value[order] for each, order in zip(positions, orders, strict=True)]

    def between(self, from_ns: int, to_ns: int, point_m: complex) -> tuple[complex, float]:
        """Return the travel of a point in the axes of the later time, and the turn."""
        rolled_rad = [
            float(np.diff(np.interp([from_ns, to_ns], t_ns, angle_rad))[0])
            for t_ns, angle_rad in zip(self._t_ns, self._angles_rad, strict=True)
        ]
        x_m, y_m, turn_rad = self._kinematics.body_motion(rolled_rad)
        half = complex(math.cos(turn_rad / 2), -math.sin(turn_rad / 2))
        swing_m = point_m * (1 - complex(math.cos(turn_rad), -math.sin(turn_rad)))
        return complex(x_m, y_m) * half + swing_m, turn_rad


def _frames(drive: Drive, settings: GroundMotionSettings) -> Iterator[tuple[int, Image]]:
    """Yield the frames with the middle of their exposure."""
    camera = str(drive.config.roles.camera)
    size = (settings.rig.image.height, settings.rig.image.width)
    count = 0
    for t_ns, picture in drive.pictures(camera):
        if picture.image.shape[:2] != size:
            continue
        count += 1
        yield t_ns - nanoseconds(settings.camera_delay_s), picture.image
    if not count:
        raise NothingToCompareError(f"log {drive.log.path} holds no frames of '{camera}'")


def _rates_at(rows: Channels, t_ns: int) -> Rates | None:
    rates = []
    for name in RATES:
        readings = rows[name]
        place = int(np.searchsorted(readings.t_ns, t_ns, side="right")) - 1
        if place < 0:
            return None
        rates.append(float(readings.value[place]))
    x, y, z = rates
    return (x, y, z) if math.isfinite(x + y + z) else None


def _travel(motion: GroundMotion, wheels: _Wheels, fixes: TruePoses | None, point_m: complex) -> Travel:
    if fixes is None:
        known_m, _ = wheels.between(motion.from_ns, motion.to_ns, point_m)
    else:
        known_m = _between_fixes(fixes, motion.from_ns, motion.to_ns, point_m)
    camera_m = complex(motion.forward_m, motion.left_m) if motion.is_valid else None
    return Travel(known_m=known_m, camera_m=camera_m)


def _between_fixes(fixes: TruePoses, from_ns: int, to_ns: int, point_m: complex) -> complex:
    """Return the travel of a point between two times by interpolated fixes; NaN outside of them."""
    if from_ns < fixes.t_ns[0] or to_ns > fixes.t_ns[-1]:
        return complex(math.nan, math.nan)
    x_m, y_m, yaw_rad = (
        np.interp([from_ns, to_ns], fixes.t_ns, each) for each in (fixes.x_m, fixes.y_m, fixes.yaw_rad)
    )
    places = (x_m + 1j * y_m) + point_m * np.exp(1j * yaw_rad)
    return complex((places[1] - places[0]) * np.exp(-1j * yaw_rad[1]))
