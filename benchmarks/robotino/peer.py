"""The equations of the dynamic Robotino once more, as scipy's solvers want them: the peer of the benchmark.

Written from the equations, not from the plant's code: rates instead of steps, arrays instead of loops, sign
functions smoothed, and a speed loop that reads the speed itself instead of counting ticks 900 times a second
(with the ticks a solver would stop 900 times a second and be slower still).
"""

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from benchmarks.robotino.cells import ANGLES, Cell
from drivers.clock import seconds, stopwatch_ns
from drivers.units import STANDARD_GRAVITY_M_S2
from sim_backends.plants.robotino.settings import RobotinoPlantSettings
from sim_backends.plants.robotino.surfaces import Surface

Floats = NDArray[np.float64]

AXLE = np.column_stack((np.cos(ANGLES), np.sin(ANGLES)))
ROLLING = np.column_stack((-np.sin(ANGLES), np.cos(ANGLES)))
CREEP_M_S = 0.001
SMOOTH_RAD_S = 0.02


class Peer:
    """The rover on an even floor of one surface at constant setpoints.

    The state is x, y, yaw; velocity x, y, yaw rate in the body; wheel speeds; currents.
    """

    def __init__(self, cell: Cell, surface: Surface) -> None:
        self.settings = settings = RobotinoPlantSettings()
        self.surface = surface
        self.set_point = np.array(cell.set_speed_rad_s)
        ahead_m = settings.centre_of_mass_x_m
        behind = np.cos(ANGLES) * ahead_m / settings.wheel_offset_m
        self.load_n = settings.mass_kg * STANDARD_GRAVITY_M_S2 / 3.0 * (1.0 + 2.0 * behind)
        self.idle_v = settings.battery_v - settings.battery_resistance_ohm * settings.idle_current_a

    def rates(self, _t_s: float, state: Floats) -> Floats:
        """Return the derivative of the state."""
        yaw, (vx, vy, turn), speed, current = state[2], state[3:6], state[6:9], state[9:12]
        motor, loop, settings = self.settings.motor, self.settings.speed_loop, self.settings
        gear, radius_m = motor.gear_ratio, settings.wheel_radius_m
        ticks = loop.ticks_per_turn * gear / (2.0 * np.pi) / loop.rate_hz
        counts = ticks * (self.set_point + loop.gain * (self.set_point - speed))
        voltage = self.idle_v * np.clip(counts, -255.0, 255.0) / 255.0
        back_emf_v = gear * motor.speed_constant_v_s_per_rad * speed
        current_rate = (voltage - back_emf_v - motor.resistance_ohm * current) / motor.inductance_h

        centre = np.array([vx, vy])
        rolling = ROLLING @ centre + settings.wheel_offset_m * turn
        sideways = AXLE @ centre
        rim = radius_m * speed
        strain = self.surface.stiffness * (rim - rolling) / np.sqrt(rim**2 + sideways**2 + CREEP_M_S**2)
        traction = self.load_n * strain / np.sqrt(1.0 + (strain / self.surface.friction) ** 2)
        pace = np.sqrt(rolling**2 + sideways**2 + CREEP_M_S**2)
        push = traction - self.load_n * self.surface.drag_along * rolling / pace
        drag = -self.load_n * self.surface.drag_across * sideways / pace

        driving = gear * (motor.torque_constant_nm_per_a * current - motor.viscous_nm_s * gear * speed)
        loss = np.where(driving * speed >= 0.0, motor.gear_efficiency, 1.0 / motor.gear_efficiency)
        friction = gear * motor.gear_efficiency * motor.friction_nm * np.tanh(speed / SMOOTH_RAD_S)
        spin = (driving * loss - friction - radius_m * traction) / (gear**2 * motor.inertia_kg_m2)

        force = push @ ROLLING + drag @ AXLE
        moment = settings.wheel_offset_m * push.sum()
        # Acceleration of the centre of mass, carried over to the centre of the rover.
        ahead_m = settings.centre_of_mass_x_m
        turn_rate = (moment - ahead_m * force[1]) / settings.yaw_inertia_kg_m2
        ax = force[0] / settings.mass_kg + turn * vy + turn**2 * ahead_m
        ay = force[1] / settings.mass_kg - turn * vx - turn_rate * ahead_m
        way = [np.cos(yaw) * vx - np.sin(yaw) * vy, np.sin(yaw) * vx + np.cos(yaw) * vy, turn]
        return np.concatenate((way, [ax, ay, turn_rate], spin, current_rate))


def run_peer(cell: Cell, surface: Surface, duration_s: float) -> tuple[float, Floats]:
    """Return how many times faster than real time the solver is, and the velocity it ends with."""
    peer = Peer(cell, surface)
    started_ns = stopwatch_ns()
    solution = solve_ivp(peer.rates, (0.0, duration_s), np.zeros(12), method="LSODA", rtol=1e-4, atol=1e-6)
    took_s = seconds(stopwatch_ns() - started_ns)
    return duration_s / took_s, solution.y[3:6, -1]
