"""A rover on two wheels and a castor that is not as described: it follows setpoints late, and slips.

It knows nothing of the program. Setpoints arrive after a dead time, and the wheels follow them as a
first-order lag. A wheel pulls in proportion to the speed at which its rim slides, at most by friction; the
rover resists rolling and rotating by constant forces. So the slip is greater where the rover is slower, and
in rotations. Each wheel has a radius of its own. The gyro has a scale, a bias of the day, a delay and white
noise.
"""

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

STEP_S = 0.005
GRAVITY_M_S2 = 9.81
CREEP_M_S, CREEP_RAD_S = 0.002, 0.01


@dataclass(frozen=True, kw_only=True)
class DrawnRover:
    """What the rover is.

    Attributes:
        radius_m: Of the left and the right wheel.
        track_m: Between them.
        dead_time_s, lag_s: From a setpoint to the wheel.
        grip: Pull of a wheel over its load, per speed of sliding, 1/(m/s).
        friction: Greatest pull over load.
        resistance: Against rolling, over the weight.
        rotation_resistance_m: Torque against rotating, over the weight.
        mass_kg: Of the rover.
        gyro: Scale, bias in rad/s and delay in s of the gyro.
        gyro_noise_rad_s: Standard deviation of each reading.
        bias_sd_rad_s: By how much the bias differs from day to day.
    """

    radius_m: tuple[float, float]
    track_m: float
    dead_time_s: float
    lag_s: float
    grip: float
    friction: float
    resistance: float
    rotation_resistance_m: float
    mass_kg: float
    gyro: tuple[float, float, float]
    gyro_noise_rad_s: float
    bias_sd_rad_s: float


def draw(rng: np.random.Generator, radius_m: float, track_m: float) -> DrawnRover:
    """Return a rover that is described by a radius and a track."""
    common, contrast = rng.uniform(-0.04, 0.04), rng.uniform(-0.006, 0.006)
    slip = rng.uniform(0.002, 0.05)
    resistance = rng.uniform(0.01, 0.04)
    return DrawnRover(
        radius_m=(radius_m * (1.0 + common + contrast), radius_m * (1.0 + common - contrast)),
        track_m=track_m * (1.0 + rng.uniform(-0.05, 0.05)),
        dead_time_s=rng.uniform(0.03, 0.25),
        lag_s=rng.uniform(0.03, 0.15),
        grip=resistance / (slip * 0.25),
        friction=rng.uniform(0.3, 0.8),
        resistance=resistance,
        rotation_resistance_m=resistance * rng.uniform(0.02, 0.1),
        mass_kg=rng.uniform(5.0, 15.0),
        gyro=(1.0 + rng.uniform(-0.02, 0.02), rng.normal(0.0, math.radians(0.4)), rng.uniform(0.0, 0.1)),
        gyro_noise_rad_s=math.radians(rng.uniform(0.05, 0.5)),
        bias_sd_rad_s=math.radians(0.05),
    )


def of_the_day(rover: DrawnRover, rng: np.random.Generator) -> DrawnRover:
    """Return the rover on another day: another bias, and another place of its floor."""
    scale, bias, delay_s = rover.gyro
    place = rng.uniform(0.8, 1.25)
    return replace(
        rover,
        gyro=(scale, bias + rng.normal(0.0, rover.bias_sd_rad_s), delay_s),
        resistance=rover.resistance * place,
        rotation_resistance_m=rover.rotation_resistance_m * place,
    )


class Motion:
    """The motion of a rover; times are in s from the start, where it stands at the origin.

    Attributes:
        x_m, y_m, yaw_rad: Its pose.
        ahead_m_s, turn_rad_s: Its velocity.
        angle_rad, speed_rad_s: Of the wheels, left and right.
        gyro_rad_s: Reading of the gyro.
    """

    def __init__(self, rover: DrawnRover, rng: np.random.Generator) -> None:
        self._rover, self._rng = rover, rng
        self._steps = 0
        self._setpoints: deque[tuple[float, tuple[float, ...]]] = deque()
        self._set_rad_s = (0.0, 0.0)
        self._past_rad_s = deque([0.0] * (round(rover.gyro[2] / STEP_S) + 1))
        self.x_m = self.y_m = self.yaw_rad = self.ahead_m_s = self.turn_rad_s = 0.0
        self.angle_rad = [0.0, 0.0]
        self.speed_rad_s = [0.0, 0.0]
        self.gyro_rad_s = 0.0

    def set_speeds(self, t_s: float, speed_rad_s: Sequence[float]) -> None:
        """Give setpoints at a time."""
        self._setpoints.append((t_s + self._rover.dead_time_s, tuple(speed_rad_s)))

    def advance(self, t_s: float) -> None:
        """Move on to a time, in whole steps."""
        while (self._steps + 1) * STEP_S <= t_s + 1e-9:
            self._steps += 1
            while self._setpoints and self._setpoints[0][0] <= self._steps * STEP_S:
                _, (left, right) = self._setpoints.popleft()
                self._set_rad_s = left, right
            self._step()

    def _step(self) -> None:
        rover = self._rover
        share = 1.0 - math.exp(-STEP_S / rover.lag_s)
        load_n = 0.5 * rover.mass_kg * GRAVITY_M_S2
        half_m = 0.5 * rover.track_m
        rims, pulls = [], []
        for wheel, side in enumerate((-half_m, half_m)):
            speed = self.speed_rad_s[wheel]
            speed += share * (self._set_rad_s[wheel] - speed)
            self.speed_rad_s[wheel] = speed
            self.angle_rad[wheel] += STEP_S * speed
            rim = rover.radius_m[wheel] * speed
            slide = rover.grip * (rim - self.ahead_m_s - side * self.turn_rad_s) / rover.friction
            rims.append(rim)
            pulls.append(load_n * rover.grip / math.sqrt(1.0 + slide * slide))
        weight_n = rover.mass_kg * GRAVITY_M_S2
        drag = weight_n * rover.resistance / math.hypot(self.ahead_m_s, CREEP_M_S)
        brake = weight_n * rover.rotation_resistance_m / math.hypot(self.turn_rad_s, CREEP_RAD_S)
        inertia = rover.mass_kg * half_m**2
        # Implicit in the two velocities, which the difference of the pulls couples.
        total, crossed = pulls[0] + pulls[1], half_m * (pulls[1] - pulls[0])
        a, b = rover.mass_kg / STEP_S + total + drag, inertia / STEP_S + half_m**2 * total + brake
        right_a = rover.mass_kg / STEP_S * self.ahead_m_s + pulls[0] * rims[0] + pulls[1] * rims[1]
        right_b = inertia / STEP_S * self.turn_rad_s + half_m * (pulls[1] * rims[1] - pulls[0] * rims[0])
        determinant = a * b - crossed * crossed
        self.ahead_m_s = (right_a * b - crossed * right_b) / determinant
        self.turn_rad_s = (a * right_b - crossed * right_a) / determinant
        middle_rad = self.yaw_rad + 0.5 * STEP_S * self.turn_rad_s
        self.x_m += STEP_S * self.ahead_m_s * math.cos(middle_rad)
        self.y_m += STEP_S * self.ahead_m_s * math.sin(middle_rad)
        self.yaw_rad += STEP_S * self.turn_rad_s
        self._past_rad_s.append(self.turn_rad_s)
        self._past_rad_s.popleft()
        scale, bias, _ = rover.gyro
        noise = rover.gyro_noise_rad_s * float(self._rng.standard_normal())
        self.gyro_rad_s = scale * self._past_rad_s[0] + bias + noise
