"""The simulated El-Dorado: integrates the compiled equations of motion to the requested times."""

import math
from collections.abc import Sequence

import numpy as np

from drivers.clock import seconds
from drivers.units import STANDARD_GRAVITY_M_S2
from sim_backends.plants.el_dorado.dynamics import Ground, Rover, State, settle, step
from sim_backends.plants.el_dorado.settings import ElDoradoPlantSettings
from sim_backends.plants.el_dorado.wheel_table import WheelTable, load_table
from sim_backends.terramechanics.soil.library import load_soil, load_wheel
from sim_backends.world.coloured_noise import ColouredNoise
from sim_backends.world.plant import Truth

FRICTION_SMOOTHING_RAD_S = 0.02
STEP_NS = 10_000_000


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
        self._state = State(
            pose=np.array([settings.start_x_m, settings.start_y_m, math.radians(settings.start_yaw_deg)]),
            tilt=np.zeros(2),
            twist=np.zeros(3),
            torque_nm=np.zeros(4),
            slip=np.zeros(4),
        )
        settle(self._state, self._rover, self._ground)
        self._noise = ColouredNoise(4, settings.fluctuation_time_s, rng, start_ns)
        self._now_ns = self._reached_ns = start_ns
        self._set_rad_s, self._set_steer_rad = np.zeros(4), np.zeros(4)
        self._speed_rad_s, self._angle_rad, self._steer_rad = np.zeros(4), np.zeros(4), np.zeros(4)

    def set_wheel_speeds(self, speed_rad_s: Sequence[float]) -> None:
        """Set the set-points of the inner speed loops: front left, front right, rear left, rear right."""
        self._catch_up()
        self._set_rad_s = np.array(speed_rad_s, dtype=np.float64)

    def set_steering(self, angle_rad: Sequence[float]) -> None:
        """Set the steering angles, counter-clockwise, in the order of the wheels."""
        self._catch_up()
        self._set_steer_rad = np.array(angle_rad, dtype=np.float64)

    def advance(self, t_ns: int) -> None:
        """Set the present time; does nothing for a time already reached. `truth` integrates on demand."""
        self._now_ns = max(self._now_ns, t_ns)

    def _catch_up(self) -> None:
        while self._reached_ns < self._now_ns:
            step_ns = min(STEP_NS, self._now_ns - self._reached_ns)
            self._step(seconds(step_ns))
            self._reached_ns += step_ns

    def _step(self, step_s: float) -> None:
        """Integrate one step: the wheels' first-order lag is exact, the body moves at their mean speed."""
        settings = self._settings
        kept = math.exp(-step_s / settings.speed_lag_s)
        speed_error = self._speed_rad_s - self._set_rad_s
        turned = self._set_rad_s * step_s + speed_error * (settings.speed_lag_s * (1.0 - kept))
        self._angle_rad += turned
        self._speed_rad_s = self._set_rad_s + speed_error * kept
        limit_rad = settings.steer_rate_rad_s * step_s
        self._steer_rad += np.clip(self._set_steer_rad - self._steer_rad, -limit_rad, limit_rad)
        strength = 1.0 + settings.force_fluctuation * np.array(self._noise.at(self._reached_ns))
        step(
            self._state,
            self._rover,
            self._ground,
            self._table,
            self._rover.radius_m * turned / step_s,
            self._steer_rad,
            np.maximum(strength, 0.3),
            step_s,
        )

    def truth(self) -> Truth:
        """Return the state at the time reached."""
        self._catch_up()
        settings, state = self._settings, self._state
        x_m, y_m, yaw = state.pose.tolist()
        velocity_x, velocity_y, yaw_rate = state.twist.tolist()
        currents = self._currents_a()
        power_w = sum(
            current * (settings.resistance_ohm * current + settings.torque_per_ampere_nm * speed)
            for current, speed in zip(currents, self._speed_rad_s.tolist(), strict=True)
        )
        supply_a = settings.idle_current_a + max(0.0, power_w) / settings.battery_v
        return Truth(
            t_ns=self._now_ns,
            x_m=x_m,
            y_m=y_m,
            yaw_rad=yaw,
            roll_rad=float(state.tilt[1]),
            pitch_rad=float(state.tilt[0]),
            velocity_x_m_s=velocity_x,
            velocity_y_m_s=velocity_y,
            yaw_rate_rad_s=yaw_rate,
            wheel_position_rad=tuple(self._angle_rad.tolist()),
            wheel_speed_rad_s=tuple(self._speed_rad_s.tolist()),
            motor_current_a=tuple(currents),
            slip=tuple(state.slip.tolist()),
            battery_v=settings.battery_v - settings.battery_resistance_ohm * supply_a,
            bumper_pressed=False,
            steering_rad=tuple(self._steer_rad.tolist()),
        )

    def _currents_a(self) -> list[float]:
        """Return the signed currents for friction, soil and acceleration; the gears hold at rest."""
        settings = self._settings
        turning = self._speed_rad_s / np.hypot(self._speed_rad_s, FRICTION_SMOOTHING_RAD_S)
        acceleration = (self._set_rad_s - self._speed_rad_s) / settings.speed_lag_s
        inertia_nm = 0.25 * settings.mass_kg * self._rover.radius_m**2 * acceleration
        load_nm = np.abs(turning) * self._state.torque_nm + inertia_nm
        currents: list[float] = (
            settings.no_load_current_a * turning + load_nm / settings.torque_per_ampere_nm
        ).tolist()
        return currents


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
