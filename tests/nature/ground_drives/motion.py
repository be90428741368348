"""The rover's way: pose, side slip, tilt, wheel passes, and what its sensors measure."""

from dataclasses import dataclass

import numpy as np

from tests.nature.ground_drives.ground import Terrain
from tests.nature.ground_drives.noise import Points
from tests.nature.ground_drives.rut import Pass

STEP_S = 0.01


@dataclass(frozen=True)
class MotionPlan:
    """How a drive is driven; speeds in m/s, angles in rad, times in s.

    `before_s` is how long the rover had driven before the first frame. `side_slip_rad` is the mean angle of
    the velocity against the heading and `side_slip_rms_rad` its slow variation; `yaw_rate_rad_s` and its
    variation likewise. `tilt_rms_rad` is slow rocking of the body, `shake_rms_rad` fast vibration.
    """

    speed_mps: float
    before_s: float
    duration_s: float
    side_slip_rad: float
    side_slip_rms_rad: float
    yaw_rate_rad_s: float
    yaw_rate_rms_rad_s: float
    slip: float
    slip_rms: float
    tilt_rms_rad: float
    shake_rms_rad: float


@dataclass(frozen=True)
class Motion:
    """Motion every 10 ms; `time_s` is zero at the first frame. Rates are in rad/s, `slip` is longitudinal.

    `level_m` is the height of the rover's origin on the plane through its wheel contacts.
    """

    time_s: Points
    x: Points
    y: Points
    heading_rad: Points
    side_slip_rad: Points
    speed_mps: Points
    yaw_rate_rad_s: Points
    slip: Points
    roll_rad: Points
    pitch_rad: Points
    level_m: Points

    def at(self, values: Points, time_s: float) -> float:
        """Return the value at a time, linear between samples."""
        return float(np.interp(time_s, self.time_s, values))

    def tilt(self, time_s: float) -> Points:
        """Return the (3, 3) rotation from the rover's frame to the level frame of the same heading."""
        roll, pitch = self.at(self.roll_rad, time_s), self.at(self.pitch_rad, time_s)
        about_y = np.asarray(
            ((np.cos(pitch), 0, np.sin(pitch)), (0, 1, 0), (-np.sin(pitch), 0, np.cos(pitch)))
        )
        about_x = np.asarray(((1, 0, 0), (0, np.cos(roll), -np.sin(roll)), (0, np.sin(roll), np.cos(roll))))
        return np.asarray(about_y @ about_x, np.float64)

    def contact(self, contact_point: tuple[float, float]) -> Points:
        """Return the (n, 2) path of a wheel's contact point in the world, m."""
        cos, sin = np.cos(self.heading_rad), np.sin(self.heading_rad)
        return np.column_stack(
            (
                self.x + cos * contact_point[0] - sin * contact_point[1],
                self.y + sin * contact_point[0] + cos * contact_point[1],
            )
        )

    def wheel_direction_rad(self, contact_point: tuple[float, float]) -> Points:
        """Return the direction of a contact point's velocity in the rover's frame."""
        ahead = self.speed_mps * np.cos(self.side_slip_rad) - self.yaw_rate_rad_s * contact_point[1]
        left = self.speed_mps * np.sin(self.side_slip_rad) + self.yaw_rate_rad_s * contact_point[0]
        return np.arctan2(left, ahead)

    def wheel_pass(self, contact_point: tuple[float, float], softness: Points, until_s: float) -> Pass:
        """Return the way of one wheel until a time; `softness` is that of the ground at each sample."""
        count = int(np.searchsorted(self.time_s, until_s, side="right"))
        part = slice(0, count)
        ahead = self.speed_mps * np.cos(self.side_slip_rad) - self.yaw_rate_rad_s * contact_point[1]
        rim = (
            np.cumsum(ahead / (1.0 - self.slip)) * STEP_S + 0.37 * contact_point[0] + 0.11 * contact_point[1]
        )
        return Pass(
            self.contact(contact_point)[part],
            (self.heading_rad + self.wheel_direction_rad(contact_point))[part],
            self.heading_rad[part],
            rim[part],
            softness[part],
        )


def smooth_noise(rng: np.random.Generator, count: int, correlation_s: float) -> Points:
    """Return noise of rms 1 every 10 ms with a Gaussian correlation of about the given time."""
    knots = int(count * STEP_S / (0.5 * correlation_s)) + 8
    values = (
        np.convolve(rng.standard_normal(knots + 8), np.exp(-0.5 * (np.arange(-4, 5) / 1.4) ** 2), "valid")
        / 1.57
    )
    position = 3.0 + np.arange(count) * STEP_S / (0.5 * correlation_s)
    low = position.astype(int)
    part = position - low
    p0, p1, p2, p3 = (values[low + k] for k in (-1, 0, 1, 2))
    curve = p1 + 0.5 * part * (
        p2 - p0 + part * (2 * p0 - 5 * p1 + 4 * p2 - p3 + part * (3 * (p1 - p2) + p3 - p0))
    )
    return np.asarray(curve, np.float64)


def drive(rng: np.random.Generator, plan: MotionPlan, terrain: Terrain, wheels: Points) -> Motion:
    """Integrate the planned motion over the terrain; `wheels` is the (4, 2) list of contact points, m."""
    count = int((plan.before_s + plan.duration_s + 1.0) / STEP_S) + 1
    time_s = np.arange(count) * STEP_S - plan.before_s
    speed = plan.speed_mps * (1.0 + 0.04 * smooth_noise(rng, count, 4.0))
    yaw_rate = plan.yaw_rate_rad_s * (1.0 + 0.3 * smooth_noise(rng, count, 8.0))
    yaw_rate += plan.yaw_rate_rms_rad_s * smooth_noise(rng, count, 3.0)
    limit = 0.35 * plan.speed_mps / 0.325  # keeps the wheel's direction within about 20 degrees of the body's
    yaw_rate = limit * np.tanh(yaw_rate / limit)
    side_slip = plan.side_slip_rad * (1.0 + 0.15 * smooth_noise(rng, count, 6.0))
    side_slip += plan.side_slip_rms_rad * smooth_noise(rng, count, 5.0)
    slip = plan.slip + plan.slip_rms * smooth_noise(rng, count, 4.0)
    slip = np.clip(slip, -0.05, 0.7)
    turned = np.cumsum(yaw_rate) * STEP_S
    start = rng.normal(0.0, 0.01) - float(np.interp(0.0, time_s, turned))
    heading = turned + start
    x = np.cumsum(speed * np.cos(heading + side_slip)) * STEP_S
    y = np.cumsum(speed * np.sin(heading + side_slip)) * STEP_S
    roll, pitch, level = _rest_on(terrain, wheels, x, y, heading)
    rough = smooth_noise(rng, count, 0.7), smooth_noise(rng, count, 0.6)
    fast = smooth_noise(rng, count, 0.12), smooth_noise(rng, count, 0.1)
    roll = roll + plan.tilt_rms_rad * rough[0] + plan.shake_rms_rad * fast[0]
    pitch = pitch + plan.tilt_rms_rad * rough[1] + plan.shake_rms_rad * fast[1]
    series = (time_s, x, y, heading, side_slip, speed, yaw_rate, slip, roll, pitch, level)
    return Motion(*(np.asarray(values, np.float64) for values in series))


def _rest_on(
    terrain: Terrain, wheels: Points, x: Points, y: Points, heading: Points
) -> tuple[Points, Points, Points]:
    """Return roll, pitch (rad) and level (m) of the plane that best fits the ground under the wheels."""
    cos, sin = np.cos(heading)[:, None], np.sin(heading)[:, None]
    heights = terrain.height_m(
        x[:, None] + cos * wheels[:, 0] - sin * wheels[:, 1],
        y[:, None] + sin * wheels[:, 0] + cos * wheels[:, 1],
    )
    fit = np.linalg.pinv(np.column_stack((np.ones(len(wheels)), wheels))) @ heights.T
    return np.arctan(fit[2]), -np.arctan(fit[1]), fit[0]


@dataclass(frozen=True)
class Sensors:
    """Errors of the sensors: standard deviations, constant offsets, scale of the wheel radius."""

    wheel_noise: float
    wheel_scale: float
    compass_noise_deg: float
    compass_offset_deg: float
    gyro_noise_dps: float
    gyro_offset_dps: tuple[float, float, float]


def telemetry(
    rng: np.random.Generator, motion: Motion, times_s: Points, sensors: Sensors, compass_rad: Points
) -> list[tuple[float, ...]]:
    """Return rows (wheel speed, compass, gyro about x, y, z) at the times; `compass_rad` disturbs."""
    ahead = (
        motion.speed_mps * np.cos(motion.side_slip_rad) / (1.0 - motion.slip) * (1.0 + sensors.wheel_scale)
    )
    rates = [np.gradient(angle, STEP_S) for angle in (motion.roll_rad, motion.pitch_rad)] + [
        motion.yaw_rate_rad_s
    ]
    rows = []
    for time_s in times_s:
        wheel = motion.at(ahead, time_s) * (1.0 + rng.normal(0.0, sensors.wheel_noise))
        compass = np.degrees(motion.at(motion.heading_rad, time_s) + motion.at(compass_rad, time_s))
        compass += sensors.compass_offset_deg + rng.normal(0.0, sensors.compass_noise_deg)
        gyro = [
            np.degrees(motion.at(rate, time_s)) + offset + rng.normal(0.0, sensors.gyro_noise_dps)
            for rate, offset in zip(rates, sensors.gyro_offset_dps, strict=True)
        ]
        rows.append((wheel, float(compass), *(float(v) for v in gyro)))
    return rows
