"""A simulated skid-steered rover with four wheels on sloping loose ground."""

import math
from collections.abc import Sequence
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from drivers.clock import nanoseconds, seconds
from drivers.settings import Settings
from sim_backends.plant import Truth
from sim_backends.slow_noise import SlowNoise

GRAVITY_M_S2 = 9.81
FRICTION_SMOOTHING_RAD_S = 0.02
LARGEST_SLIP = 0.95


class Mound(Settings):
    """A bell-shaped mound: `height_m` at the top, falling off with the standard deviation `radius_m`."""

    x_m: float
    y_m: float
    height_m: Annotated[float, Field(ge=-2, le=2)]
    radius_m: Annotated[float, Field(gt=0.05, le=50)]


class Ground(Settings):
    """The shape and the grip of the ground.

    Attributes:
        inclination_deg: Of the slope below the mounds.
        uphill_deg: Direction of steepest ascent, counter-clockwise from x.
        grip: Largest traction per wheel load, in any direction.
        rolling_resistance: Resistance per wheel load.
        slip_at_half_grip: Slip ratio at which a wheel delivers half of the grip it has forwards.
        drift_at_half_grip: Tangent of the drift angle at which it holds half of the grip sideways.
    """

    inclination_deg: Annotated[float, Field(ge=0, le=40)] = 0.0
    uphill_deg: Annotated[float, Field(ge=-360, le=360)] = 0.0
    mounds: tuple[Mound, ...] = ()
    grip: Annotated[float, Field(gt=0, le=2)] = 0.6
    rolling_resistance: Annotated[float, Field(ge=0, le=1)] = 0.08
    slip_at_half_grip: Annotated[float, Field(gt=0, le=1)] = 0.15
    drift_at_half_grip: Annotated[float, Field(gt=0, le=2)] = 0.3

    @model_validator(mode="after")
    def _rolls_on_the_level(self) -> "Ground":
        if self.rolling_resistance >= self.grip:
            msg = "rolling_resistance must be smaller than grip, or the rover cannot move on the level"
            raise ValueError(msg)
        return self


class FourWheelPlantSettings(Settings):
    """The true rover and its ground; the controller has its own, possibly wrong, idea of both.

    Wheel and load are those of the single-wheel tests in Reina, Ishigami, Nagatani and Yoshida, "Odometry
    correction using visual slip angle estimation for planetary exploration rovers" (92 mm, 6.6 kg); track,
    wheel base, motors and ground are chosen.

    Attributes:
        wheel_radius_error: The wheels really roll on wheel_radius_m * (1 + wheel_radius_error).
        track_m: Distance between left and right wheels.
        wheel_base_m: Distance between front and rear wheels.
        turn_resistance: The rover turns as if its track were wider by this factor, from 1 (no scrubbing).
        turn_centre_x_m: The rover turns about a point this far ahead of its centre.
        slip_fluctuation: Standard deviation of the slip of each side, as a share of that slip.
        drift_fluctuation: Standard deviation of the drift angle, as a share of that angle.
        fluctuation_time_s: Correlation time of both.
        speed_lag_s: Time constant of the inner speed loop.
        torque_per_ampere_nm: At the wheel, gear and its efficiency included.
        idle_current_a: What the electronics draw from the battery.
        step_s: Longest integration step.
    """

    type: Literal["four_wheel"] = "four_wheel"
    start_x_m: float = 0.0
    start_y_m: float = 0.0
    start_yaw_deg: float = 0.0
    wheel_radius_m: Annotated[float, Field(gt=0, le=1)] = 0.092
    wheel_radius_error: Annotated[float, Field(ge=-0.2, le=0.2)] = 0.0
    track_m: Annotated[float, Field(gt=0, le=3)] = 0.44
    wheel_base_m: Annotated[float, Field(gt=0, le=3)] = 0.60
    turn_resistance: Annotated[float, Field(ge=1, le=5)] = 1.5
    turn_centre_x_m: Annotated[float, Field(ge=-1, le=1)] = 0.0
    mass_kg: Annotated[float, Field(gt=0, le=1000)] = 26.4
    ground: Ground = Ground()
    slip_fluctuation: Annotated[float, Field(ge=0, le=1)] = 0.1
    drift_fluctuation: Annotated[float, Field(ge=0, le=1)] = 0.1
    fluctuation_time_s: Annotated[float, Field(ge=0.5, le=60)] = 2.0
    speed_lag_s: Annotated[float, Field(ge=0.02, le=2)] = 0.1
    no_load_current_a: Annotated[float, Field(ge=0, le=5)] = 0.15
    torque_per_ampere_nm: Annotated[float, Field(gt=0)] = 1.8
    resistance_ohm: Annotated[float, Field(gt=0)] = 1.0
    battery_v: Annotated[float, Field(gt=0)] = 25.0
    battery_resistance_ohm: Annotated[float, Field(ge=0)] = 0.1
    idle_current_a: Annotated[float, Field(ge=0)] = 1.0
    step_s: Annotated[float, Field(gt=0, le=0.02)] = 0.005


class FourWheelPlant:
    """Skid steering about centres of rotation outside the track, with slip and drift from the slope.

    Wheels: front left, front right, rear left, rear right. Each side moves at its mean rim speed times
    (1 - slip). The weight's component along the body asks for traction; the grip that the sideways
    component leaves (friction circle) supplies it on the hyperbola traction = grip slip / (slip + half), and
    drift follows the same curve sideways. x and y are measured on the slope below the mounds.

    Left out: the stress distribution under the wheel and sinkage, unequal wheel loads, slip of the single
    wheel within a side, sliding downhill at rest, the momentum of the body, a suspension (roll and pitch are
    those of a plane through the four contacts), the shortening of distances on a mound's flank, saturation of
    the motor voltage, discharge of the battery, obstacles (the bumper is never pressed). At standstill the
    gears hold the rover without current.

    Args:
        settings: The true rover and its ground.
        rng: Source of all fluctuation.
        start_ns: Time at the start pose.
    """

    wheel_count = 4

    def __init__(self, settings: FourWheelPlantSettings, rng: np.random.Generator, start_ns: int) -> None:
        self._settings = settings
        ground = settings.ground
        grade = math.tan(math.radians(ground.inclination_deg))
        self._grade_x = grade * math.cos(math.radians(ground.uphill_deg))
        self._grade_y = grade * math.sin(math.radians(ground.uphill_deg))
        self._radius_m = settings.wheel_radius_m * (1.0 + settings.wheel_radius_error)
        half_base_m, half_track_m = 0.5 * settings.wheel_base_m, 0.5 * settings.track_m
        self._contacts = [
            (half_base_m, half_track_m),
            (half_base_m, -half_track_m),
            (-half_base_m, half_track_m),
            (-half_base_m, -half_track_m),
        ]
        self._noise = SlowNoise(3, settings.fluctuation_time_s, rng, start_ns)
        self._longest_step_ns = nanoseconds(settings.step_s)
        self._t_ns = start_ns
        self._x_m = settings.start_x_m
        self._y_m = settings.start_y_m
        self._yaw_rad = math.radians(settings.start_yaw_deg)
        self._set_point_rad_s = [0.0] * 4
        self._speed_rad_s = [0.0] * 4
        self._position_rad = [0.0] * 4
        self._feel_ground()

    def set_wheel_speeds(self, speed_rad_s: Sequence[float]) -> None:
        """Give the inner speed loops new set-points: front left, front right, rear left, rear right."""
        self._set_point_rad_s = list(speed_rad_s)

    def advance(self, t_ns: int) -> None:
        """Integrate to `t_ns`; does nothing for a time already reached."""
        while self._t_ns < t_ns:
            step_ns = min(self._longest_step_ns, t_ns - self._t_ns)
            self._step(seconds(step_ns))
            self._t_ns += step_ns
            self._feel_ground()

    def truth(self) -> Truth:
        """Return the state at the time reached."""
        settings = self._settings
        velocity_x, velocity_y, yaw_rate = self._body_motion(self._speed_rad_s)
        currents = tuple(self._current_a(wheel) for wheel in range(4))
        power_w = sum(
            current * (settings.resistance_ohm * current + settings.torque_per_ampere_nm * speed)
            for current, speed in zip(currents, self._speed_rad_s, strict=True)
        )
        supply_a = settings.idle_current_a + max(0.0, power_w) / settings.battery_v
        return Truth(
            t_ns=self._t_ns,
            x_m=self._x_m,
            y_m=self._y_m,
            yaw_rad=self._yaw_rad,
            roll_rad=self._roll_rad,
            pitch_rad=self._pitch_rad,
            velocity_x_m_s=velocity_x,
            velocity_y_m_s=velocity_y,
            yaw_rate_rad_s=yaw_rate,
            wheel_position_rad=tuple(self._position_rad),
            wheel_speed_rad_s=tuple(self._speed_rad_s),
            motor_current_a=currents,
            slip=tuple(
                _slip_ratio(self._radius_m * speed, velocity_x - yaw_rate * y_m)
                for speed, (_, y_m) in zip(self._speed_rad_s, self._contacts, strict=True)
            ),
            battery_v=settings.battery_v - settings.battery_resistance_ohm * supply_a,
            bumper_pressed=False,
        )

    def _feel_ground(self) -> None:
        """Tilt the body onto the ground at the present pose, and keep what the tilt asks of the wheels."""
        settings = self._settings
        cos_yaw, sin_yaw = math.cos(self._yaw_rad), math.sin(self._yaw_rad)
        front_left, front_right, rear_left, rear_right = (
            self._height_m(
                self._x_m + cos_yaw * x_m - sin_yaw * y_m, self._y_m + sin_yaw * x_m + cos_yaw * y_m
            )
            for x_m, y_m in self._contacts
        )
        rise_ahead = 0.5 * (front_left + front_right - rear_left - rear_right) / settings.wheel_base_m
        rise_left = 0.5 * (front_left + rear_left - front_right - rear_right) / settings.track_m
        self._pitch_rad = -math.atan(rise_ahead)
        self._roll_rad = math.atan(rise_left / math.hypot(1.0, rise_ahead))
        upright = math.cos(self._pitch_rad) * math.cos(self._roll_rad)
        self._load_n = 0.25 * settings.mass_kg * GRAVITY_M_S2 * upright
        self._uphill_pull = -math.sin(self._pitch_rad) / upright
        self._sideways_pull = math.sin(self._roll_rad) * math.cos(self._pitch_rad) / upright
        self._noise_now = self._noise.at(self._t_ns)

    def _height_m(self, x_m: float, y_m: float) -> float:
        height_m = self._grade_x * x_m + self._grade_y * y_m
        for mound in self._settings.ground.mounds:
            distance_2 = (x_m - mound.x_m) ** 2 + (y_m - mound.y_m) ** 2
            height_m += mound.height_m * math.exp(-0.5 * distance_2 / mound.radius_m**2)
        return height_m

    def _step(self, step_s: float) -> None:
        """Solve the first-order lag of the wheels exactly over the step, and move at their mean speed."""
        lag_s = self._settings.speed_lag_s
        kept = math.exp(-step_s / lag_s)
        mean_speed_rad_s = [0.0] * 4
        for wheel, set_point in enumerate(self._set_point_rad_s):
            behind = self._speed_rad_s[wheel] - set_point
            turned_rad = set_point * step_s + behind * lag_s * (1.0 - kept)
            mean_speed_rad_s[wheel] = turned_rad / step_s
            self._position_rad[wheel] += turned_rad
            self._speed_rad_s[wheel] = set_point + behind * kept
        velocity_x, velocity_y, yaw_rate = self._body_motion(mean_speed_rad_s)
        middle_yaw = self._yaw_rad + 0.5 * yaw_rate * step_s
        cos_yaw, sin_yaw = math.cos(middle_yaw), math.sin(middle_yaw)
        self._x_m += step_s * (cos_yaw * velocity_x - sin_yaw * velocity_y)
        self._y_m += step_s * (sin_yaw * velocity_x + cos_yaw * velocity_y)
        self._yaw_rad += step_s * yaw_rate

    def _body_motion(self, speed_rad_s: Sequence[float]) -> tuple[float, float, float]:
        """Return velocity x, y in m/s and yaw rate in rad/s of the body for wheel speeds."""
        settings = self._settings
        front_left, front_right, rear_left, rear_right = speed_rad_s
        left = self._ground_speed(0.5 * self._radius_m * (front_left + rear_left), self._noise_now[0])
        right = self._ground_speed(0.5 * self._radius_m * (front_right + rear_right), self._noise_now[1])
        velocity_x = 0.5 * (left + right)
        yaw_rate = (right - left) / (settings.turn_resistance * settings.track_m)
        drift = self._drift() * (1.0 + settings.drift_fluctuation * self._noise_now[2])
        return velocity_x, -abs(velocity_x) * drift - yaw_rate * settings.turn_centre_x_m, yaw_rate

    def _ground_speed(self, rim_m_s: float, noise: float) -> float:
        """Return how fast one side moves over the ground when its rims turn at `rim_m_s`."""
        ground = self._settings.ground
        demand = math.copysign(1.0, rim_m_s) * self._uphill_pull + ground.rolling_resistance
        grip = math.sqrt(max(0.0, ground.grip**2 - self._sideways_pull**2))
        slip = ground.slip_at_half_grip * _hyperbola(demand, grip)
        slip *= 1.0 + self._settings.slip_fluctuation * noise
        return rim_m_s * (1.0 - min(max(slip, -LARGEST_SLIP), LARGEST_SLIP))

    def _drift(self) -> float:
        """Return the tangent of the angle at which the rover drifts downhill (to the right when positive)."""
        ground = self._settings.ground
        return ground.drift_at_half_grip * _hyperbola(self._sideways_pull, ground.grip)

    def _current_a(self, wheel: int) -> float:
        """Return the signed current that friction, the load on the wheel and its acceleration ask for."""
        settings = self._settings
        speed_rad_s = self._speed_rad_s[wheel]
        turning = speed_rad_s / math.sqrt(speed_rad_s**2 + FRICTION_SMOOTHING_RAD_S**2)
        demand = abs(turning) * self._uphill_pull + turning * settings.ground.rolling_resistance
        demand = min(max(demand, -settings.ground.grip), settings.ground.grip)
        acceleration = (self._set_point_rad_s[wheel] - speed_rad_s) / settings.speed_lag_s
        inertia_nm = 0.25 * settings.mass_kg * self._radius_m**2 * acceleration
        load_nm = demand * self._load_n * self._radius_m
        return settings.no_load_current_a * turning + (load_nm + inertia_nm) / settings.torque_per_ampere_nm


def _hyperbola(demand: float, grip: float) -> float:
    """Return slip / slip-at-half-grip on the curve demand = grip slip / (slip + half); large at the limit."""
    left = grip - abs(demand)
    return demand / left if left > 1e-3 * grip else math.copysign(1e3, demand)


def _slip_ratio(rim_m_s: float, ground_m_s: float) -> float:
    """Return the slip ratio, positive when driving, in [-1, 1]; 0 at rest."""
    fastest = max(abs(rim_m_s), abs(ground_m_s))
    return math.copysign(1.0, rim_m_s) * (rim_m_s - ground_m_s) / fastest if fastest else 0.0
