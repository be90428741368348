"""A three-wheeled rover on contacts of several laws: truth for what its gyro and encoders measure.

Every wheel's contact has a tangential law (linear with a limit, exponential, or one that saturates slowly), a
relaxation length, and rollers with drag. The slip that acts lags behind the slip of the rim by the relaxation
length (Pacejka, Tire and Vehicle Dynamics, 2012, section 7.1): sigma ds/dt = sliding - passing * s. At
rest this is a spring. Wheels follow their setpoints by a proportional loop with a limit of the torque.
The ground is made of square tiles with constants of their own. Euler steps of 0.1 ms. It knows nothing of
any estimator.
"""

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numba import njit
from numpy.typing import NDArray

from sim_backends.world.plant import Truth

Array = NDArray[np.float64]

LAWS = ("linear", "exponential", "slow")
STEP_NS = 100_000
TILE_M = 0.3
TILES = 10
"""Per side; the rover starts amid tile (3, 3)."""
REST_M_S = 0.002
"""Below this speed drag fades out instead of changing sign at once."""


@dataclass(frozen=True, kw_only=True)
class Floor:
    """The ground: per tile limit of the force over load, its slope over slip, drag along and across.

    Attributes:
        law: One of `LAWS`.
        relaxation_m: Length that a wheel rolls until the force follows the slip.
        tiles: Shape (`TILES`, `TILES`, 4).
    """

    law: str
    relaxation_m: float
    tiles: Array

    @staticmethod
    def uniform(law: str, relaxation_m: float, constants: Sequence[float]) -> "Floor":
        """Return a ground that is the same everywhere."""
        return Floor(law=law, relaxation_m=relaxation_m, tiles=np.tile(constants, (TILES, TILES, 1)))

    @staticmethod
    def random(rng: np.random.Generator, relaxation_m: float, law: str | None = None) -> "Floor":
        """Return a ground of random constants, on which the rover can still move."""
        shape = (TILES, TILES)
        limit = rng.uniform(0.4, 1.0, shape)
        slope = np.exp(rng.uniform(math.log(1.2), math.log(25.0), shape))
        along = rng.uniform(0.005, 0.12, shape)
        across = rng.uniform(0.03, 0.3, shape)
        chosen = LAWS[int(rng.integers(len(LAWS)))] if law is None else law
        tiles = np.stack((limit, slope, along, across), axis=-1)
        return Floor(law=chosen, relaxation_m=relaxation_m, tiles=tiles)

    @staticmethod
    def slippery(rng: np.random.Generator, relaxation_m: float) -> "Floor":
        """Return a ground on which the rover loses a fifth of its wheels' travel, and in places nearly all.

        The drag across a wheel takes up to 0.6 of the force that its contact can bear.
        """
        shape = (TILES, TILES)
        limit = rng.uniform(0.1, 0.4, shape)
        slope = limit * np.exp(rng.uniform(math.log(1.0), math.log(12.0), shape))
        along = limit * rng.uniform(0.05, 0.25, shape)
        across = limit * rng.uniform(0.2, 0.6, shape)
        tiles = np.stack((limit, slope, along, across), axis=-1)
        return Floor(law=LAWS[int(rng.integers(len(LAWS)))], relaxation_m=relaxation_m, tiles=tiles)


@dataclass(frozen=True, kw_only=True)
class Body:
    """Numbers of the rover, each a little off those that controllers take."""

    mass_kg: float = 13.1
    inertia_kg_m2: float = 0.231
    radius_m: float = 0.0402
    arm_m: float = 0.1254
    wheel_kg_m2: float = 0.0029
    torque_per_error_nm_s: float = 0.55
    torque_limit_nm: float = 2.4
    friction_nm: float = 0.13
    nm_per_a: float = 0.72
    set_point_delay_s: float = 0.08
    loads: tuple[float, float, float] = (0.31, 0.36, 0.33)
    angles_deg: tuple[float, float, float] = (60.0, 180.0, 300.0)


@njit(cache=True)
def _law(kind: int, x: float) -> float:
    if kind == 0:
        return min(max(x, -1.0), 1.0)
    if kind == 1:
        return math.copysign(1.0 - math.exp(-abs(x)), x)
    return 2.0 / math.pi * math.atan(0.5 * math.pi * x)


@njit(cache=True)
def _run(
    steps: int,
    step_s: float,
    kind: int,
    relaxation_m: float,
    tiles: Array,
    body: Array,
    geometry: Array,
    loads_n: Array,
    set_rad_s: Array,
    pose: Array,
    twist: Array,
    speed: Array,
    angle: Array,
    slip: Array,
    torque: Array,
) -> None:
    mass, inertia, radius, arm, wheel, gain, limit, friction = body
    for _ in range(steps):
        fx = fy = turn = 0.0
        c, s = math.cos(pose[2]), math.sin(pose[2])
        for i in range(3):
            ux, uy = geometry[i, 0], geometry[i, 1]
            px, py = uy * arm, -ux * arm
            column = math.floor((pose[0] + c * px - s * py) / TILE_M + 3.5)
            row = math.floor((pose[1] + s * px + c * py) / TILE_M + 3.5)
            tile = tiles[min(max(column, 0), TILES - 1), min(max(row, 0), TILES - 1)]
            along = ux * twist[0] + uy * twist[1] + arm * twist[2]
            across = uy * twist[0] - ux * twist[1]
            rim = radius * speed[i]
            passing = math.hypot(0.5 * (rim + along), across)
            slip[i] += step_s / relaxation_m * (rim - along - passing * slip[i])
            bound = 3.0 * tile[0] / tile[1]
            slip[i] = min(max(slip[i], -bound), bound) if passing < REST_M_S else slip[i]
            push = loads_n[i] * tile[0] * _law(kind, tile[1] * slip[i] / tile[0])
            speed_m_s = math.sqrt(along * along + across * across + REST_M_S * REST_M_S)
            ahead = push - loads_n[i] * tile[2] * along / speed_m_s
            aside = -loads_n[i] * tile[3] * across / speed_m_s
            fx += ux * ahead + uy * aside
            fy += uy * ahead - ux * aside
            turn += arm * ahead
            torque[i] = min(max(gain * (set_rad_s[i] - speed[i]), -limit), limit)
            loss = friction * math.tanh(speed[i] / 0.05)
            speed[i] += step_s * (torque[i] - loss - radius * push) / wheel
            angle[i] += step_s * speed[i]
        ax = fx / mass + twist[2] * twist[1]
        ay = fy / mass - twist[2] * twist[0]
        twist[0] += step_s * ax
        twist[1] += step_s * ay
        twist[2] += step_s * turn / inertia
        pose[0] += step_s * (c * twist[0] - s * twist[1])
        pose[1] += step_s * (s * twist[0] + c * twist[1])
        pose[2] += step_s * twist[2]


@dataclass
class OmniContact:
    """The rover; a `Plant` of the simulated world.

    Args:
        floor: The ground.
        start_ns: Time of the first step.
        body: The rover.
    """

    floor: Floor
    start_ns: int
    body: Body = field(default_factory=Body)
    wheel_count: int = 3

    def __post_init__(self) -> None:
        body = self.body
        angles = np.radians(body.angles_deg)
        self._geometry = np.column_stack((-np.sin(angles), np.cos(angles)))
        self._loads_n = body.mass_kg * 9.81 * np.array(body.loads)
        self._numbers = np.array(
            (
                body.mass_kg,
                body.inertia_kg_m2,
                body.radius_m,
                body.arm_m,
                body.wheel_kg_m2,
                body.torque_per_error_nm_s,
                body.torque_limit_nm,
                body.friction_nm,
            )
        )
        self._pose, self._twist = np.zeros(3), np.zeros(3)
        self._speed, self._angle, self._slip, self._torque = (np.zeros(3) for _ in range(4))
        self._set, self._due = np.zeros(3), deque[tuple[int, Array]]()
        self._t_ns = self.start_ns

    def set_wheel_speeds(self, speed_rad_s: Sequence[float]) -> None:
        """Set the setpoints; they act after the body's delay."""
        delay_ns = round(1e9 * self.body.set_point_delay_s)
        self._due.append((self._t_ns + delay_ns, np.array(speed_rad_s, dtype=float)))

    def advance(self, t_ns: int) -> None:
        """Integrate to the last whole step before `t_ns`."""
        while self._t_ns + STEP_NS <= t_ns:
            while self._due and self._due[0][0] <= self._t_ns:
                self._set = self._due.popleft()[1]
            end_ns = min(t_ns, self._due[0][0]) if self._due else t_ns
            steps = max(1, (end_ns - self._t_ns) // STEP_NS)
            _run(
                steps,
                1e-9 * STEP_NS,
                LAWS.index(self.floor.law),
                max(self.floor.relaxation_m, 0.001),
                self.floor.tiles,
                self._numbers,
                self._geometry,
                self._loads_n,
                self._set,
                self._pose,
                self._twist,
                self._speed,
                self._angle,
                self._slip,
                self._torque,
            )
            self._t_ns += steps * STEP_NS

    def truth(self) -> Truth:
        """Return the state at the time reached; the current is that of the drive torque."""
        return Truth(
            t_ns=self._t_ns,
            x_m=float(self._pose[0]),
            y_m=float(self._pose[1]),
            yaw_rad=float(self._pose[2]),
            roll_rad=0.0,
            pitch_rad=0.0,
            velocity_x_m_s=float(self._twist[0]),
            velocity_y_m_s=float(self._twist[1]),
            yaw_rate_rad_s=float(self._twist[2]),
            wheel_position_rad=tuple(self._angle.tolist()),
            wheel_speed_rad_s=tuple(self._speed.tolist()),
            motor_current_a=tuple((self._torque / self.body.nm_per_a).tolist()),
            slip=tuple(self._slip.tolist()),
            battery_v=24.0,
            bumper_pressed=False,
        )
