"""The motion of a rover on a ground: exact arcs of each step, and what its sensors report."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tests.nature.region_drives.grounds import Contact, Ground
from tests.nature.region_drives.plans import STEP_S
from tests.nature.region_drives.rovers import STEERING_STEP_RAD, Rover

Array = NDArray[np.float64]

ROW_STEPS = 2
ROW_S = ROW_STEPS * STEP_S
LAG_S = 0.15
YAW_GAIN = 1.0
MOST_CORRECTION_RAD_S = 0.4
DEAD_BAND_RAD_S = math.radians(0.2)


@dataclass(frozen=True, kw_only=True)
class Driven:
    """A drive at 50 Hz.

    Attributes:
        t_s: Times, shape (n,).
        pose: Ground truth x, y, yaw in the frame of the start, shape (n, 3).
        rate: True yaw rate at the times, shape (n,).
        angles: Angles of the wheels since the start, shape (n, wheels), rad.
        steering: Steering angles, shape (n, wheels), rad.
        nominal: Twist of the wheels without slip, shape (n, 3).
        travel_m: Distance of the origin by the wheels, shape (n,).
    """

    t_s: Array
    pose: Array
    rate: Array
    angles: Array
    steering: Array
    nominal: Array
    travel_m: Array


def moved(pose: Array, twist: Array, seconds: float) -> Array:
    """Return the pose after a constant twist: the exact arc."""
    forward, left, rate = (twist * seconds).tolist()
    if abs(rate) < 1e-9:
        a, b = 1.0, 0.5 * rate
    else:
        a, b = math.sin(rate) / rate, (1.0 - math.cos(rate)) / rate
    x, y = a * forward - b * left, b * forward + a * left
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    return np.array((pose[0] + cos * x - sin * y, pose[1] + sin * x + cos * y, pose[2] + rate))


def drive(rover: Rover, ground: Ground, commanded: Array, *, follows_yaw: bool = True) -> Driven:
    """Return the motion of a rover whose wheels follow commands with a lag.

    The yaw of the plan is followed by the true yaw, as by a rover with a good gyro. Contact points are
    linear tyres of equal stiffness: the body takes the twist of least squares of their free velocities.
    """
    count = len(rover.angles)
    pose, angles, steering = np.zeros(3), np.zeros(count), np.zeros(count)
    twist, planned_yaw, travel, speed_before, rate = np.zeros(3), 0.0, 0.0, 0.0, 0.0
    inverse = rover.twist_of(rover.directions(steering))
    zeros = np.zeros(count if rover.resists_sideways else 0)
    rows: list[Array] = []
    for step, wanted in enumerate(commanded):
        planned_yaw += STEP_S * wanted[2]
        correction = 0.0
        if follows_yaw and (wanted[0] or wanted[1] or (wanted[2] and not rover.steers)):
            correction = YAW_GAIN * (planned_yaw - pose[2])
        limited = max(-MOST_CORRECTION_RAD_S, min(MOST_CORRECTION_RAD_S, correction))
        twist = twist + STEP_S / LAG_S * (wanted + np.array((0.0, 0.0, limited)) - twist)
        if float(np.abs(twist).max()) < 1e-4:
            twist = np.zeros(3)
        steering_before = steering
        rims, turned = rover.wheels_for(twist, steering)
        directions = rover.directions(turned)
        if not np.array_equal(turned, steering):
            inverse, steering = rover.twist_of(directions), turned
        nominal: Array = inverse @ np.concatenate((rims, zeros))
        speed = math.hypot(nominal[0], nominal[1])
        gained, speed_before = (speed - speed_before) / STEP_S, speed
        true = inverse @ _demand(rover, ground, pose, rims, directions, nominal, gained, travel)
        if step % ROW_STEPS == 0:
            # Rate and steering are those of the steps before and after the row: readings at its time.
            read = (0.5 * (rate + true[2]),)
            steered = 0.5 * (steering_before + steering)
            rows.append(np.concatenate(((step * STEP_S,), pose, read, angles, steered, nominal, (travel,))))
        rate = float(true[2])
        angles = angles + STEP_S * rims / rover.radius_m
        travel += STEP_S * speed
        pose = moved(pose, true, STEP_S)
    table = np.array(rows)
    parts = np.split(table, np.cumsum((1, 3, 1, count, count, 3)), axis=1)
    t_s, poses, rates, turns, steerings, nominals, travels = parts
    return Driven(
        t_s=t_s[:, 0],
        pose=poses,
        rate=rates[:, 0],
        angles=turns,
        steering=steerings,
        nominal=nominals,
        travel_m=travels[:, 0],
    )


def _demand(
    rover: Rover,
    ground: Ground,
    pose: Array,
    rims: Array,
    directions: Array,
    nominal: Array,
    gained: float,
    travel: float,
) -> Array:
    """Return velocities along the wheels, then across them, that the ground allows free contact points."""
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    to_ground = np.array(((cos, sin), (-sin, cos)))
    flat = rims[:, None] * directions if rover.resists_sideways else rover.contact_velocities(nominal)
    contact = Contact(
        spots=pose[:2] + rover.spots @ to_ground,
        rims=flat @ to_ground,
        body=nominal[:2] @ to_ground,
        steps_m=STEP_S * np.abs(rims),
        acceleration=gained,
        travel_m=travel,
    )
    free = ground.velocities(contact) @ to_ground.T
    along: Array = np.einsum("ij,ij->i", free, directions)
    if not rover.resists_sideways:
        return along
    return np.concatenate((along, directions[:, 0] * free[:, 1] - directions[:, 1] * free[:, 0]))


@dataclass(frozen=True, kw_only=True)
class Gyro:
    """A gyro by its data sheet, and how the true one differs.

    Attributes:
        walk_rad_sqrt_s: Standard deviation of the integrated noise after one second (data sheet).
        bias_sd_rad_s: Standard deviation of the bias at the start (data sheet).
        bias_walk_rad_s_sqrt_s: Standard deviation of its change within one second (data sheet).
        factor: True noise over that of the data sheet.
        has_dead_band: Readings below 0.2 deg/s are zero.
        step_rad_s: Resolution of the readings; 0 for none.
    """

    walk_rad_sqrt_s: float
    bias_sd_rad_s: float = 0.005
    bias_walk_rad_s_sqrt_s: float = 2e-5
    factor: float = 1.0
    has_dead_band: bool = False
    step_rad_s: float = 0.0

    @property
    def reading_sd_rad_s(self) -> float:
        """Return the standard deviation of one reading by the data sheet."""
        return self.walk_rad_sqrt_s / math.sqrt(ROW_S)

    def readings(self, rate: Array, rng: np.random.Generator) -> Array:
        """Return the readings of a yaw rate, one for each row."""
        steps = self.bias_walk_rad_s_sqrt_s * math.sqrt(ROW_S) * rng.standard_normal(len(rate))
        bias = self.bias_sd_rad_s * rng.standard_normal() + np.cumsum(steps)
        noise = self.factor * self.reading_sd_rad_s * rng.standard_normal(len(rate))
        read: Array = rate + bias + noise
        if self.step_rad_s:
            read = self.step_rad_s * np.round(read / self.step_rad_s)
        return np.where(np.abs(read) < DEAD_BAND_RAD_S, 0.0, read) if self.has_dead_band else read

    def yaw_sd_rad(self, seconds: Array, standstill_s: float) -> Array:
        """Return the standard deviation of the integrated yaw after a standstill that showed the bias."""
        known = min(self.bias_sd_rad_s, self.walk_rad_sqrt_s / math.sqrt(standstill_s))
        walk = self.bias_walk_rad_s_sqrt_s**2 * (seconds**3 / 3.0 + standstill_s * seconds**2)
        sd: Array = np.sqrt(self.walk_rad_sqrt_s**2 * seconds + (known * seconds) ** 2 + walk)
        return sd


def ticks(rover: Rover, angles: Array, rng: np.random.Generator) -> Array:
    """Return whole counts of encoders; each begins anywhere within a count."""
    counts: Array = np.floor(
        angles * rover.ticks_per_turn / math.tau + rng.uniform(0.0, 1.0, angles.shape[1])
    )
    return counts


def measured_steering(steering: Array) -> Array:
    """Return steering angles as the drives report them, in rad."""
    return STEERING_STEP_RAD * np.round(steering / STEERING_STEP_RAD)
