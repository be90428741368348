"""What one motor of a drive did: setpoints, positions, speeds, currents, voltages over time."""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from drivers.errors import LogError
from drivers.robotino_board.scales import scales
from drivers.robotino_board.settings import RobotinoBoardSettings
from rover_hil.drives.arrays import Array
from rover_hil.identify.motor.parameters import MOTOR_FIT
from rover_hil.report.tracks import Series


@dataclass(frozen=True, slots=True, kw_only=True)
class Scale:
    """How a device counts, in SI units at the motor; 0 where it has no steps.

    Attributes:
        position_rad: One encoder tick.
        speed_rad_s: One step of the speed field.
        current_a: One step of the current.
        current_is_cut: The steps are cut off towards zero, not rounded.
        current_limit_a: The largest current the device can report; infinity where unknown.
    """

    position_rad: float = 0.0
    speed_rad_s: float = 0.0
    current_a: float = 0.0
    current_is_cut: bool = False
    current_limit_a: float = np.inf

    @classmethod
    def of_board(cls, board: RobotinoBoardSettings) -> Self:
        """Return how a Robotino board counts."""
        board_scales = scales(board)
        return cls(
            position_rad=board_scales.position_rad * board.gear_ratio,
            speed_rad_s=board_scales.speed_rad_s * board.gear_ratio,
            current_a=board_scales.current_step_a,
            current_is_cut=board.board == "EA05",
            current_limit_a=board_scales.current_limit_a,
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MotorSignals:
    """Signals of one motor; angles and speeds at the motor where the gear is known, else at the wheel.

    Attributes:
        log: Name of the log.
        motor: Its number, from 1.
        is_robotino: The data-sheet values of the Robotino's motor apply.
        set_point: Speed setpoints as the drive obeys them, rad/s, each held until the next.
        position: Angle turned, rad.
        speed: Speed as the device reports it, rad/s.
        current: Motor current, A.
        current_is_signed: False for magnitudes.
        voltage: Voltage at the terminals, V.
        scale: How the device counts.
    """

    log: str
    motor: int
    is_robotino: bool
    set_point: Series
    position: Series | None
    speed: Series | None
    current: Series
    current_is_signed: bool
    voltage: Series | None
    scale: Scale


@dataclass(frozen=True, slots=True, eq=False)
class Moves:
    """The changes of a setpoint and the moves they belong to.

    Attributes:
        t_s: Time of each change; the first is the beginning of the log.
        value: Setpoint from then on.
        move: Index of the move that each change belongs to.
        start_s: When each move begins.
    """

    t_s: Array
    value: Array
    move: NDArray[np.intp]
    start_s: Array


def find_moves(set_point: Series) -> Moves:
    """Reduce a setpoint to its changes.

    Changes closer than the hold time belong to one move. A setpoint that mostly changes faster, as a
    controller's does, is one move: ramps determine no delay each.
    """
    changes = np.r_[0, np.flatnonzero(np.diff(set_point.value)) + 1]
    t_s = set_point.t_s[changes]
    gaps_s = np.diff(t_s)
    is_staircase = gaps_s.size == 0 or np.median(gaps_s) > MOTOR_FIT.record.hold_s
    begins = np.r_[True, (gaps_s > MOTOR_FIT.record.hold_s) & is_staircase]
    return Moves(t_s, set_point.value[changes], np.cumsum(begins) - 1, t_s[begins])


def cut_set_point(speed_rad_s: Array, step_rad_s: float) -> Array:
    """Return setpoints as a board obeys them: whole steps, towards zero."""
    return np.asarray(np.trunc(speed_rad_s / step_rad_s + np.sign(speed_rad_s) * 1e-6) * step_rad_s)


def check_times(t_s: Array, where: str) -> None:
    """Check that times rise.

    Raises:
        LogError: They do not.
    """
    wrong = np.flatnonzero(np.diff(t_s) <= 0)
    if wrong.size:
        raise LogError(
            f"{where}: the clock goes backwards or does not advance after {t_s[wrong[0]]:.3f} s: repeat it"
        )
