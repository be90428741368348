"""The simulated El-Dorado: integrates the compiled equations of motion to the requested times."""

import math
from collections.abc import Callable, Sequence
from functools import cached_property

import numpy as np

from drivers.clock import seconds
from drivers.units import STANDARD_GRAVITY_M_S2
from sim_backends.jit import specialised
from sim_backends.plants.el_dorado.dynamics import (
    Drives,
    Ground,
    Rover,
    State,
    WheelState,
    advance,
    settle,
    write_currents,
)
from sim_backends.plants.el_dorado.settings import ElDoradoPlantSettings
from sim_backends.plants.el_dorado.wheel_table import WheelTable, load_table
from sim_backends.terramechanics.soil.library import load_soil, load_wheel
from sim_backends.world.coloured_noise import ColouredNoise
from sim_backends.world.plant import Truth, fallen_v

STEP_NS = 10_000_000
LEAST_STRENGTH = 0.3


class ElDoradoPlant:
    """Four wheels, each with its own drive and steering, on a slope with mounds.

    Wheels: front left, front right, rear left, rear right. x and y are horizontal, as a tracker on the ground
    measures them. docs/explanation/simulators.md lists what is not modelled.

    Args:
        settings: The true rover and its ground.
        rng: Source of the fluctuation of forces.
        start_ns: Time at the start pose, at rest.
        table: Forces of the soil; None uses those of the settings' wheel, soil and mass.

    Raises:
        ConfigError: There is no such wheel or soil.
        ModelError: The soil does not bear the rover.
    """

    wheel_count = 4

    def __init__(
        self,
        settings: ElDoradoPlantSettings,
        rng: np.random.Generator,
        start_ns: int,
        table: WheelTable | None = None,
    ) -> None:
        self._settings = settings
        self._table = table or table_of(settings)
        self._rover = _rover(settings)
        self._ground = _ground(settings)
        self._drives = Drives(
            speed_lag_s=settings.speed_lag_s,
            steer_rate_rad_s=settings.steer_rate_rad_s,
            no_load_current_a=settings.no_load_current_a,
            torque_per_ampere_nm=settings.torque_per_ampere_nm,
            inertia_kg_m2=0.25 * settings.mass_kg * self._rover.radius_m**2,
        )
        self._wheels = WheelState(*(np.zeros(4) for _ in WheelState._fields))
        self._current_a = np.zeros(4)
        self._noise = ColouredNoise(4, settings.fluctuation_time_s, rng, start_ns)
        self._now_ns = self._reached_ns = self._start_ns = start_ns
        self._truth: Truth | None = None
        self._constants = (self._rover, self._drives, self._ground, self._table)

    def compile(self) -> None:
        """Load or compile what integrates; the first step does it otherwise."""
        _ = self._advance, self._write_currents

    @cached_property
    def _state(self) -> State:
        """State; at the start the rover rests on its ground, which compiled code computes."""
        settings = self._settings
        state = State(
            pose=np.array([settings.start_x_m, settings.start_y_m, math.radians(settings.start_yaw_deg)]),
            tilt=np.zeros(2),
            twist=np.zeros(3),
            torque_nm=np.zeros(4),
            slip=np.zeros(4),
        )
        settle(state, self._rover, self._ground)
        return state

    @cached_property
    def _advance(self) -> Callable[..., None]:
        return specialised(advance, self._state, self._wheels, *self._constants, 1.0)

    @cached_property
    def _write_currents(self) -> Callable[..., None]:
        return specialised(write_currents, self._state, self._wheels, self._drives, self._current_a)

    def set_wheel_speeds(self, speed_rad_s: Sequence[float]) -> None:
        """Set the setpoints of the inner speed loops: front left, front right, rear left, rear right."""
        self._catch_up()
        self._wheels.set_rad_s[:] = speed_rad_s
        self._truth = None

    def set_steering(self, angle_rad: Sequence[float]) -> None:
        """Set the steering angles, counter-clockwise, in the order of the wheels."""
        self._catch_up()
        self._wheels.set_steer_rad[:] = angle_rad

    def advance(self, t_ns: int) -> None:
        """Set the present time; does nothing for a time already reached. `truth` integrates on demand."""
        if t_ns > self._now_ns:
            self._now_ns = t_ns
            self._truth = None

    def _catch_up(self) -> None:
        while self._reached_ns < self._now_ns:
            step_ns = min(STEP_NS, self._now_ns - self._reached_ns)
            self._step(seconds(step_ns))
            self._reached_ns += step_ns

    def _step(self, step_s: float) -> None:
        share = self._settings.force_fluctuation
        self._wheels.strength[:] = [
            max(1.0 + share * noise, LEAST_STRENGTH) for noise in self._noise.at(self._reached_ns)
        ]
        self._advance(self._state, self._wheels, *self._constants, step_s)

    def truth(self) -> Truth:
        """Return the state at the time reached."""
        if self._truth is None:
            self._catch_up()
            self._truth = self._state_now()
        return self._truth

    def _state_now(self) -> Truth:
        settings, state, wheels = self._settings, self._state, self._wheels
        x_m, y_m, yaw = state.pose.tolist()
        velocity_x, velocity_y, yaw_rate = state.twist.tolist()
        pitch_rad, roll_rad = state.tilt.tolist()
        self._write_currents(state, wheels, self._drives, self._current_a)
        currents, speeds = self._current_a.tolist(), wheels.speed_rad_s.tolist()
        power_w = sum(
            [
                current * (settings.resistance_ohm * current + settings.torque_per_ampere_nm * speed)
                for current, speed in zip(currents, speeds, strict=True)
            ]
        )
        supply_a = settings.idle_current_a + max(0.0, power_w) / settings.battery_v
        return Truth(
            t_ns=self._now_ns,
            x_m=x_m,
            y_m=y_m,
            yaw_rad=yaw,
            roll_rad=roll_rad,
            pitch_rad=pitch_rad,
            velocity_x_m_s=velocity_x,
            velocity_y_m_s=velocity_y,
            yaw_rate_rad_s=yaw_rate,
            wheel_position_rad=tuple(wheels.angle_rad.tolist()),
            wheel_speed_rad_s=tuple(speeds),
            motor_current_a=tuple(currents),
            slip=tuple(state.slip.tolist()),
            battery_v=fallen_v(
                settings.battery_v - settings.battery_resistance_ohm * supply_a,
                settings.battery_fall_v_s,
                self._now_ns - self._start_ns,
            ),
            bumper_pressed=False,
            steering_rad=tuple(wheels.steer_rad.tolist()),
        )


def table_of(settings: ElDoradoPlantSettings) -> WheelTable:
    """Return the forces of the settings' soil on their wheel.

    Raises:
        ConfigError: There is no such wheel or soil.
        ModelError: The soil does not bear the rover.
    """
    load_n = 0.25 * settings.mass_kg * STANDARD_GRAVITY_M_S2
    return load_table(load_wheel(settings.wheel), load_soil(settings.ground.soil), load_n)


def _rover(settings: ElDoradoPlantSettings) -> Rover:
    half_base_m, half_track_m = 0.5 * settings.wheel_base_m, 0.5 * settings.track_m
    moment = settings.mass_kg * (settings.wheel_base_m**2 + settings.track_m**2) / 12.0
    return Rover(
        contact_m=np.array(
            [(x, y) for x in (half_base_m, -half_base_m) for y in (half_track_m, -half_track_m)]
        ),
        radius_m=load_wheel(settings.wheel).radius_m * (1.0 + settings.wheel_radius_error),
        centre_height_m=settings.centre_height_m,
        inertia=np.array([settings.mass_kg, settings.mass_kg, moment]),
    )


def _ground(settings: ElDoradoPlantSettings) -> Ground:
    shape = settings.ground
    grade, uphill_rad = math.tan(math.radians(shape.inclination_deg)), math.radians(shape.uphill_deg)
    mounds = [(mound.x_m, mound.y_m, mound.height_m, mound.radius_m) for mound in shape.mounds]
    return Ground(
        grade=grade * np.array([math.cos(uphill_rad), math.sin(uphill_rad)]),
        mounds=np.array(mounds, dtype=np.float64).reshape(-1, 4),
    )
