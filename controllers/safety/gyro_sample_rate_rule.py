"""Stop rule about a gyro that sends its readings at another rate than it is configured to."""

from collections import deque
from collections.abc import Iterator
from typing import Annotated

from pydantic import Field

from controllers.fault import Cause, Fault
from controllers.roles import DeviceRoles
from controllers.safety.reasons import Cycle, StopRule
from drivers.clock import nanoseconds
from drivers.safety_event import WHEN_GONE, Outcome, SafetyEvent
from drivers.samples import RateSample, Sample
from drivers.settings import Settings


class GyroSampleRateSettings(Settings):
    """Which rate of the gyro is another one than `rate_hz` of its device.

    Attributes:
        gyro_rate_s: The readings of the gyro are counted over this time.
        gyro_rate_factor: The rover stops when the rate differs from the configured one by this factor, up or
            down. Lost readings lower the rate, too.
    """

    gyro_rate_s: Annotated[float, Field(ge=0.5, le=60.0)] = 2.0
    gyro_rate_factor: Annotated[float, Field(ge=1.1, le=10.0)] = 1.6


SILENCE_SHARE = 0.25
"""Silence for this share of the counting time is not a rate, other rules stop for it; chosen by hand."""


class GyroSampleRateRule(StopRule):
    """Stops while the gyro sends at another rate than configured.

    A sensor that was reset, or another sensor, has another rate and likely another low-pass, which looks like
    slip.
    """

    observes = (RateSample,)

    events = (
        SafetyEvent(
            Outcome.STOPS,
            "The gyro sends at another rate than `rate_hz` of its device: it was reset, it is "
            "another sensor, or messages are lost. Not judged without `rate_hz`.",
            "`…: sends … yaw rates per second, configured are …: …`",
            (
                "tests/rover_hil/test_other_imu.py::"
                "test_another_rate_than_configured_stops_the_rover_and_is_named",
            ),
            within="`gyro_rate_s`; before the first motion where `settle_s` is longer",
            settings=("gyro_rate_s", "gyro_rate_factor", "devices.NAME.rate_hz"),
            clears=WHEN_GONE,
        ),
    )

    def __init__(self, settings: GyroSampleRateSettings, roles: DeviceRoles) -> None:
        self._settings = settings
        self._gyro = str(roles.gyro)
        self._rate_hz = roles.gyro_rate_hz
        self._window_ns = nanoseconds(settings.gyro_rate_s)
        self._silence_ns = nanoseconds(SILENCE_SHARE * settings.gyro_rate_s)
        self._counted_ns: deque[int] = deque()
        self._since_ns = 0  # pragma: no mutate

    def observe(self, sample: Sample, t_ns: int) -> None:
        """Count a reading of the gyro."""
        if not isinstance(sample, RateSample) or sample.device != self._gyro:
            return
        if not self._counted_ns or t_ns - self._counted_ns[-1] > self._silence_ns:
            self._counted_ns.clear()
            self._since_ns = t_ns
        self._counted_ns.append(t_ns)

    def check(self, cycle: Cycle) -> Iterator[Fault]:
        """Return a reason while the rate of the counting time is another one than configured."""
        counted_ns = self._counted_ns
        if not counted_ns or cycle.now_ns - counted_ns[-1] > self._silence_ns:
            return
        while cycle.now_ns - counted_ns[0] > self._window_ns:
            counted_ns.popleft()
        rate_hz, factor = len(counted_ns) / self._settings.gyro_rate_s, self._settings.gyro_rate_factor
        is_counted = cycle.now_ns - self._since_ns >= self._window_ns
        if self._rate_hz is not None and is_counted and not 1.0 / factor <= rate_hz / self._rate_hz <= factor:
            text = (
                f"{self._gyro}: sends {rate_hz:.0f} yaw rates per second, configured are {self._rate_hz:g}: "
                "set the sensor or its rate_hz, and look for lost messages"
            )
            yield Fault(self._gyro, Cause.GYRO_SAMPLE_RATE, text)
