"""A plant at rest that computes nothing: on it a check can build emulators without compiled equations."""

from collections.abc import Sequence

from sim_backends.world.plant import Plant, SteeredPlant, Truth


class StillPlant:
    """A rover with so many wheels that stands at the origin, whatever its setpoints."""

    def __init__(self, wheel_count: int) -> None:
        self.wheel_count = wheel_count
        zeros = (0.0,) * wheel_count
        self._truth = Truth(
            t_ns=0,
            x_m=0.0,
            y_m=0.0,
            yaw_rad=0.0,
            roll_rad=0.0,
            pitch_rad=0.0,
            velocity_x_m_s=0.0,
            velocity_y_m_s=0.0,
            yaw_rate_rad_s=0.0,
            wheel_position_rad=zeros,
            wheel_speed_rad_s=zeros,
            motor_current_a=zeros,
            slip=zeros,
            battery_v=0.0,
            bumper_pressed=False,
        )

    def set_wheel_speeds(self, speed_rad_s: Sequence[float]) -> None:
        """Ignore the setpoints."""

    def advance(self, t_ns: int) -> None:
        """Stay."""

    def truth(self) -> Truth:
        """Return the state at rest."""
        return self._truth


class StillSteeredPlant(StillPlant):
    """The same of a rover that steers."""

    def set_steering(self, angle_rad: Sequence[float]) -> None:
        """Ignore the angles."""


def still_plant_like(plant: Plant) -> Plant:
    """Return a still plant with the wheels of this one."""
    kind = StillSteeredPlant if isinstance(plant, SteeredPlant) else StillPlant
    return kind(plant.wheel_count)
