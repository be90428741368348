"""Effort of a gear motor from its current: the paper's quantity M and the wheel torque. Plain floats."""

import math
from enum import StrEnum
from typing import Annotated, NamedTuple

from pydantic import Field

from controllers.slip.effort.parameters import EFFORT, SPEED_STEP_RAD_S
from drivers.settings import Settings


class MotorSettings(Settings):
    """A permanent-magnet gear motor. The defaults are those of a Robotino 2.

    Attributes:
        resistance_ohm: Of the windings; 5.34 identified by the paper's authors, 5.95 by the data sheet.
        back_emf_v_s_rad: Voltage per motor speed.
        torque_constant_nm_a: Torque per current at the motor's shaft.
        gear_ratio: Motor turns per wheel turn.
        gear_efficiency: Share of the power that passes the gear, in both directions.
        coulomb_torque_nm: Dry friction at the motor's shaft, from a no-load current of 0.2 A.
        viscous_torque_nm_s_rad: Friction per motor speed.
        inertia_kg_m2: Of the rotor.
        current_full_scale_a: Greatest current that the sensor can measure; 6.5 A on an EA05 board.

    Source: BrOleg5/Slippage-compensation `scripts/model_parameters.m`; data sheet Dunkermotoren GR 42x25.
    """

    resistance_ohm: Annotated[float, Field(ge=0.01, le=1000.0)] = 5.34
    back_emf_v_s_rad: Annotated[float, Field(ge=1e-4, le=10.0)] = 0.0501
    torque_constant_nm_a: Annotated[float, Field(ge=1e-4, le=10.0)] = 0.0514
    gear_ratio: Annotated[float, Field(ge=1.0, le=1000.0)] = 16.0
    gear_efficiency: Annotated[float, Field(ge=0.1, le=1.0)] = 1.0
    coulomb_torque_nm: Annotated[float, Field(ge=0.0, le=10.0)] = 0.0103
    viscous_torque_nm_s_rad: Annotated[float, Field(ge=0.0, le=1.0)] = 0.0
    inertia_kg_m2: Annotated[float, Field(ge=0.0, le=1.0)] = 7.1e-6
    current_full_scale_a: Annotated[float, Field(gt=0.0, le=1000.0)] = 6.5


def paper_torque(motor: MotorSettings, current_a: float, wheel_speed_rad_s: float, direction: float) -> float:
    """Return the paper's torque-like quantity M in N m at the motor, bounded at every speed.

    Paper 003, M = U I / w with U = R I + C_e w, that is M = C_e I + R I^2 / w. The pole at rest is removed:
    |w| / (w^2 + w_eps^2) replaces 1 / w, with w_eps = `slowest_rad_s`. C_e is written k_t: the two are one
    constant in SI. Most of M at low speed is copper loss, not torque.

    Args:
        motor: The motor.
        current_a: Its current; only the magnitude counts, M has no meaning while a motor brakes.
        wheel_speed_rad_s: Speed of its wheel.
        direction: +1 or -1, the direction of drive, which M takes as its sign also on a stalled wheel.
    """
    magnitude_a = abs(current_a)
    speed = abs(wheel_speed_rad_s) * motor.gear_ratio
    slowest = EFFORT.motor.slowest_rad_s * motor.gear_ratio
    copper_nm = motor.resistance_ohm * magnitude_a**2 * speed / (speed**2 + slowest**2)
    return direction * (motor.torque_constant_nm_a * magnitude_a + copper_nm)


def wheel_torque(
    motor: MotorSettings,
    current_a: float,
    wheel_speed_rad_s: float,
    wheel_acceleration_rad_s2: float = 0.0,
) -> float:
    """Return the torque at the wheel in N m: the electric torque less the losses of motor and gear.

    tau_w = k_red (eta^sgn k_t I - T_c sgn w - b w - J_m dw/dt); finite everywhere. Dry friction is faded in
    up to `slowest_rad_s`: at rest its direction is unknown.

    Args:
        motor: The motor.
        current_a: Signed current, positive where it pushes forward.
        wheel_speed_rad_s: Speed of the wheel.
        wheel_acceleration_rad_s2: Its acceleration.
    """
    speed = wheel_speed_rad_s * motor.gear_ratio
    electric_nm = motor.torque_constant_nm_a * current_a
    # Losses in the gear lower the torque while the motor drives the wheel, and raise it in the opposite case.
    electric_nm *= motor.gear_efficiency if electric_nm * speed >= 0.0 else 1.0 / motor.gear_efficiency
    fade = max(-1.0, min(1.0, wheel_speed_rad_s / EFFORT.motor.slowest_rad_s))
    inertia_nm = motor.inertia_kg_m2 * motor.gear_ratio * wheel_acceleration_rad_s2
    losses_nm = motor.coulomb_torque_nm * fade + motor.viscous_torque_nm_s_rad * speed + inertia_nm
    return motor.gear_ratio * (electric_nm - losses_nm)


class EffortFlag(StrEnum):
    """Why the effort of a wheel cannot be used."""

    NO_CURRENT = "no current"
    SATURATED = "current saturated"
    BRAKING = "braking: the sign of the current is unknown"
    SIGN_CHANGE = "direction changed just now"
    SLOW = "wheel too slow"
    CLOCK = "clock did not go forward"


TORQUE_UNKNOWN = frozenset(
    (
        EffortFlag.NO_CURRENT,
        EffortFlag.SATURATED,
        EffortFlag.BRAKING,
        EffortFlag.SIGN_CHANGE,
        EffortFlag.CLOCK,
    )
)
"""With one of these the torque of a wheel is unknown. The torque of a slow wheel is known."""

SIGN_UNKNOWN = frozenset((EffortFlag.BRAKING, EffortFlag.SIGN_CHANGE))


class WheelEffort(NamedTuple):
    """Effort of one wheel, from filtered current and speed.

    Attributes:
        current_a: Signed current.
        speed_rad_s: Speed of the wheel.
        paper_torque_nm: M of the paper, see `paper_torque`.
        wheel_torque_nm: See `wheel_torque`.
        flags: Empty where all values may be used.
    """

    current_a: float
    speed_rad_s: float
    paper_torque_nm: float
    wheel_torque_nm: float
    flags: tuple[EffortFlag, ...]

    @property
    def unknown_torque(self) -> EffortFlag | None:
        """Why the torque is unknown; None where it is known."""
        if not self.flags:
            return None
        return next((flag for flag in self.flags if flag in TORQUE_UNKNOWN), None)

    @property
    def unknown_work(self) -> EffortFlag | None:
        """Why torque times speed is unknown; None where it is known.

        That of a slow wheel is almost zero for either sign of its current. A wheel at rest trembles, so the
        sign of its current is hardly ever known.
        """
        if not self.flags:
            return None
        unknown = TORQUE_UNKNOWN - SIGN_UNKNOWN if EffortFlag.SLOW in self.flags else TORQUE_UNKNOWN
        return next((flag for flag in self.flags if flag in unknown), None)


class EffortObserver:
    """Finds the sign of an unsigned current, and computes M and torque, for one wheel.

    Current and speed pass the same first-order low-pass before M is formed: a ratio of two signals with
    different delays would show torque where there is none.

    Args:
        motor: The motor.
        current_is_signed: False where the sensor measures a magnitude only. The sign is then that of the
            speed, or of the setpoint while the wheel is at rest; both fail while the wheel is faster than
            its setpoint.
    """

    def __init__(self, motor: MotorSettings, *, current_is_signed: bool) -> None:
        self._motor = motor
        self._is_signed = current_is_signed
        self._current_a: float | None = None
        self._speed_rad_s = 0.0
        self._direction = 0.0
        self._since_change_s = math.inf

    def step(
        self,
        elapsed_s: float,
        current_a: float | None,
        speed_rad_s: float,
        set_speed_rad_s: float | None = None,
    ) -> WheelEffort:
        """Take one reading.

        Args:
            elapsed_s: Time since the reading before; not positive means that the clock is wrong, and the
                reading is flagged and not used.
            current_a: Measured current, or None where it is missing.
            speed_rad_s: Measured speed of the wheel.
            set_speed_rad_s: Its setpoint where known.
        """
        if elapsed_s <= 0.0 or current_a is None:
            flag = EffortFlag.CLOCK if elapsed_s <= 0.0 else EffortFlag.NO_CURRENT
            return self._effort(0.0, (flag,))
        self._find_direction(elapsed_s, speed_rad_s, set_speed_rad_s)
        magnitude_a = min(abs(current_a), self._motor.current_full_scale_a)
        signed_a = math.copysign(magnitude_a, current_a) if self._is_signed else self._direction * magnitude_a
        share = elapsed_s / (EFFORT.motor.filter_time_s + elapsed_s)
        if self._current_a is None:
            self._current_a, self._speed_rad_s = signed_a, speed_rad_s
        before_rad_s = self._speed_rad_s
        self._current_a += share * (signed_a - self._current_a)
        self._speed_rad_s += share * (speed_rad_s - self._speed_rad_s)
        acceleration_rad_s2 = (self._speed_rad_s - before_rad_s) / elapsed_s
        return self._effort(acceleration_rad_s2, self._flags(current_a, set_speed_rad_s))

    def _find_direction(self, elapsed_s: float, speed_rad_s: float, set_speed_rad_s: float | None) -> None:
        self._since_change_s += elapsed_s
        hint = speed_rad_s if abs(speed_rad_s) >= SPEED_STEP_RAD_S else (set_speed_rad_s or speed_rad_s)
        if hint == 0.0:
            return
        direction = math.copysign(1.0, hint)
        if direction != self._direction:
            if self._direction:
                self._since_change_s = 0.0
            self._direction = direction

    def _flags(self, current_a: float, set_speed_rad_s: float | None) -> tuple[EffortFlag, ...]:
        flags: tuple[EffortFlag, ...] = ()
        if abs(current_a) >= self._motor.current_full_scale_a:
            flags += (EffortFlag.SATURATED,)
        if abs(self._speed_rad_s) < EFFORT.motor.slowest_rad_s:
            flags += (EffortFlag.SLOW,)
        if not self._is_signed:
            if set_speed_rad_s is not None and self._is_braking(set_speed_rad_s):
                flags += (EffortFlag.BRAKING,)
            if self._since_change_s < EFFORT.motor.sign_settle_s:
                flags += (EffortFlag.SIGN_CHANGE,)
        return flags

    def _is_braking(self, set_speed_rad_s: float) -> bool:
        # One step of tolerance: the setpoint is cut to whole steps inside the drive.
        along = self._speed_rad_s * math.copysign(1.0, set_speed_rad_s)
        return abs(along) > SPEED_STEP_RAD_S and (
            along < 0.0 or along > abs(set_speed_rad_s) + SPEED_STEP_RAD_S
        )

    def _effort(self, acceleration_rad_s2: float, flags: tuple[EffortFlag, ...]) -> WheelEffort:
        current_a, speed_rad_s = self._current_a or 0.0, self._speed_rad_s
        return WheelEffort(
            current_a,
            speed_rad_s,
            paper_torque(self._motor, current_a, speed_rad_s, self._direction),
            wheel_torque(self._motor, current_a, speed_rad_s, acceleration_rad_s2),
            flags,
        )
