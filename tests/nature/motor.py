"""A gear motor on a Robotino board, written from circuit and firmware: truth for its identification.

    L dI/dt = U - R I - Ke w          J dw/dt = Kt I - Tc(t) sgn w - b w

integrated by Runge-Kutta, many motors at once. Every 1/900 s the board counts the encoder ticks of the last
1/900 s, adds kp/16 times its error to the setpoint, and gives the sum, 255 at most, as share of the supply.
It knows nothing of the model that is fitted to it.
"""

import gzip
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]

CYCLE_S = 1 / 900
FULL_OUTPUT = 255.0
TICKS_PER_TURN = 2000
STEP_RAD_S = 27 * math.tau / 60
COUNTS_PER_A = 156
MEASURED_PERIOD_S = 0.0306
MEASURED_RIPPLE_A = 0.18
"""Deviation of a current reading at 1 A in the motor identification records; it grows with the root."""
STICTION_WIDTH_RAD_S = 0.5
NUMBERS = (
    "resistance_ohm", "inductance_h", "speed_constant_v_s", "torque_constant_nm_a", "inertia_kg_m2",
    "viscous_nm_s", "breakaway_nm", "film_rad_s", "forward_nm", "drag_nm_s2",
)  # fmt: skip
"""Names of the constants that the compiled steps read by their place."""
FRICTION_TIME_S = 0.5


@dataclass(frozen=True, kw_only=True)
class TrueMotor:
    """Physical constants in SI units at the motor; data-sheet and identified values of a GR 42x25.

    From `breakaway_nm` on what such motors can have: more friction at rest, which fades over `film_rad_s`,
    more friction forwards, drag with the square of speed, voltage lost in the bridge, offset of the current.
    """

    resistance_ohm: float = 5.34
    inductance_h: float = 8.9e-3
    speed_constant_v_s: float = 0.0501
    torque_constant_nm_a: float = 0.0501
    inertia_kg_m2: float = 1.05e-5
    coulomb_nm: float = 9.0e-3
    viscous_nm_s: float = 1.6e-5
    supply_v: float = 24.0
    kp: float = 200.0
    delay_s: float = 0.11
    breakaway_nm: float = 0.0
    film_rad_s: float = 15.0
    forward_nm: float = 0.0
    drag_nm_s2: float = 0.0
    lost_v: float = 0.0
    offset_a: float = 0.0

    @property
    def stiffness_v_s(self) -> float:
        """Volts per rad/s of error that the board adds."""
        return self.feed_forward_v_s * self.kp / 16

    @property
    def feed_forward_v_s(self) -> float:
        """Volts per rad/s of setpoint."""
        return self.supply_v / FULL_OUTPUT / STEP_RAD_S


@dataclass(frozen=True, kw_only=True)
class Measured:
    """What the host writes down: rows by motors."""

    t_s: Array
    set_point_rad_s: Array
    ticks: Array
    speed_rad_s: Array
    current_a: Array
    voltage_v: Array


def staircase(
    speeds_rad_s: Sequence[float], hold_s: float = 4.0, rest_s: float = 1.0
) -> list[tuple[float, float]]:
    """Return (duration, setpoint) up and down through every speed, as in the measured records."""
    return [
        part for speed in speeds_rad_s for sign in (1, -1) for part in ((hold_s, sign * speed), (rest_s, 0.0))
    ]


def measure(
    motor: TrueMotor,
    profile: Sequence[tuple[float, float]],
    count: int,
    rng: np.random.Generator,
    *,
    steps_per_cycle: int = 4,
    ripple_a: float = MEASURED_RIPPLE_A,
    delay_spread_s: float = 0.0,
    friction_spread: float = 0.05,
    voltage_noise_v: float = 0.2,
) -> Measured:
    """Drive `count` motors of one kind through a profile and write down what the host sees.

    Args:
        delay_spread_s: Standard deviation of the delay from one setpoint to the next.
        friction_spread: Standard deviation of the slow changes of Coulomb friction, as a share of it.
    """
    step_s = CYCLE_S / steps_per_cycle
    rows = _row_steps(sum(duration for duration, _ in profile), step_s, rng)
    t_s: Array = rows.astype(np.float64) * step_s
    ends = np.cumsum([duration for duration, _ in profile])
    place = np.minimum(np.searchsorted(ends, t_s, side="right"), len(profile) - 1)
    set_points = np.array([value for _, value in profile])[place]
    changes = np.r_[0, np.flatnonzero(np.diff(place)) + 1]
    delays = motor.delay_s + delay_spread_s * rng.standard_normal((changes.size, count))
    arrival_s = np.maximum.accumulate(t_s[changes, None] + np.maximum(delays, 0.0), axis=0)
    steps = np.trunc(set_points[changes] / STEP_RAD_S + np.sign(set_points[changes]) * 1e-9)
    plant = _Motors(motor, count, steps_per_cycle, friction_spread, rng)
    seen = _run(plant, rows, steps_per_cycle, arrival_s, steps)
    noise = ripple_a * np.sqrt(np.abs(seen[:, 2])) * rng.standard_normal(seen[:, 2].shape)
    shown_a = np.maximum(np.abs(seen[:, 2] + noise) + motor.offset_a, 0.0)
    counts = np.floor(shown_a * COUNTS_PER_A / 4) * 4
    return Measured(
        t_s=t_s,
        set_point_rad_s=set_points,
        ticks=seen[:, 0],
        speed_rad_s=seen[:, 1] * STEP_RAD_S,
        current_a=counts / COUNTS_PER_A,
        voltage_v=seen[:, 3] + voltage_noise_v * rng.standard_normal(seen[:, 3].shape),
    )


def _run(
    plant: "_Motors", rows: NDArray[np.int64], steps_per_cycle: int, arrival_s: Array, steps: Array
) -> Array:
    """Return ticks, speed count, current and voltage at each row, for every motor."""
    count = arrival_s.shape[1]
    reached = np.zeros(count, dtype=np.intp) - 1
    seen = np.zeros((rows.size, 4, count))
    next_row = 0
    for index in range(int(rows[-1]) + 1):
        if index % steps_per_cycle == 0:
            now_s = index * CYCLE_S / steps_per_cycle
            following = np.minimum(reached + 1, steps.size - 1)
            reached = np.where(arrival_s[following, np.arange(count)] <= now_s, following, reached)
            plant.control(np.where(reached < 0, 0.0, steps[np.maximum(reached, 0)]))
        if index == rows[next_row]:
            seen[next_row] = plant.ticks(), plant.speed_count, plant.current, plant.voltage
            next_row += 1
        plant.step()
    return seen


def write_csv(path: Path, measured: Measured, motors: Sequence[int], *, voltage: bool = False) -> Path:
    """Write three of the motors in the layout of the measured records."""
    names = ["t"]
    units = ["ms"]
    columns = [measured.t_s * 1e3]
    fields = [
        ("setvel", "rad/s", np.repeat(measured.set_point_rad_s[:, None], measured.ticks.shape[1], axis=1)),
        ("pos", "ticks", measured.ticks),
        ("vel", "rad/s", measured.speed_rad_s),
        ("cur", "A", measured.current_a),
    ]
    if voltage:
        fields.append(("volt", "V", measured.voltage_v))
    for name, unit, values in fields:
        for place, motor in enumerate(motors, start=1):
            names.append(f"m{place}{name}")
            units.append(unit)
            columns.append(values[:, motor])
    rows = ("".join(f"{value:.6g};" for value in row) for row in zip(*columns, strict=True))
    heads = (";".join(names) + ";", ";".join(units) + ";", ";".join(names) + ";")
    text = "\n".join((*heads, *rows, ""))
    path.write_bytes(gzip.compress(text.encode()) if path.suffix == ".gz" else text.encode())
    return path


def _row_steps(duration_s: float, step_s: float, rng: np.random.Generator) -> NDArray[np.int64]:
    count = int(duration_s / MEASURED_PERIOD_S)
    gaps_s = MEASURED_PERIOD_S + 6e-4 * rng.standard_normal(count)
    later: NDArray[np.int64] = np.round(np.cumsum(gaps_s) / step_s).astype(np.int64)
    return np.concatenate((np.zeros(1, dtype=np.int64), later))


class _Motors:
    """State of many equal motors."""

    def __init__(
        self,
        motor: TrueMotor,
        count: int,
        steps_per_cycle: int,
        friction_spread: float,
        rng: np.random.Generator,
    ) -> None:
        self._motor = motor
        self._step_s = CYCLE_S / steps_per_cycle
        self._numbers = np.array([getattr(motor, name) for name in NUMBERS])
        self._rng = rng
        self._spread = friction_spread
        self._state = np.zeros((3, count))
        self._state[2] = rng.uniform(0.0, 0.1, count)
        self._friction = np.zeros(count)
        self._last_ticks = self.ticks()
        self.speed_count = np.zeros(count)
        self.voltage = np.zeros(count)

    @property
    def current(self) -> Array:
        return np.asarray(self._state[0].copy())

    def ticks(self) -> Array:
        return np.asarray(np.floor(self._state[2] * TICKS_PER_TURN / math.tau))

    def control(self, set_steps: Array) -> None:
        ticks = self.ticks()
        self.speed_count, self._last_ticks = ticks - self._last_ticks, ticks
        output = set_steps + self._motor.kp / 16 * (set_steps - self.speed_count)
        output = np.where((set_steps == 0) & (self.speed_count == 0), 0.0, output)
        voltage = np.clip(output, -FULL_OUTPUT, FULL_OUTPUT) / FULL_OUTPUT * self._motor.supply_v
        self.voltage = np.sign(voltage) * np.maximum(np.abs(voltage) - self._motor.lost_v, 0.0)
        keep = math.exp(-CYCLE_S / FRICTION_TIME_S)
        fresh = math.sqrt(1 - keep * keep) * self._rng.standard_normal(self._friction.size)
        self._friction = keep * self._friction + fresh

    def step(self) -> None:
        friction = self._motor.coulomb_nm * (1 + self._spread * self._friction)
        self._state = _advance(self._state, friction, self.voltage, self._step_s, self._numbers)


@njit(cache=True)
def _advance(state: Array, friction: Array, voltage: Array, h: float, numbers: Array) -> Array:
    """Return current, speed and angle of the motors after a Runge-Kutta step."""
    after = np.empty_like(state)
    for motor in range(friction.size):
        current, speed, dry, volts = state[0, motor], state[1, motor], friction[motor], voltage[motor]
        i1, w1 = _slope(current, speed, dry, volts, numbers)
        i2, w2 = _slope(current + h / 2 * i1, speed + h / 2 * w1, dry, volts, numbers)
        i3, w3 = _slope(current + h / 2 * i2, speed + h / 2 * w2, dry, volts, numbers)
        i4, w4 = _slope(current + h * i3, speed + h * w3, dry, volts, numbers)
        after[0, motor] = current + h / 6 * (i1 + 2 * i2 + 2 * i3 + i4)
        after[1, motor] = speed + h / 6 * (w1 + 2 * w2 + 2 * w3 + w4)
        after[2, motor] = state[2, motor] + h * speed + h * h / 6 * (w1 + w2 + w3)
    return after


@njit(cache=True)
def _slope(
    current: float, speed: float, friction: float, voltage: float, numbers: Array
) -> tuple[float, float]:
    """Return how fast current and speed change."""
    dry = friction + numbers[6] * math.exp(-abs(speed) / numbers[7])
    if speed > 0.0:
        dry += numbers[8]
    brake = dry * math.tanh(speed / STICTION_WIDTH_RAD_S) + numbers[5] * speed
    brake += numbers[9] * speed * abs(speed)
    return (
        (voltage - numbers[0] * current - numbers[2] * speed) / numbers[1],
        (numbers[3] * current - brake) / numbers[4],
    )
