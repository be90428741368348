"""A gear motor behind the speed loop of its board, without friction, with the effects that may be missing.

    U = feed_forward s + stiffness (s - w)        cut to the supply; s the setpoint in whole steps
    I = (U - Km w) / R                            J dw/dt = Km I

Where the voltage at the motor was measured, it takes the place of the loop. The electric time constant,
1.7 ms, is left out. SI units at the motor's shaft. A leaky integral in the loop multiplies its stiffness.

Readings: speed in steps; current a magnitude, cut to whole steps, where the labels of a run require it. A
loop answers a jump of its setpoint within a few milliseconds, between two readings: 168 measured jumps were
up to 175 rad/s, which takes amperes, but only one reading reached 1.05 A. In a loop the current is therefore
that of friction and of lasting accelerations; an isolated jump shows none.
"""

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numba import njit
from scipy.ndimage import median_filter

from drivers.robotino_board.robotino_2 import ROBOTINO_BOARD, ROBOTINO_SCALES
from sim_backends.models.interface import Array, Channel, EffectCard, Run, Values
from sim_backends.models.nominal_values import NominalValues
from sim_backends.models.robotino_motor.effects import (
    COPPER_PER_K,
    bridge_voltage_v,
    dry_friction_nm,
    supply_share,
)
from sim_backends.models.tables import read_tables

SUBSTEPS = 6
PART_SHARES = (np.arange(SUBSTEPS) + 0.5) / SUBSTEPS
MOST_STRETCHES = 4
LASTING_ROWS = 5
LEAST_OHM = 0.1
"""Below which a small base value and a large change together do not go."""
SPEED_STEP_RAD_S = ROBOTINO_SCALES.speed_rad_s * ROBOTINO_BOARD.gear_ratio
"""Step of the board's speeds at the motor: 27 rpm."""
CURRENT_STEP_A = ROBOTINO_SCALES.current_step_a

CHANNELS = (
    Channel(name="speed_rad_s", unit="rad/s", quantum=SPEED_STEP_RAD_S),
    Channel(name="current_a", unit="A", quantum=CURRENT_STEP_A),
)

PARAMETERS, EFFECTS = read_tables(__file__)
NOMINAL = NominalValues(PARAMETERS, EFFECTS)


class RobotinoMotor:
    """A `Model` of one motor over time.

    Conditions: `integral` is 1 where the loop has integral action, else 0. Labels of a run that the model
    uses: `speed_step_rad_s` (of the setpoint), `current_step_a`, `is_unsigned`.

    Attributes:
        alternative_inputs: A run has setpoints or, where they were measured, voltages.
    """

    name = "robotino-motor"
    channels: tuple[Channel, ...] = CHANNELS
    condition_units: Mapping[str, str] = {"integral": "1"}
    input_units: Mapping[str, str] = {
        "t_s": "s",
        "set_point_rad_s": "rad/s",
        "voltage_v": "V",
        "others_current_a": "A",
    }
    alternative_inputs = ("set_point_rad_s", "voltage_v")
    parameters = PARAMETERS
    effects: tuple[EffectCard, ...] = EFFECTS

    def predict(
        self, runs: Sequence[Run], parameters: Values, effects: Mapping[str, Values]
    ) -> list[dict[str, Array]]:
        """Predict speed and current of every run. See `Model.predict`."""
        base, active = NOMINAL.fill(parameters, effects)
        return [self._table(run, base, active) for run in runs]

    def _table(self, run: Run, base: Values, active: Mapping[str, Values]) -> dict[str, Array]:
        t_s = run.inputs["t_s"]
        is_loop = "voltage_v" not in run.inputs
        drive = run.inputs["set_point_rad_s" if is_loop else "voltage_v"]
        step = run.conditions.get("speed_step_rad_s", 0.0)
        if is_loop and step > 0.0:
            drive = np.trunc(drive / step + 1e-9 * np.sign(drive)) * step
        if is_loop:
            longest_s = base["wait_share"] * float(np.median(np.diff(t_s)))
            acting = _held(t_s, drive, _middles(t_s) - active["loop_delay"]["time"], longest_s)
        else:
            acting = np.interp(_middles(t_s), t_s, drive)
        others_a = run.inputs["others_current_a"]
        supply = supply_share(active["battery_sag"], t_s, others_a, base["supply_v"])
        numbers = _numbers(base, active, is_loop=is_loop, integral=run.conditions["integral"])
        speed, current, brake = _simulate(t_s, acting, supply, numbers)
        if is_loop:
            pull = brake + numbers[2] * _lasting_rate(t_s, speed)
            current = np.where(speed == 0.0, current, pull / numbers[0])
        return {
            "speed_rad_s": speed,
            "current_a": _reading(run, current, active["current_offset"]["offset"]),
        }


def _middles(t_s: Array) -> Array:
    """Return the middles of the parts that the time from row to row is integrated in: rows x parts."""
    middles: Array = t_s[:-1, None] + np.diff(t_s)[:, None] * PART_SHARES
    return middles


@njit(cache=True)
def _held(t_s: Array, drive: Array, at_s: Array, longest_s: float) -> Array:
    """Return the setpoint that acts at each ascending time: it replaces the one before in `longest_s`."""
    held = np.zeros(at_s.shape)
    row = -1
    for index, time_s in np.ndenumerate(at_s):
        while row + 1 < t_s.size and t_s[row + 1] <= time_s:
            row += 1
        if row < 0:
            continue
        before = drive[row - 1] if row > 0 else 0.0
        done = min(max((time_s - t_s[row]) / longest_s, 0.0), 1.0)
        held[index] = before + done * (drive[row] - before)
    return held


def _numbers(base: Values, active: Mapping[str, Values], *, is_loop: bool, integral: float) -> Array:
    """Return the constants of `_simulate` in its order."""
    stiffness = base["stiffness_v_s_rad"] + active["loop_stiffness"]["change"]
    stiffness *= base["integral_factor"] if integral > 0.5 else 1.0
    heat = active["winding_heat"]
    return np.array(
        [
            base["motor_constant_v_s_rad"] + active["back_emf"]["change"],
            max(base["resistance_ohm"] + active["winding_resistance"]["change"], LEAST_OHM),
            base["inertia_kg_m2"] + active["load_inertia"]["change"],
            max(stiffness, 0.0) if is_loop else 0.0,
            base["feed_forward_v_s_rad"] if is_loop else 1.0,
            base["supply_v"] if is_loop else math.inf,
            active["coulomb_friction"]["torque"],
            active["viscous_friction"]["per_speed"],
            active["stribeck_friction"]["excess"],
            active["stribeck_friction"]["speed"],
            active["asymmetric_friction"]["excess"],
            active["dead_zone"]["voltage"],
            COPPER_PER_K * heat["per_watt"],
            heat["time"],
            active["battery_sag"]["per_amp"] / base["supply_v"],
        ]
    )


def _lasting_rate(t_s: Array, speed: Array) -> Array:
    """Return the acceleration that lasts over several rows: the median of five differences."""
    rate = np.diff(speed, prepend=0.0) / np.maximum(np.diff(t_s, prepend=t_s[0] - 1.0), 1e-9)
    lasting: Array = median_filter(rate, LASTING_ROWS, mode="nearest")
    return lasting


def _reading(run: Run, current: Array, offset_a: float) -> Array:
    """Return the mean reading of the sensor for a current."""
    step = run.conditions.get("current_step_a", 0.0)
    is_unsigned = run.conditions.get("is_unsigned", 0.0) > 0.5
    magnitude = np.abs(current)
    # Cutting to whole steps takes half a step away, on average, of what is above one.
    cut = magnitude - 0.5 * step * -np.expm1(-magnitude / step) if step > 0.0 else magnitude
    return np.maximum(cut + offset_a, 0.0) if is_unsigned else np.copysign(cut, current) + offset_a


@njit(cache=True)
def _advance(speed: float, drive: float, share: float, resistance: float, h: float, numbers: Array) -> float:
    """Return the speed after `h`."""
    for _ in range(MOST_STRETCHES):
        speed, h = _stretch(speed, drive, share, resistance, h, numbers)
        if h <= 0.0:
            break
    return speed


@njit(cache=True)
def _stretch(
    speed: float, drive: float, share: float, resistance: float, h: float, numbers: Array
) -> tuple[float, float]:
    """Return the speed after `h`, or where its sign or the limit of the supply changes, and the time left."""
    motor, inertia, stiffness, forward, supply = numbers[0], numbers[2], numbers[3], numbers[4], numbers[5]
    output = forward * drive + stiffness * (drive - speed)
    gain = stiffness
    is_cut = abs(output) > supply * (1.0 + 1e-9)
    free_speed = speed
    if is_cut:
        output, gain = math.copysign(supply, output), 0.0
        if stiffness > 0.0:
            free_speed = ((forward + stiffness) * drive - output) / stiffness
    voltage = bridge_voltage_v(output, share, numbers[11])
    push = motor / resistance * (voltage - motor * speed)
    direction = math.copysign(1.0, speed) if speed != 0.0 else math.copysign(1.0, push)
    dry = dry_friction_nm(speed, direction, numbers[6], numbers[8], numbers[9], numbers[10])
    if speed == 0.0 and abs(push) <= dry:
        return 0.0, 0.0
    damping = motor / resistance * (motor + gain * share) + numbers[7]
    change = (push - direction * dry - numbers[7] * speed) / damping
    after = speed + change * -math.expm1(-damping / inertia * h)
    end = after
    if after * direction < 0.0:
        end = 0.0
    if is_cut and (free_speed - speed) * (free_speed - end) < 0.0:
        end = free_speed
    if end == after:
        return after, 0.0
    return end, h + math.log1p(-(end - speed) / change) * inertia / damping


@njit(cache=True)
def _current(speed: float, drive: float, share: float, resistance: float, numbers: Array) -> float:
    output = numbers[4] * drive + numbers[3] * (drive - speed)
    output = min(max(output, -numbers[5]), numbers[5])
    voltage = bridge_voltage_v(output, share, numbers[11])
    return float((voltage - numbers[0] * speed) / resistance)


@njit(cache=True)
def _simulate(t_s: Array, acting: Array, share: Array, numbers: Array) -> tuple[Array, Array, Array]:
    """Return speed, circuit current and friction torque at each row; the motor rests at the first.

    Constants: motor constant, resistance, inertia, stiffness, feed-forward, supply; dry friction, viscous
    friction, breakaway excess, its speed, excess forwards; lost voltage; resistance's growth per W, its
    time; share of the supply lost per own current.
    """
    count = t_s.size
    speed, current, brake = np.zeros(count), np.zeros(count), np.zeros(count)
    here, heat, load = 0.0, 0.0, 0.0
    is_loop = numbers[3] > 0.0
    for row in range(count):
        resistance = numbers[1] * (1.0 + heat)
        left = max(share[row] - numbers[14] * abs(load), 0.0)
        if row > 0:
            h = (t_s[row] - t_s[row - 1]) / SUBSTEPS
            now = 0.0
            for part in range(SUBSTEPS):
                now = acting[row - 1, part]
                here = _advance(here, now, left, resistance, h, numbers)
            current[row] = _current(here, now, left, resistance, numbers)
        speed[row] = here
        if here != 0.0:
            direction = math.copysign(1.0, here)
            dry = dry_friction_nm(here, direction, numbers[6], numbers[8], numbers[9], numbers[10])
            brake[row] = direction * dry + numbers[7] * here
        load = brake[row] / numbers[0] if is_loop and here != 0.0 else current[row]
        if row > 0 and numbers[12] > 0.0:
            keep = math.exp(-(t_s[row] - t_s[row - 1]) / numbers[13])
            heat = keep * heat + (1.0 - keep) * numbers[12] * resistance * load**2
    return speed, current, brake


def make_model() -> RobotinoMotor:
    """Return the model with its effects."""
    return RobotinoMotor()
