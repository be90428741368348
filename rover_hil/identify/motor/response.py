"""How a motor behind a proportional inner speed loop answers its setpoints, in closed form.

A DC motor, its voltage set by the speed error, divided by the torque constant:

    inertia dw/dt = I - friction(w)              friction(w) = coulomb sgn w + viscous w
    electric dI/dt + I = (gain set - w) / droop
    U = Ra (electric dI/dt + I) + Ke w

With lag = inertia droop / (1 + droop viscous) and u the setpoint filtered by the electric lag this is, to
first order in electric / lag, the chain

    lag_1 dw/dt = (u - droop coulomb sgn w) / (1 + droop viscous) - w       electric_2 du/dt = gain set - u
    I = friction(w) + inertia dw/dt

whose two time constants have the sum `lag` and the product `lag * electric`. `lag` and `inertia` are fitted
apart from each other, so that a loop with integral action or a limit on its voltage fits too. Friction and
inertia are in units of the torque constant: a current determines no more.

Left out: voltage limit, sticking, ripple, integral action of the loop.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from rover_hil.drives.arrays import Array
from rover_hil.identify.motor.parameters import MOTOR_FIT
from rover_hil.identify.motor.record import Moves

STANDSTILL_RAD_S = 1e-6
SHORTEST_LAG_S = 1e-6
NEWTON_STEPS = 5


@dataclass(frozen=True, slots=True, kw_only=True)
class MotorModel:
    """Parameters of the response.

    Attributes:
        gain: Speed per setpoint without load.
        droop_rad_s_per_a: Speed lost per ampere of friction.
        lag_s: Time constant of the inner speed loop.
        coulomb_a: Coulomb friction / Kt.
        viscous_a_s_per_rad: Viscous friction / Kt.
        inertia_a_s2_per_rad: Inertia / Kt.
        resistance_ohm: Ra.
        speed_constant_v_s_per_rad: Ke.
        electric_lag_s: La / Ra; held, never fitted.
    """

    gain: float = 1.0
    droop_rad_s_per_a: float = 0.0
    lag_s: float = 0.01
    coulomb_a: float = 0.2
    viscous_a_s_per_rad: float = 0.0
    inertia_a_s2_per_rad: float = 1e-4
    resistance_ohm: float = 0.0
    speed_constant_v_s_per_rad: float = 0.0
    electric_lag_s: float = 0.0

    def friction_a(self, speed_rad_s: Array) -> Array:
        """Return the current that friction needs, signed like the speed."""
        sign = np.tanh(speed_rad_s / MOTOR_FIT.response.sign_smoothing_rad_s)
        return self.coulomb_a * sign + self.viscous_a_s_per_rad * speed_rad_s

    def time_constants_s(self) -> tuple[float, float]:
        """Return the long and the short time constant of the chain."""
        spread = math.sqrt(
            max(1.0 - 4.0 * self.electric_lag_s / self.lag_s, MOTOR_FIT.response.least_damping)
        )
        short_s = max(self.lag_s * (1.0 - spread) / 2.0, SHORTEST_LAG_S)
        return max(self.lag_s - short_s, 2.0 * short_s), short_s


class Piece(NamedTuple):
    """A stretch between two events: speed = goal + slow exp(-t/long) + fast exp(-t/short)."""

    t_s: float
    position: float
    goal: float
    slow: float
    fast: float


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """Speed, position, acceleration and its change at some times, SI."""

    speed: Array
    position: Array
    acceleration: Array
    jerk: Array


@dataclass(frozen=True, slots=True, eq=False)
class Response:
    """The answer to a sequence of setpoints.

    Attributes:
        model: The motor.
        pieces: One row for each piece, columns as in `Piece`.
    """

    model: MotorModel
    pieces: Array

    def at(self, t_s: Array) -> Motion:
        """Return the motion at any times; before the first piece the speed stays as it was."""
        long_s, short_s = self.model.time_constants_s()
        index = np.maximum(np.searchsorted(self.pieces[:, 0], t_s, side="right") - 1, 0)
        begin_s, position, goal, slow, fast = self.pieces[index].T
        since_s = t_s - begin_s
        is_before = since_s < 0
        since_s = np.maximum(since_s, 0.0)
        slowly = slow * np.exp(-since_s / long_s)
        fastly = fast * np.exp(-since_s / short_s)
        travel = goal * since_s + long_s * (slow - slowly) + short_s * (fast - fastly)
        speed = goal + slowly + fastly
        return Motion(
            speed,
            position + np.where(is_before, speed * (t_s - begin_s), travel),
            np.where(is_before, 0.0, -slowly / long_s - fastly / short_s),
            np.where(is_before, 0.0, slowly / long_s**2 + fastly / short_s**2),
        )

    def current_a(self, motion: Motion) -> Array:
        """Return the signed current of a motion."""
        return self.model.friction_a(motion.speed) + self.model.inertia_a_s2_per_rad * motion.acceleration

    def voltage_v(self, motion: Motion) -> Array:
        """Return the terminal voltage of a motion."""
        model = self.model
        rate = model.viscous_a_s_per_rad * motion.acceleration + model.inertia_a_s2_per_rad * motion.jerk
        through = self.current_a(motion) + model.electric_lag_s * rate
        return np.asarray(model.resistance_ohm * through + model.speed_constant_v_s_per_rad * motion.speed)


def respond(model: MotorModel, moves: Moves, delay_s: Array, first_speed_rad_s: float) -> Response:
    """Return the answer to a sequence of setpoints.

    Args:
        model: The motor.
        moves: Its setpoints.
        delay_s: Loop delay of each move.
        first_speed_rad_s: Speed before the first setpoint arrives.
    """
    begins_s = np.maximum.accumulate(moves.t_s + delay_s[moves.move]).tolist()
    walker = _Walker(model, begins_s[0], first_speed_rad_s)
    for end_s, set_point in zip([*begins_s[1:], math.inf], moves.value.tolist(), strict=True):
        walker.walk(model.gain * set_point, end_s)
    return Response(model, np.array(walker.pieces))


class _Walker:
    """Walks through the setpoints and leaves the pieces behind.

    The state: time, speed, position, and the filtered drive (u above).
    """

    def __init__(self, model: MotorModel, t_s: float, speed: float) -> None:
        self._long_s, self._short_s = model.time_constants_s()
        self._load = model.droop_rad_s_per_a * model.coulomb_a
        self._share = 1.0 + model.droop_rad_s_per_a * model.viscous_a_s_per_rad
        self._t_s, self._speed, self._position = t_s, speed, 0.0
        self._drive = self._share * speed + (math.copysign(self._load, speed) if speed else 0.0)
        self.pieces: list[Piece] = []

    def walk(self, target: float, end_s: float) -> None:
        """Go on with a drive towards `target` until `end_s`."""
        if abs(self._speed) >= STANDSTILL_RAD_S:
            piece = self._add_piece(target, math.copysign(1.0, self._speed))
            stop_s = self._stop_s(piece)
            if stop_s >= end_s:
                self._advance(target, end_s)
                return
            self._advance(target, stop_s)
            self._speed = 0.0
        side = math.copysign(1.0, target)
        if abs(target) <= self._load or target == 0.0:
            self.pieces.append(Piece(self._t_s, self._position, 0.0, 0.0, 0.0))
            self._t_s, self._drive = end_s, 0.0
            return
        if self._drive * side < self._load:
            self._break_away(target, side)
        self._add_piece(target, side)
        self._advance(target, end_s)

    def _break_away(self, target: float, side: float) -> None:
        """Wait at rest until the drive overcomes friction."""
        wait_s = self._short_s * math.log((target - self._drive) / (target - side * self._load))
        self.pieces.append(Piece(self._t_s, self._position, 0.0, 0.0, 0.0))
        self._t_s += wait_s
        self._drive = side * self._load

    def _add_piece(self, target: float, direction: float) -> Piece:
        load = self._load * direction
        goal = (target - load) / self._share
        fast = (self._drive - target) / self._share * self._short_s / (self._short_s - self._long_s)
        piece = Piece(self._t_s, self._position, goal, self._speed - goal - fast, fast)
        self.pieces.append(piece)
        return piece

    def _stop_s(self, piece: Piece) -> float:
        """Return when the speed reaches 0; infinity when it does not."""
        if piece.goal * self._speed >= 0.0:
            return math.inf
        since_s = max(self._long_s * math.log(max(-piece.slow / piece.goal, 1.0)), 0.0)
        for _ in range(NEWTON_STEPS):
            slow = piece.slow * math.exp(-since_s / self._long_s)
            fast = piece.fast * math.exp(-since_s / self._short_s)
            slope = -slow / self._long_s - fast / self._short_s
            if slope * self._speed >= 0.0:
                break
            since_s = max(since_s - (piece.goal + slow + fast) / slope, 0.0)
        return piece.t_s + since_s

    def _advance(self, target: float, t_s: float) -> None:
        if t_s == math.inf:
            return
        piece = self.pieces[-1]
        since_s = max(t_s - piece.t_s, 0.0)
        slow = piece.slow * math.exp(-since_s / self._long_s)
        fast_share = math.exp(-since_s / self._short_s)
        fast = piece.fast * fast_share
        self._t_s = max(t_s, piece.t_s)
        self._speed = piece.goal + slow + fast
        self._position = (
            piece.position
            + piece.goal * since_s
            + self._long_s * (piece.slow - slow)
            + self._short_s * (piece.fast - fast)
        )
        self._drive = target + (self._drive - target) * fast_share
