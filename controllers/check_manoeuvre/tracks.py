"""What the sources measure during the check manoeuvre."""

import math
from typing import NamedTuple, TypeVar

import numpy as np

from controllers.check_manoeuvre.relation import Array, Places
from controllers.estimation.ground.travel import GroundPair
from controllers.estimation.positions.pose_fix import has_yaw
from controllers.estimation.settings import FilterSettings
from controllers.motion.planar import Pose
from controllers.roles import DeviceRoles
from drivers.clock import seconds
from drivers.samples import HeadingSample, PoseFixSample, RateSample, Sample

ReadingT = TypeVar("ReadingT")

MOST_READINGS = 100_000
"""Of each source: more than a device sends in the longest manoeuvre, but for one that floods."""
GYRO_GAP_S = 0.5
"""The rotation between two rates that are farther apart is not known."""


class RotationTrack(NamedTuple):
    """The yaw of the rover by one source, from any zero.

    Attributes:
        device: Its name.
        t_s: Times of the readings, (n,).
        angle_rad: Yaw, not wrapped, (n,).
        sd_rad: Standard deviation of one reading; of an integrated rate that of a second.
        is_integrated: Whether it is a sum of increments, whose errors add up.
        drifts: Whether its offset grows with time.
        lag_s: Time constant with which it follows the rotation; 0 for none.
    """

    device: str
    t_s: Array
    angle_rad: Array
    sd_rad: float
    is_integrated: bool = False
    drifts: bool = False
    lag_s: float = 0.0

    def late_rad(self, lag_s: float) -> Array:
        """Return the yaw as a source of another lag would follow it: of first order, from rest."""
        own_s = max(0.0, lag_s - self.lag_s)
        if own_s == 0.0 or not len(self.t_s):
            return self.angle_rad
        late_rad = self.angle_rad.copy()
        keeps = np.exp(-np.diff(self.t_s) / own_s)
        for index, keep in enumerate(keeps, 1):
            late_rad[index] = keep * late_rad[index - 1] + (1.0 - keep) * self.angle_rad[index]
        return late_rad


class PlaceTrack(NamedTuple):
    """Positions by one source.

    Attributes:
        device: Its name.
        t_s: Times, (n,).
        place_m: Positions x + i y in the frame of the source, (n,).
        yaw_rad: Yaw at each in the same frame, nan where it was not measured, (n,).
        arm_m: Where on the rover they were measured, (n,).
        sd_m: Standard deviation of x and of y.
    """

    device: str
    t_s: Array
    place_m: Places
    yaw_rad: Array
    arm_m: Places
    sd_m: float


class Tracks:
    """Collects the readings of all sources that have a role.

    Args:
        roles: Which device is what.
        settings: Noise of the sources.
    """

    def __init__(self, roles: DeviceRoles, settings: FilterSettings) -> None:
        self._roles, self._settings = roles, settings
        self._wheels: list[tuple[float, float, float, float]] = []
        self._rates: list[tuple[float, float]] = []
        self._headings: dict[tuple[str, str], list[tuple[float, float]]] = {}
        self._fixes: dict[str, list[PoseFixSample]] = {name: [] for name in roles.fixes}
        self._pairs: list[GroundPair] = []
        self._yaw_rad = 0.0

    def take(self, sample: Sample, t_ns: int) -> None:
        """Take one sample as of `t_ns`; others than rates, headings and fixes have no effect."""
        if isinstance(sample, RateSample) and sample.device == self._roles.gyro:
            _append(self._rates, (seconds(t_ns), sample.rate_z_rad_s), sample.rate_z_rad_s)
        elif isinstance(sample, HeadingSample) and sample.device in self._roles.headings:
            headings = self._headings.setdefault((sample.device, sample.reference), [])
            _append(headings, (seconds(t_ns), sample.heading_rad), sample.heading_rad)
        elif isinstance(sample, PoseFixSample) and sample.device in self._fixes:
            _append(self._fixes[sample.device], sample, sample.x_m + sample.y_m)

    def take_wheels(self, t_ns: int, pose: Pose) -> None:
        """Take the pose of the wheel odometry."""
        self._yaw_rad += math.remainder(pose.yaw_rad - self._yaw_rad, math.tau)
        if not self._wheels or seconds(t_ns) > self._wheels[-1][0]:
            reading = (seconds(t_ns), pose.x_m, pose.y_m, self._yaw_rad)
            _append(self._wheels, reading, sum(reading))

    def take_ground(self, pairs: tuple[GroundPair, ...]) -> None:
        """Take motions over the ground that a camera has measured."""
        self._pairs += pairs[: MOST_READINGS - len(self._pairs)]

    def rotations(self) -> list[RotationTrack]:
        """Return the yaw by every source that measures it: wheels, gyro, headings, poses, in this order."""
        wheels = np.array(self._wheels).reshape(-1, 4)
        tracks = [RotationTrack(self._roles.wheels, wheels[:, 0], wheels[:, 3], 0.0, is_integrated=True)]
        if self._roles.gyro is not None:
            tracks.append(self._gyro(self._roles.gyro))
        noise_rad, lag_s = self._settings.heading_noise_rad, self._settings.heading_lag_s
        missing = [
            (name, "") for name in self._roles.headings if name not in {key[0] for key in self._headings}
        ]
        for name, reference in (*self._headings, *missing):
            t_s, heading_rad = np.array(self._headings.get((name, reference), [])).reshape(-1, 2).T
            tracks.append(RotationTrack(name, t_s, np.unwrap(heading_rad), noise_rad, lag_s=lag_s))
        for name, fixes in self._fixes.items():
            posed = [fix for fix in fixes if has_yaw(fix) and math.isfinite(fix.yaw_rad)]
            if posed:
                t_s = np.array([seconds(fix.t_capture_ns) for fix in posed])
                yaw_rad = np.unwrap([fix.yaw_rad for fix in posed])
                sd_rad = float(np.median([fix.yaw_std_rad for fix in posed]))
                tracks.append(RotationTrack(name, t_s, yaw_rad, sd_rad))
        return tracks

    def places(self) -> list[PlaceTrack]:
        """Return the positions by every source that measures them."""
        return [
            PlaceTrack(
                name,
                np.array([seconds(fix.t_capture_ns) for fix in fixes]),
                np.array([complex(fix.x_m, fix.y_m) for fix in fixes]),
                np.array([fix.yaw_rad if has_yaw(fix) else math.nan for fix in fixes]),
                np.array([complex(fix.arm_x_m, fix.arm_y_m) for fix in fixes]),
                float(np.median([fix.alone_std_m or fix.position_std_m for fix in fixes])) if fixes else 0.0,
            )
            for name, fixes in self._fixes.items()
        ]

    def by_wheels(self, t_s: Array, arm_m: Places) -> tuple[Places, Array]:
        """Return where the wheels had moved a point of the rover, x + i y, and its yaw, at each time."""
        wheels = np.array(self._wheels).reshape(-1, 4)
        x_m, y_m, yaw_rad = (np.interp(t_s, wheels[:, 0], wheels[:, column]) for column in (1, 2, 3))
        place_m: Places = x_m + 1j * y_m + arm_m * np.exp(1j * yaw_rad)
        return place_m, yaw_rad

    @property
    def span_s(self) -> tuple[float, float]:
        """First and last time at which the wheels were measured; equal without any."""
        return (self._wheels[0][0], self._wheels[-1][0]) if self._wheels else (0.0, 0.0)

    def ground(self) -> tuple[Array, Array, float]:
        """Return forward motions by wheels and camera, (n,) each, and the latter's standard deviation."""
        rolled_m = np.array([pair.rolled_m.real for pair in self._pairs])
        seen_m = np.array([pair.ground_m.real for pair in self._pairs])
        return rolled_m, seen_m, float(np.median([pair.sd_m for pair in self._pairs])) if self._pairs else 0.0

    def _gyro(self, name: str) -> RotationTrack:
        t_s, rate_rad_s = np.array(self._rates).reshape(-1, 2).T
        steps_s = np.diff(t_s)
        steps_rad = np.where(steps_s <= GYRO_GAP_S, 0.5 * (rate_rad_s[1:] + rate_rad_s[:-1]) * steps_s, 0.0)
        angle_rad = np.concatenate(([0.0], np.cumsum(steps_rad))) if len(t_s) else t_s
        noise_rad = self._settings.gyro_noise_rad_sqrt_s
        return RotationTrack(name, t_s, angle_rad, noise_rad, is_integrated=True, drifts=True)


def _append(readings: list[ReadingT], reading: ReadingT, value: float) -> None:
    """Add a reading, unless its value is not finite, or there are too many."""
    if len(readings) < MOST_READINGS and math.isfinite(value):
        readings.append(reading)
