"""Interface between a simulated rover and its device emulators: the true state, without sensor errors."""

from collections.abc import Sequence
from typing import Protocol, runtime_checkable

from drivers.clock import seconds
from drivers.record import record


@record(frozen=True, slots=True, kw_only=True)
class Truth:
    """The true state of the rover at one instant.

    World frame: x, y on the ground, z up; `yaw_rad` counter-clockwise from x, not wrapped. Velocities and
    rates are in the body frame, x forward, y left. Wheel tuples have one entry per wheel.

    Attributes:
        motor_current_a: Signed; positive drives forward.
        slip: Longitudinal slip ratio of each wheel, 1 - v / (r omega) when driving.
        steering_rad: Steering angle of each wheel, counter-clockwise; None for a rover that does not steer.
    """

    t_ns: int
    x_m: float
    y_m: float
    yaw_rad: float
    roll_rad: float
    pitch_rad: float
    velocity_x_m_s: float
    velocity_y_m_s: float
    yaw_rate_rad_s: float
    wheel_position_rad: tuple[float, ...]
    wheel_speed_rad_s: tuple[float, ...]
    motor_current_a: tuple[float, ...]
    slip: tuple[float, ...]
    battery_v: float
    bumper_pressed: bool
    steering_rad: tuple[float, ...] | None = None


def fallen_v(battery_v: float, fall_v_s: float, since_start_ns: int) -> float:
    """Return the voltage that the devices report of a battery whose voltage falls since the start."""
    return max(0.0, battery_v - fall_v_s * seconds(since_start_ns))


class Plant(Protocol):
    """A simulated rover that follows wheel speed setpoints. Deterministic for a given seed."""

    wheel_count: int

    def set_wheel_speeds(self, speed_rad_s: Sequence[float]) -> None:
        """Set the setpoints of the wheels' inner speed loops, at the plant's present time."""
        ...

    def advance(self, t_ns: int) -> None:
        """Integrate to `t_ns`; does nothing for a time already reached."""
        ...

    def truth(self) -> Truth:
        """Return the state at the time reached."""
        ...


@runtime_checkable
class CompiledPlant(Plant, Protocol):
    """A simulated rover whose equations are compiled or loaded, which takes up to seconds."""

    def compile(self) -> None:
        """Do it now; the first step does it otherwise."""
        ...


@runtime_checkable
class SteeredPlant(Plant, Protocol):
    """A simulated rover that also follows steering setpoints."""

    def set_steering(self, angle_rad: Sequence[float]) -> None:
        """Set the steering angles, counter-clockwise, one per wheel; ignored where a wheel is fixed."""
        ...
