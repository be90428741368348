"""The dynamic Robotino: integrates the compiled equations of motion to the requested times."""

import math
from collections import deque
from collections.abc import Callable, Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np

from drivers.clock import nanoseconds, seconds
from drivers.units import STANDARD_GRAVITY_M_S2
from sim_backends.jit import specialised
from sim_backends.plants.robotino.dynamics import Observed, Rover, State, advance, observe
from sim_backends.plants.robotino.ground import rasterise
from sim_backends.plants.robotino.settings import RobotinoPlantSettings
from sim_backends.world.plant import Truth, fallen_v

WHEEL_ANGLES_DEG = (60.0, 180.0, 300.0)


class _Command(NamedTuple):
    due_ns: int
    speed_rad_s: tuple[float, ...]


class RobotinoPlant:
    """Three gear motors with the board's speed loop, omnidirectional wheels on a test site, a heavy body.

    It integrates on a grid of its own: half the period of the speed loop, 0.56 ms, at a random phase. Between
    two grid points `truth` extrapolates at constant speed, so that the result does not depend on when and how
    often it is called.

    docs/explanation/simulators.md lists what is not modelled.

    Args:
        settings: The true rover and its ground.
        rng: Source of the ground's roughness, of the phase and the rate of the speed loop and of the
            encoders' zeros.
        start_ns: Time at the start pose, at rest.
    """

    wheel_count = 3

    def __init__(self, settings: RobotinoPlantSettings, rng: np.random.Generator, start_ns: int) -> None:
        self._settings = settings
        self._ground = rasterise(settings.site, settings.wheel_radius_m, rng)
        loop = settings.speed_loop
        rate_hz = loop.rate_hz * (1.0 + loop.rate_error * rng.standard_normal())
        self._step_ns = nanoseconds(1.0 / rate_hz / loop.steps_per_period)
        self._grid_ns = start_ns - round(rng.random() * loop.steps_per_period * self._step_ns)
        self._t_ns = self._start_ns = start_ns
        self._rover = make_rover(settings, seconds(self._step_ns))
        self._state = _initial_state(settings)
        self._encoder_zeros = rng.uniform(0.0, self._rover.tick_rad, 3)
        self._state.angle_rad[:] = self._encoder_zeros
        self._ticks_per_rad_s = 1.0 / (self._rover.tick_rad * loop.rate_hz)
        self._commands: deque[_Command] = deque()
        self._truth: Truth | None = None

    def compile(self) -> None:
        """Load or compile what integrates; the first step does it otherwise."""
        _ = self._advance, self._observe

    @cached_property
    def _advance(self) -> Callable[..., None]:
        return specialised(advance, self._state, self._rover, self._ground, 1)

    @cached_property
    def _observe(self) -> Callable[..., Observed]:
        return specialised(observe, self._state, self._rover, self._encoder_zeros, 0.0)

    def set_wheel_speeds(self, speed_rad_s: Sequence[float]) -> None:
        """Set the setpoints of the inner speed loops, one per wheel (60, 180, 300 degrees)."""
        delay_ns = nanoseconds(self._settings.speed_loop.set_point_delay_s)
        self._commands.append(_Command(self._t_ns + delay_ns, tuple(speed_rad_s)))

    def advance(self, t_ns: int) -> None:
        """Set the present time; does nothing for a time already reached. `truth` integrates on demand."""
        if t_ns > self._t_ns:
            self._t_ns = t_ns
            self._truth = None

    def _catch_up(self) -> None:
        t_ns = self._t_ns
        while self._commands and self._commands[0].due_ns <= t_ns:
            command = self._commands.popleft()
            self._integrate(command.due_ns)
            self._state.set_ticks[:] = [speed * self._ticks_per_rad_s for speed in command.speed_rad_s]
        self._integrate(t_ns)

    def _integrate(self, t_ns: int) -> None:
        steps = (t_ns - self._grid_ns) // self._step_ns
        if steps > 0:
            self._advance(self._state, self._rover, self._ground, steps)
            self._grid_ns += steps * self._step_ns

    def truth(self) -> Truth:
        """Return the state at the time reached."""
        if self._truth is None:
            self._catch_up()
            self._truth = self._state_now()
        return self._truth

    def _state_now(self) -> Truth:
        since_s, bumper_x_m = seconds(self._t_ns - self._grid_ns), self._settings.bumper_x_m
        seen = self._observe(self._state, self._rover, self._encoder_zeros, since_s)
        x_m, y_m, yaw_rad = seen.pose
        velocity_x_m_s, velocity_y_m_s, yaw_rate_rad_s = seen.twist
        return Truth(
            t_ns=self._t_ns,
            x_m=x_m,
            y_m=y_m,
            yaw_rad=yaw_rad,
            roll_rad=0.0,
            pitch_rad=0.0,
            velocity_x_m_s=velocity_x_m_s,
            velocity_y_m_s=velocity_y_m_s,
            yaw_rate_rad_s=yaw_rate_rad_s,
            wheel_position_rad=seen.position_rad,
            wheel_speed_rad_s=seen.speed_rad_s,
            motor_current_a=seen.current_a,
            slip=seen.slip,
            battery_v=fallen_v(seen.supply_v, self._settings.battery_fall_v_s, self._t_ns - self._start_ns),
            bumper_pressed=bumper_x_m is not None and x_m > bumper_x_m,
        )


def make_rover(settings: RobotinoPlantSettings, step_s: float) -> Rover:
    """Return the constants of the equations of motion for a step."""
    motor, loop = settings.motor, settings.speed_loop
    angles = np.radians(WHEEL_ANGLES_DEG)
    offset_m, mass_kg, ahead_m = settings.wheel_offset_m, settings.mass_kg, settings.centre_of_mass_x_m
    gear = motor.gear_ratio
    friction_nm = gear * motor.gear_efficiency * motor.friction_nm
    mean_load_n = mass_kg * STANDARD_GRAVITY_M_S2 / 3.0
    load_n = mean_load_n * (1.0 + 2.0 * np.cos(angles) * ahead_m / offset_m)
    inertia_kg_m2 = settings.yaw_inertia_kg_m2 + mass_kg * ahead_m**2
    return Rover(
        step_s=step_s,
        steps_per_control=loop.steps_per_period,
        direction=np.column_stack((-np.sin(angles), np.cos(angles), np.full(3, offset_m))),
        radial=np.column_stack((np.cos(angles), np.sin(angles), np.zeros(3))),
        load_n=load_n,
        deeper=np.array([math.pow(load / mean_load_n, 1.0 / 3.0) for load in load_n.tolist()]),
        mass=np.array(
            [
                [mass_kg, 0.0, 0.0],
                [0.0, mass_kg, mass_kg * ahead_m],
                [0.0, mass_kg * ahead_m, inertia_kg_m2],
            ]
        ),
        radius_m=settings.wheel_radius_m,
        wheel_inertia_kg_m2=gear**2 * motor.inertia_kg_m2,
        resistance_ohm=motor.resistance_ohm,
        current_step=-math.expm1(-step_s * motor.resistance_ohm / motor.inductance_h),
        torque_nm_per_a=gear * motor.torque_constant_nm_per_a,
        back_emf_v_s=gear * motor.speed_constant_v_s_per_rad,
        friction_nm=friction_nm,
        breakaway_nm=motor.breakaway * friction_nm,
        viscous_nm_s=gear**2 * motor.viscous_nm_s,
        gear_efficiency=motor.gear_efficiency,
        tick_rad=math.tau / loop.ticks_per_turn / gear,
        gain=loop.gain,
        battery_v=settings.battery_v,
        battery_resistance_ohm=settings.battery_resistance_ohm,
        idle_current_a=settings.idle_current_a,
    )


def _initial_state(settings: RobotinoPlantSettings) -> State:
    idle_v = settings.battery_v - settings.battery_resistance_ohm * settings.idle_current_a
    return State(
        pose=np.array([settings.start_x_m, settings.start_y_m, math.radians(settings.start_yaw_deg)]),
        twist=np.zeros(3),
        angle_rad=np.zeros(3),
        speed_rad_s=np.zeros(3),
        current_a=np.zeros(3),
        voltage_v=np.zeros(3),
        set_ticks=np.zeros(3),
        counted=np.zeros(3),
        supply=np.array([idle_v]),
        step=np.zeros(1, dtype=np.int64),
    )
