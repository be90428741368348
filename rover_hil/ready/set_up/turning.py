"""Turn one wheel of a drive a little, and report which encoder moved."""

import math
from collections.abc import Callable
from contextlib import ExitStack, closing

from drivers.clock import Clock, nanoseconds
from drivers.device_settings import DriveSettings
from drivers.samples import WheelCommand, WheelSample
from rover_hil.run.end_signals import END_REQUEST
from rover_hil.run.watchdog_process import WatchdogError, WatchdogProcess

PERIOD_S = 0.02
EXPIRY_S = 0.2
REST_S = 0.5
TURN_S = 1.0
STEER_S = 3.0


class Turner:
    """A connected drive whose wheels are turned one by one; a context manager that stops it.

    Args:
        settings: The drive.
        clock: The host's clock.
        speed_rad_s: Speed of a turning wheel.

    Raises:
        NotConnectedError: The drive cannot be opened.
        ConfigError: A data file that it needs is missing or wrong.
        WatchdogError: The watchdog cannot be started, or cannot open the port of the drive.
    """

    def __init__(self, settings: DriveSettings, clock: Clock, speed_rad_s: float) -> None:
        self._clock = clock
        self._speed_rad_s = speed_rad_s
        self._drive = settings.make_driver("wheels", settings.make_link(clock), clock)
        with ExitStack() as resources:
            stop = settings.make_emergency_stop()
            self._watchdog = resources.enter_context(WatchdogProcess(stop, EXPIRY_S))
            self._drive.connect(2.0)
            resources.enter_context(closing(self._drive))
            self._watchdog.check_port()
            self._resources = resources.pop_all()
        self.wheel_count = self._drive.wheel_count
        self._positions: dict[int, float] = {}
        self._steering_rad: tuple[float, ...] | None = None

    def __enter__(self) -> "Turner":
        return self

    def __exit__(self, *error: object) -> None:
        self._resources.close()

    def turn(self, wheel: int, step: Callable[[str], None]) -> list[float]:
        """Turn a wheel forwards for a second; return how far each wheel turned, in rad."""
        self._command(None, REST_S)
        before = dict(self._positions)
        step(f"turning wheel {wheel} at {self._speed_rad_s:g} rad/s")
        self._command(wheel, TURN_S)
        self._command(None, REST_S)
        after = self._positions
        return [after.get(each, 0.0) - before.get(each, 0.0) for each in range(self.wheel_count)]

    def steer(self, wheel: int, angle_rad: float, step: Callable[[str], None]) -> None:
        """Steer a wheel, the others to zero, and leave it there."""
        step(f"steering wheel {wheel} to {math.degrees(angle_rad):+.0f} deg")
        self._steering_rad = tuple(angle_rad if each == wheel else 0.0 for each in range(self.wheel_count))
        self._command(None, STEER_S)

    def _command(self, turning: int | None, duration_s: float) -> None:
        now_ns = self._clock.now_ns()
        end_ns = now_ns + nanoseconds(duration_s)
        self._watchdog.arm()
        while now_ns < end_ns:
            END_REQUEST.obey()
            if reason := self._watchdog.stop_reason(now_ns):
                raise WatchdogError(f"{reason}: the wheels are not turned any more; begin again")
            if self._watchdog.has_stopped_drive():
                self._drive.stop()  # it is off, and is started anew
            speeds = tuple(
                self._speed_rad_s if wheel == turning else 0.0 for wheel in range(self.wheel_count)
            )
            self._drive.command(
                WheelCommand(
                    t_ns=now_ns,
                    expires_ns=now_ns + nanoseconds(EXPIRY_S),
                    speed_rad_s=speeds,
                    steering_rad=self._steering_rad,
                )
            )
            self._watchdog.feed()
            self._clock.sleep_until(now_ns + nanoseconds(PERIOD_S))
            for sample in self._drive.poll():
                if isinstance(sample, WheelSample) and sample.position_rad is not None:
                    self._positions[sample.wheel] = sample.position_rad
            now_ns = self._clock.now_ns()
        self._watchdog.rest()
