"""A dynamic rover on any set of wheels: integrates the compiled equations of motion."""

import math
from collections import deque
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from drivers.clock import nanoseconds, seconds
from drivers.errors import ConfigError
from drivers.units import STANDARD_GRAVITY_M_S2
from sim_backends.arrays import Array
from sim_backends.plants.robotino.ground import rasterise
from sim_backends.plants.wheels.dynamics import Rover, State, advance
from sim_backends.plants.wheels.settings import WheelMotor, WheelsPlantSettings
from sim_backends.world.plant import Truth, fallen_v

STEP_NS = 1_000_000
SLIP_FLOOR_M_S = 0.02
"""Slip decreases to 0 where rim and ground are both slower: 1 - v / (r omega) is undefined at rest."""


class _Command(NamedTuple):
    due_ns: int
    speed_rad_s: tuple[float, ...] | None
    steering_rad: tuple[float, ...] | None


class WheelsPlant:
    """Wheels with slip, each with its motor and perhaps its steering drive, on a test site; a heavy body.

    It integrates on a grid of 1 ms. Between two grid points `truth` extrapolates at constant speed, so that
    the result does not depend on when and how often it is called.

    docs/explanation/simulators.md lists what is not modelled.

    Args:
        settings: The true rover and its ground.
        rng: Source of the ground's roughness.
        start_ns: Time at the start pose, at rest.

    Raises:
        ConfigError: The centre of mass is outside the contacts.
    """

    def __init__(self, settings: WheelsPlantSettings, rng: np.random.Generator, start_ns: int) -> None:
        count = len(settings.wheels)
        self.wheel_count = count
        self._settings = settings
        self._rover = make_rover(settings)
        # Plain numbers for speed: `truth` is called several times in each control cycle.
        self._places_m: list[list[float]] = self._rover.place[:count].tolist()
        self._rollers_rad: list[float] = self._rover.roller.tolist()
        motors = [wheel.motor or WheelMotor() for wheel in settings.wheels]
        self._stall_a = self._rover.driven * [motor.stall_current_a for motor in motors]
        self._ground = rasterise(settings.site, float(np.mean(self._rover.radius_m)), rng)
        self._grid_ns = self._t_ns = self._start_ns = start_ns
        self._offset_rad = np.radians(
            [0.0 if wheel.steering is None else wheel.steering.offset_deg for wheel in settings.wheels]
        )
        self._state = State(
            pose=np.array([settings.start_x_m, settings.start_y_m, math.radians(settings.start_yaw_deg)]),
            twist=np.zeros(3),
            angle_rad=np.zeros(count),
            speed_rad_s=np.zeros(count),
            steer_rad=self._offset_rad.copy(),
            duty=np.zeros(count),
            integral=np.zeros(count),
            set_rad_s=np.zeros(count),
            set_steer_rad=self._offset_rad.copy(),
        )
        self._steers = any(wheel.steering is not None for wheel in settings.wheels)
        self._commands: deque[_Command] = deque()
        self._truth: Truth | None = None

    def set_wheel_speeds(self, speed_rad_s: Sequence[float]) -> None:
        """Set the setpoints of the inner speed loops, one per wheel."""
        self._commands.append(_Command(self._due_ns(), tuple(speed_rad_s), None))

    def set_steering(self, angle_rad: Sequence[float]) -> None:
        """Set the steering angles, counter-clockwise, one per wheel; ignored where a wheel is fixed."""
        self._commands.append(_Command(self._due_ns(), None, tuple(angle_rad)))

    def advance(self, t_ns: int) -> None:
        """Set the present time; does nothing for a time already reached. `truth` integrates on demand."""
        if t_ns > self._t_ns:
            self._t_ns = t_ns
            self._truth = None

    def truth(self) -> Truth:
        """Return the state at the time reached."""
        if self._truth is None:
            self._catch_up()
            self._truth = self._state_now()
        return self._truth

    def _due_ns(self) -> int:
        return self._t_ns + nanoseconds(self._settings.set_point_delay_s)

    def _catch_up(self) -> None:
        while self._commands and self._commands[0].due_ns <= self._t_ns:
            command = self._commands.popleft()
            self._integrate(command.due_ns)
            if command.speed_rad_s is not None:
                self._state.set_rad_s[:] = command.speed_rad_s
            if command.steering_rad is not None:
                self._state.set_steer_rad[:] = self._offset_rad + np.array(command.steering_rad)
        self._integrate(self._t_ns)

    def _integrate(self, t_ns: int) -> None:
        steps = (t_ns - self._grid_ns) // STEP_NS
        if steps > 0:
            advance(self._state, self._rover, self._ground, steps)
            self._grid_ns += steps * STEP_NS

    def _state_now(self) -> Truth:
        state, settings = self._state, self._settings
        since_s = seconds(self._t_ns - self._grid_ns)
        x_m, y_m, yaw = state.pose.tolist()
        velocity_x, velocity_y, yaw_rate = state.twist.tolist()
        currents = self._currents_a()
        power_w = float(np.sum(np.array(currents) * state.duty)) * settings.battery_v
        supply_a = settings.idle_current_a + max(0.0, power_w) / settings.battery_v
        cos_yaw, sin_yaw = math.cos(yaw), math.sin(yaw)
        # What a sensor at the servo shows: the true angle without its offset.
        steering_rad = tuple((state.steer_rad - self._offset_rad).tolist()) if self._steers else None
        return Truth(
            t_ns=self._t_ns,
            x_m=x_m + since_s * (cos_yaw * velocity_x - sin_yaw * velocity_y),
            y_m=y_m + since_s * (sin_yaw * velocity_x + cos_yaw * velocity_y),
            yaw_rad=yaw + since_s * yaw_rate,
            roll_rad=0.0,
            pitch_rad=0.0,
            velocity_x_m_s=velocity_x,
            velocity_y_m_s=velocity_y,
            yaw_rate_rad_s=yaw_rate,
            wheel_position_rad=tuple((state.angle_rad + since_s * state.speed_rad_s).tolist()),
            wheel_speed_rad_s=tuple(state.speed_rad_s.tolist()),
            motor_current_a=tuple(currents),
            slip=self._slips(),
            battery_v=fallen_v(
                settings.battery_v - settings.battery_resistance_ohm * supply_a,
                settings.battery_fall_v_s,
                self._t_ns - self._start_ns,
            ),
            bumper_pressed=False,
            steering_rad=steering_rad,
        )

    def _currents_a(self) -> list[float]:
        """Return the current of each motor on its torque-speed line."""
        state = self._state
        currents: list[float] = (
            self._stall_a * (state.duty - state.speed_rad_s / self._rover.no_load_rad_s)
        ).tolist()
        return currents

    def _slips(self) -> tuple[float, ...]:
        """Return the slip ratio of each wheel along the direction in which it has traction, -1 to 1."""
        state = self._state
        x, y, turn = state.twist.tolist()
        slips = []
        for (place_x, place_y), along, roller, rim in zip(
            self._places_m,
            (self._rover.angle + state.steer_rad).tolist(),
            self._rollers_rad,
            (self._rover.radius_m * state.speed_rad_s).tolist(),
            strict=True,
        ):
            traction = along if math.isnan(roller) else along + 0.5 * math.pi + roller
            cosine, sine = math.cos(traction), math.sin(traction)
            rim_m_s = rim * math.cos(traction - along)
            ground_m_s = cosine * (x - turn * place_y) + sine * (y + turn * place_x)
            faster = rim_m_s if abs(rim_m_s) >= abs(ground_m_s) else ground_m_s
            difference = math.copysign(1.0, faster) * (rim_m_s - ground_m_s)
            slips.append(min(max(difference / max(abs(faster), SLIP_FLOOR_M_S), -1.0), 1.0))
        return tuple(slips)


def make_rover(settings: WheelsPlantSettings) -> Rover:
    """Return the constants of the equations of motion.

    Raises:
        ConfigError: The centre of mass is outside the contacts.
    """
    wheels, castors = settings.wheels, settings.castors
    motors = [wheel.motor or WheelMotor() for wheel in wheels]
    servos = [wheel.steering for wheel in wheels]
    places = [(wheel.x_m, wheel.y_m) for wheel in wheels] + [(castor.x_m, castor.y_m) for castor in castors]
    place = np.array(places)
    ahead_m, aside_m, mass_kg = settings.centre_of_mass_x_m, settings.centre_of_mass_y_m, settings.mass_kg
    load_n = _loads(place, mass_kg * STANDARD_GRAVITY_M_S2, (ahead_m, aside_m))
    spread_m = np.ptp(place, axis=0) + 2.0 * max(wheel.radius_m for wheel in wheels)
    inertia = settings.yaw_inertia_kg_m2 or mass_kg * float(np.sum(spread_m**2)) / 12.0
    inertia += mass_kg * (ahead_m**2 + aside_m**2)
    rollers = [math.nan if wheel.roller_deg is None else wheel.roller_deg for wheel in wheels]
    return Rover(
        step_s=seconds(STEP_NS),
        place=place,
        angle=np.radians([wheel.angle_deg for wheel in wheels]),
        roller=np.radians(rollers),
        driven=np.array([float(wheel.driven) for wheel in wheels]),
        low=np.radians([0.0 if servo is None else servo.low_deg + servo.offset_deg for servo in servos]),
        high=np.radians([0.0 if servo is None else servo.high_deg + servo.offset_deg for servo in servos]),
        rate=np.radians([0.0 if servo is None else servo.rate_deg_s for servo in servos]),
        radius_m=np.array([wheel.radius_m for wheel in wheels]) * (1.0 + settings.wheel_radius_error),
        load_n=load_n,
        mean_load_n=float(np.mean(load_n[: len(wheels)])),
        mass=np.array(
            [
                [mass_kg, 0.0, -mass_kg * aside_m],
                [0.0, mass_kg, mass_kg * ahead_m],
                [-mass_kg * aside_m, mass_kg * ahead_m, inertia],
            ]
        ),
        wheel_inertia_kg_m2=settings.wheel_inertia_kg_m2,
        friction_nm=settings.wheel_friction_nm,
        stall_nm=np.array([motor.stall_torque_nm for motor in motors]),
        no_load_rad_s=np.array([motor.no_load_rad_s for motor in motors]),
        speed_gain=settings.speed_gain,
        integral_per_s=settings.speed_integral_per_s,
        castor_drag=np.array([castor.drag for castor in castors]),
    )


def _loads(place: Array, weight_n: float, centre_m: tuple[float, float]) -> Array:
    """Return the static load on each contact: equal springs under a stiff body, the least unequal loads."""
    balance = np.vstack((np.ones(len(place)), place.T))
    wanted = weight_n * np.array([1.0, *centre_m])
    load: Array = np.linalg.pinv(balance) @ wanted
    if not np.allclose(balance @ load, wanted, atol=1e-6 * weight_n) or float(np.min(load)) <= 0.0:
        raise ConfigError(
            "simulation.plant: the centre of mass is not between the contacts, so the simulated rover falls "
            "over: correct centre_of_mass_x_m and centre_of_mass_y_m, or add [[simulation.plant.castors]]"
        )
    return load
