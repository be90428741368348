"""Wheels that obey at once, and a bench that joins them, an emulated drive and its real driver."""

from collections.abc import Callable, Sequence

from drivers.clock import VirtualClock, seconds
from drivers.device_settings import DriveSettings
from drivers.driver import WheelDrive
from drivers.samples import FaultSample, Sample, WheelCommand, WheelSample
from sim_backends.world.loopback import LoopbackLink
from sim_backends.world.plant import Plant, Truth
from sim_backends.world.world import EmulatedDevice, World

START_NS = 1_000_000_000


class ObedientPlant:
    """Wheels that turn at once as commanded, from `position_rad` on."""

    def __init__(self, position_rad: Sequence[float] = (0.0, 0.0, 0.0, 0.0)) -> None:
        self.wheel_count = len(position_rad)
        self.position_rad = list(position_rad)
        self.speed_rad_s = [0.0] * self.wheel_count
        self.battery_v = 24.1
        self._t_ns = START_NS

    def set_wheel_speeds(self, speed_rad_s: Sequence[float]) -> None:
        assert len(speed_rad_s) == self.wheel_count
        self.speed_rad_s = list(speed_rad_s)

    def advance(self, t_ns: int) -> None:
        for wheel, speed in enumerate(self.speed_rad_s):
            self.position_rad[wheel] += speed * seconds(t_ns - self._t_ns)
        self._t_ns = t_ns

    def truth(self) -> Truth:
        return Truth(
            t_ns=self._t_ns,
            x_m=0.0,
            y_m=0.0,
            yaw_rad=0.0,
            roll_rad=0.0,
            pitch_rad=0.0,
            velocity_x_m_s=0.0,
            velocity_y_m_s=0.0,
            yaw_rate_rad_s=0.0,
            wheel_position_rad=tuple(self.position_rad),
            wheel_speed_rad_s=tuple(self.speed_rad_s),
            motor_current_a=tuple(0.5 * speed for speed in self.speed_rad_s),
            slip=(0.0,) * self.wheel_count,
            battery_v=self.battery_v,
            bumper_pressed=False,
        )


class DriveBench:
    """A drive on a simulated bus or line, in lockstep.

    Args:
        settings: Settings of the drive.
        make: Builds its emulator on the plant.
        plant: The wheels.
    """

    def __init__(
        self,
        settings: DriveSettings,
        make: Callable[[Plant], EmulatedDevice[bytes]],
        plant: ObedientPlant | None = None,
    ) -> None:
        self.clock = VirtualClock(START_NS)
        self.plant = plant or ObedientPlant()
        self.device = make(self.plant)
        world = World(self.plant, {"wheels": self.device})
        link = LoopbackLink(world, self.device, self.clock)
        self.drive: WheelDrive = settings.make_driver("wheels", link, self.clock)
        self.drive.connect()

    def run(self, duration_s: float, speeds: Sequence[float] | None = None) -> list[Sample]:
        """Poll, and command unless `speeds` is None, at 50 Hz."""
        samples: list[Sample] = []
        for _ in range(round(duration_s * 50)):
            if speeds is not None:
                now_ns = self.clock.now_ns()
                command = WheelCommand(
                    t_ns=now_ns, expires_ns=now_ns + 150_000_000, speed_rad_s=tuple(speeds)
                )
                self.drive.command(command)
            self.clock.sleep_until(self.clock.now_ns() + 20_000_000)
            samples += self.drive.poll()
        return samples


def of_wheel(samples: Sequence[Sample], wheel: int) -> list[WheelSample]:
    return [sample for sample in samples if isinstance(sample, WheelSample) and sample.wheel == wheel]


def faults(samples: Sequence[Sample]) -> list[FaultSample]:
    return [sample for sample in samples if isinstance(sample, FaultSample)]
