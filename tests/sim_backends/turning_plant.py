"""A rover that turns steadily on a tilted plate: enough truth for compasses and inertial sensors."""

from collections.abc import Sequence

from drivers.clock import seconds
from drivers.driver import Codec, Rejection
from drivers.link import Received
from drivers.samples import Sample
from sim_backends.world.plant import Truth
from sim_backends.world.world import EmulatedDevice, World


class TurningPlant:
    """Turns at `yaw_rate_rad_s` from `yaw_rad`, at constant forward speed, roll and pitch."""

    wheel_count = 0

    def __init__(
        self,
        yaw_rad: float = 0.0,
        yaw_rate_rad_s: float = 0.0,
        roll_rad: float = 0.0,
        pitch_rad: float = 0.0,
        speed_m_s: float = 0.0,
    ) -> None:
        self.yaw_rad = yaw_rad
        self._yaw_rate_rad_s = yaw_rate_rad_s
        self._roll_rad = roll_rad
        self._pitch_rad = pitch_rad
        self._speed_m_s = speed_m_s
        self._t_ns = 0

    def set_wheel_speeds(self, speed_rad_s: Sequence[float]) -> None:
        """Ignore them: it has no wheels."""

    def advance(self, t_ns: int) -> None:
        self._t_ns = t_ns

    def yaw_at(self, t_ns: int) -> float:
        return self.yaw_rad + self._yaw_rate_rad_s * seconds(t_ns)

    def truth(self) -> Truth:
        return Truth(
            t_ns=self._t_ns,
            x_m=0.0,
            y_m=0.0,
            yaw_rad=self.yaw_at(self._t_ns),
            roll_rad=self._roll_rad,
            pitch_rad=self._pitch_rad,
            velocity_x_m_s=self._speed_m_s,
            velocity_y_m_s=0.0,
            yaw_rate_rad_s=self._yaw_rate_rad_s,
            wheel_position_rad=(),
            wheel_speed_rad_s=(),
            motor_current_a=(),
            slip=(),
            battery_v=24.0,
            bumper_pressed=False,
        )


def run(plant: TurningPlant, device: EmulatedDevice[bytes], until_ns: int) -> list[Received[bytes]]:
    """Return everything that the device has sent by `until_ns`."""
    World(plant, {device.name: device}).advance(until_ns)
    return device.to_host.take(until_ns)


def decode(received: Sequence[Received[bytes]], codec: Codec[bytes]) -> list[Sample]:
    """Return the samples in what was received; nothing may be rejected."""
    results = [result for item in received for result in codec.decode(item)]
    assert not any(isinstance(result, Rejection) for result in results)
    return [result for result in results if isinstance(result, Sample)]
