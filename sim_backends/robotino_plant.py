"""A simulated Robotino: three omnidirectional wheels on patches of different ground."""

import math
from collections.abc import Sequence
from typing import Annotated, Literal, NamedTuple

import numpy as np
from pydantic import Field

from drivers.clock import nanoseconds, seconds
from drivers.settings import Settings
from sim_backends.plant import Truth
from sim_backends.slow_noise import SlowNoise

WHEEL_ANGLES_DEG = (60.0, 180.0, 300.0)
FRICTION_SMOOTHING_RAD_S = 0.2
LARGEST_SLIP = 0.95


class Surface(Settings):
    """What a wheel meets on one kind of ground.

    Attributes:
        slip: Share of the rim speed that is lost, 0 (rolls) to 0.95.
        load_current_a: Motor current that rolling on it costs, beyond no-load.
    """

    slip: Annotated[float, Field(ge=0, le=LARGEST_SLIP)]
    load_current_a: Annotated[float, Field(ge=0, le=4)]


class RectanglePatch(Surface):
    """A rectangle of ground, sides along x and y of the world."""

    type: Literal["rectangle"]
    x_min_m: float
    x_max_m: float
    y_min_m: float
    y_max_m: float

    def contains(self, x_m: float, y_m: float) -> bool:
        """Tell whether a point lies on the patch."""
        return self.x_min_m <= x_m <= self.x_max_m and self.y_min_m <= y_m <= self.y_max_m


class CirclePatch(Surface):
    """A disc of ground."""

    type: Literal["circle"]
    x_m: float
    y_m: float
    radius_m: Annotated[float, Field(gt=0)]

    def contains(self, x_m: float, y_m: float) -> bool:
        """Tell whether a point lies on the patch."""
        return (x_m - self.x_m) ** 2 + (y_m - self.y_m) ** 2 <= self.radius_m**2


Patch = Annotated[RectanglePatch | CirclePatch, Field(discriminator="type")]


class RobotinoPlantSettings(Settings):
    """The true rover and its ground; the controller has its own, possibly wrong, idea of both.

    Motor constants: Dunkermotoren GR 42x25 with gear 16, and the values identified on two Robotinos by
    BrOleg5/Slippage-compensation; the inertia is the rotor's plus a third of a 12.6 kg rover, seen at the
    motor.

    Attributes:
        wheel_offset_m: Distance of each wheel's contact point from the rover's centre.
        floor: Ground outside every patch.
        patches: Where they overlap, the last one counts.
        slip_fluctuation: Standard deviation of the slip, as a share of the surface's slip.
        load_fluctuation: Standard deviation of the load current, as a share of the surface's.
        fluctuation_time_s: Correlation time of both.
        speed_lag_s: Time constant of the inner speed loop.
        droop_rad_s_per_a: How far the wheel stays behind its set-point per ampere of friction current.
        inertia_kg_m2: Of rotor, wheel and a third of the rover, seen at the motor.
        idle_current_a: What the electronics draw from the battery.
        bumper_x_m: Centre of the rover where it touches a wall, which presses the bumper; None: no wall.
        step_s: Longest integration step.
    """

    type: Literal["robotino"] = "robotino"
    start_x_m: float = 0.0
    start_y_m: float = 0.0
    start_yaw_deg: float = 0.0
    wheel_radius_m: Annotated[float, Field(gt=0, le=1)] = 0.040
    wheel_offset_m: Annotated[float, Field(gt=0, le=2)] = 0.125
    floor: Surface = Surface(slip=0.02, load_current_a=0.05)
    patches: tuple[Patch, ...] = ()
    slip_fluctuation: Annotated[float, Field(ge=0, le=1)] = 0.15
    load_fluctuation: Annotated[float, Field(ge=0, le=1)] = 0.15
    fluctuation_time_s: Annotated[float, Field(ge=0.5, le=60)] = 1.0
    speed_lag_s: Annotated[float, Field(ge=0.02, le=2)] = 0.1
    droop_rad_s_per_a: Annotated[float, Field(ge=0, le=10)] = 1.3
    no_load_current_a: Annotated[float, Field(ge=0, le=2)] = 0.22
    resistance_ohm: Annotated[float, Field(gt=0)] = 5.95
    torque_constant_nm_per_a: Annotated[float, Field(gt=0)] = 0.0514
    speed_constant_v_s_per_rad: Annotated[float, Field(gt=0)] = 0.0501
    gear_ratio: Annotated[float, Field(gt=0)] = 16.0
    inertia_kg_m2: Annotated[float, Field(gt=0)] = 4.1e-5
    battery_v: Annotated[float, Field(gt=0)] = 25.0
    battery_resistance_ohm: Annotated[float, Field(ge=0)] = 0.15
    idle_current_a: Annotated[float, Field(ge=0)] = 1.5
    bumper_x_m: float | None = None
    step_s: Annotated[float, Field(gt=0, le=0.02)] = 0.005


class _Corner(NamedTuple):
    """Where the rolling lines of two wheels cross, and the velocity there per unit rolling speed of each.

    Velocity of the corner = first_speed * (first_x, first_y) + second_speed * (second_x, second_y).
    """

    x_m: float
    y_m: float
    first_x: float
    first_y: float
    second_x: float
    second_y: float


class RobotinoPlant:
    """Body motion from what the three contact points do on the ground.

    Each wheel's contact point moves along its rolling direction at rim speed times (1 - slip), where slip
    and resistance come from the patch under that point. Points of a rigid body on one line share the
    velocity component along that line, so the crossing point of two rolling lines has a known velocity;
    two crossing points give the motion of the body.

    Left out: sideways slip of the rollers, slip that depends on traction, load transfer and tilt, stalling
    wheels, saturation of the motor voltage, discharge of the battery, the motors' electrical time
    constant, obstacles that hold the rover back (a wall only presses the bumper), and the body's momentum.

    Args:
        settings: The true rover and its ground.
        rng: Source of all fluctuation.
        start_ns: Time at the start pose.
    """

    wheel_count = 3

    def __init__(self, settings: RobotinoPlantSettings, rng: np.random.Generator, start_ns: int) -> None:
        self._settings = settings
        angles = [math.radians(angle) for angle in WHEEL_ANGLES_DEG]
        offset_m = settings.wheel_offset_m
        self._contacts = [(offset_m * math.cos(angle), offset_m * math.sin(angle)) for angle in angles]
        directions = [(-math.sin(angle), math.cos(angle)) for angle in angles]
        self._near = _crossing(self._contacts[0], directions[0], self._contacts[1], directions[1])
        self._far = _crossing(self._contacts[1], directions[1], self._contacts[2], directions[2])
        self._noise = SlowNoise(6, settings.fluctuation_time_s, rng, start_ns)
        self._longest_step_ns = nanoseconds(settings.step_s)
        self._t_ns = start_ns
        self._x_m = settings.start_x_m
        self._y_m = settings.start_y_m
        self._yaw_rad = math.radians(settings.start_yaw_deg)
        self._set_point_rad_s = [0.0, 0.0, 0.0]
        self._speed_rad_s = [0.0, 0.0, 0.0]
        self._position_rad = [0.0, 0.0, 0.0]
        self._slip = [0.0, 0.0, 0.0]
        self._friction_a = [0.0, 0.0, 0.0]
        self._feel_ground()

    def set_wheel_speeds(self, speed_rad_s: Sequence[float]) -> None:
        """Give the inner speed loops new set-points, one per wheel (60, 180, 300 degrees)."""
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
        currents = tuple(self._current_a(wheel) for wheel in range(3))
        power_w = sum(self._motor_power_w(wheel, current) for wheel, current in enumerate(currents))
        supply_a = settings.idle_current_a + max(0.0, power_w) / settings.battery_v
        return Truth(
            t_ns=self._t_ns,
            x_m=self._x_m,
            y_m=self._y_m,
            yaw_rad=self._yaw_rad,
            roll_rad=0.0,
            pitch_rad=0.0,
            velocity_x_m_s=velocity_x,
            velocity_y_m_s=velocity_y,
            yaw_rate_rad_s=yaw_rate,
            wheel_position_rad=tuple(self._position_rad),
            wheel_speed_rad_s=tuple(self._speed_rad_s),
            motor_current_a=currents,
            slip=tuple(self._slip),
            battery_v=settings.battery_v - settings.battery_resistance_ohm * supply_a,
            bumper_pressed=settings.bumper_x_m is not None and self._x_m > settings.bumper_x_m,
        )

    def _feel_ground(self) -> None:
        """Look up slip and friction under each contact point at the present pose and time."""
        settings = self._settings
        noise = self._noise.at(self._t_ns)
        cos_yaw, sin_yaw = math.cos(self._yaw_rad), math.sin(self._yaw_rad)
        for wheel, (x_m, y_m) in enumerate(self._contacts):
            surface = self._surface(
                self._x_m + cos_yaw * x_m - sin_yaw * y_m, self._y_m + sin_yaw * x_m + cos_yaw * y_m
            )
            slip = surface.slip * (1.0 + settings.slip_fluctuation * noise[wheel])
            self._slip[wheel] = min(max(slip, 0.0), LARGEST_SLIP)
            load_a = surface.load_current_a * (1.0 + settings.load_fluctuation * noise[3 + wheel])
            self._friction_a[wheel] = settings.no_load_current_a + max(load_a, 0.0)

    def _surface(self, x_m: float, y_m: float) -> Surface:
        for patch in reversed(self._settings.patches):
            if patch.contains(x_m, y_m):
                return patch
        return self._settings.floor

    def _step(self, step_s: float) -> None:
        mean_speed_rad_s = [0.0, 0.0, 0.0]
        for wheel in range(3):
            before = self._speed_rad_s[wheel]
            middle = before + 0.5 * step_s * self._acceleration(wheel, before)
            after = before + step_s * self._acceleration(wheel, middle)
            mean = mean_speed_rad_s[wheel] = 0.5 * (before + after)
            self._speed_rad_s[wheel] = after
            self._position_rad[wheel] += step_s * mean
        self._move(*self._body_motion(mean_speed_rad_s), step_s)

    def _move(self, velocity_x: float, velocity_y: float, yaw_rate: float, step_s: float) -> None:
        """Move along the exact arc of a constant body motion: its chord points along the middle heading."""
        half_turn = 0.5 * yaw_rate * step_s
        chord_s = step_s * math.sin(half_turn) / half_turn if half_turn else step_s
        middle_yaw = self._yaw_rad + half_turn
        cos_yaw, sin_yaw = math.cos(middle_yaw), math.sin(middle_yaw)
        self._x_m += chord_s * (cos_yaw * velocity_x - sin_yaw * velocity_y)
        self._y_m += chord_s * (sin_yaw * velocity_x + cos_yaw * velocity_y)
        self._yaw_rad += 2.0 * half_turn

    def _acceleration(self, wheel: int, speed_rad_s: float) -> float:
        """Return what the inner speed loop makes of a wheel at a speed, in rad/s2."""
        settings = self._settings
        droop = settings.droop_rad_s_per_a * self._friction_a[wheel] * _smooth_sign(speed_rad_s)
        return (self._set_point_rad_s[wheel] - droop - speed_rad_s) / settings.speed_lag_s

    def _current_a(self, wheel: int) -> float:
        """Return the signed current of the motor's torque balance Kt I = Kt I_friction + J d(omega)/dt."""
        settings = self._settings
        speed_rad_s = self._speed_rad_s[wheel]
        inertia_nm = settings.inertia_kg_m2 * settings.gear_ratio * self._acceleration(wheel, speed_rad_s)
        friction_a = self._friction_a[wheel] * _smooth_sign(speed_rad_s)
        return friction_a + inertia_nm / settings.torque_constant_nm_per_a

    def _motor_power_w(self, wheel: int, current_a: float) -> float:
        """Return what a motor draws: terminal voltage (copper and back-EMF) times current."""
        settings = self._settings
        motor_rad_s = settings.gear_ratio * self._speed_rad_s[wheel]
        back_emf_v = settings.speed_constant_v_s_per_rad * motor_rad_s
        return current_a * (settings.resistance_ohm * current_a + back_emf_v)

    def _body_motion(self, speed_rad_s: Sequence[float]) -> tuple[float, float, float]:
        """Return velocity x, y in m/s and yaw rate in rad/s of the body for wheel speeds."""
        radius_m = self._settings.wheel_radius_m
        rolling_1, rolling_2, rolling_3 = (
            radius_m * speed * (1.0 - slip) for speed, slip in zip(speed_rad_s, self._slip, strict=True)
        )
        near, far = self._near, self._far
        near_x = rolling_1 * near.first_x + rolling_2 * near.second_x
        near_y = rolling_1 * near.first_y + rolling_2 * near.second_y
        far_x = rolling_2 * far.first_x + rolling_3 * far.second_x
        far_y = rolling_2 * far.first_y + rolling_3 * far.second_y
        apart_x, apart_y = far.x_m - near.x_m, far.y_m - near.y_m
        across = apart_x * (far_y - near_y) - apart_y * (far_x - near_x)
        yaw_rate = across / (apart_x * apart_x + apart_y * apart_y)
        return near_x + yaw_rate * near.y_m, near_y - yaw_rate * near.x_m, yaw_rate


def _crossing(
    first_point: tuple[float, float],
    first_direction: tuple[float, float],
    second_point: tuple[float, float],
    second_direction: tuple[float, float],
) -> _Corner:
    """Cross two lines, and invert the projection of a velocity on their (unit) directions."""
    (px, py), (ax, ay) = first_point, first_direction
    (qx, qy), (bx, by) = second_point, second_direction
    area = ax * by - ay * bx
    along_first = ((qx - px) * by - (qy - py) * bx) / area
    return _Corner(
        x_m=px + along_first * ax,
        y_m=py + along_first * ay,
        first_x=by / area,
        first_y=-bx / area,
        second_x=-ay / area,
        second_y=ax / area,
    )


def _smooth_sign(speed_rad_s: float) -> float:
    """Return the sign of a speed, going smoothly through zero so that a resting wheel needs no current."""
    return speed_rad_s / math.sqrt(speed_rad_s**2 + FRICTION_SMOOTHING_RAD_S**2)
