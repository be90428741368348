"""The simulated compass: statistics of its errors, its lag, its line."""

import cmath
import datetime as dt
import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from drivers.angles import compass_deg_from_yaw
from drivers.clock import NANOSECONDS_PER_SECOND, VirtualClock, nanoseconds
from drivers.driver import DeviceState
from drivers.errors import ConfigError
from drivers.heading_calibration import DeviationTable
from drivers.link import Received
from drivers.nmea_compass.codec import NmeaCompassCodec
from drivers.nmea_compass.settings import NmeaCompassSettings
from drivers.samples import HeadingReference, HeadingSample
from sim_backends.devices.nmea_compass import CompassEmulatorSettings, make_emulator
from sim_backends.world.loopback import LoopbackLink
from sim_backends.world.plant import Truth
from sim_backends.world.sensor_errors import DirectionLag
from sim_backends.world.world import World
from tests.sim_backends.turning_plant import TurningPlant, decode, run

DEVICE = NmeaCompassSettings(port="simulated")
PERFECT = CompassEmulatorSettings(lag_s=0, bias_deg=0, deviation_error_deg=(0, 0, 0, 0), noise_deg=0)
PERIOD_NS = NANOSECONDS_PER_SECOND // 10


def sentences(
    settings: CompassEmulatorSettings, plant: TurningPlant, duration_s: float, seed: int = 1
) -> list[Received[bytes]]:
    rng = np.random.default_rng(seed)
    device = make_emulator("compass", DEVICE, settings, plant, rng, start_ns=0)
    return run(plant, device, nanoseconds(duration_s))


def readings_deg(received: list[Received[bytes]]) -> NDArray[np.float64]:
    return np.array([float(item.payload.split(b",")[1]) for item in received])


def wrapped_deg(angle_deg: NDArray[np.float64]) -> NDArray[np.float64]:
    wrapped: NDArray[np.float64] = (angle_deg + 180.0) % 360.0 - 180.0
    return wrapped


def test_perfect_compass_on_the_wire() -> None:
    (first, second) = sentences(PERFECT, TurningPlant(yaw_rad=math.radians(-8.3)), 0.25)
    assert first.payload == second.payload == b"$HCHDG,98.3,,,,*70\r\n"
    wire_ns = nanoseconds(10 * len(first.payload) / 4800)
    assert [first.t_ns, second.t_ns] == [PERIOD_NS + wire_ns, 2 * PERIOD_NS + wire_ns]
    (sample,) = decode([first], NmeaCompassCodec("compass"))
    assert isinstance(sample, HeadingSample)
    assert sample.heading_rad == pytest.approx(math.radians(-8.3))
    assert sample.reference is HeadingReference.MAGNETIC


def test_hdm_on_request() -> None:
    settings = PERFECT.model_copy(update={"sentence": "HDM"})
    (item,) = sentences(settings, TurningPlant(yaw_rad=math.radians(-148.4)), 0.19)
    assert item.payload == b"$HCHDM,238.4,M*24\r\n"


def test_bias_and_noise_have_the_set_size() -> None:
    settings = PERFECT.model_copy(update={"bias_deg": 2.0, "noise_deg": 0.5})
    readings = readings_deg(sentences(settings, TurningPlant(), 400.0))
    count = len(readings)
    error_deg = readings - 90.0
    assert count > 3900
    assert error_deg.mean() == pytest.approx(2.0, abs=4 * 0.5 / math.sqrt(count))
    assert error_deg.std() == pytest.approx(0.5, abs=4 * 0.5 / math.sqrt(2 * count))
    neighbours = np.corrcoef(error_deg[1:], error_deg[:-1])[0, 1]
    assert abs(neighbours) < 4 / math.sqrt(count)


@pytest.mark.parametrize("rate_deg_s", [20.0, -45.0])
def test_turning_compass_lags_by_its_time_constant(rate_deg_s: float) -> None:
    settings = PERFECT.model_copy(update={"lag_s": 0.45})
    plant = TurningPlant(yaw_rate_rad_s=math.radians(rate_deg_s))
    received = sentences(settings, plant, 60.0)
    readings = readings_deg(received)
    true_deg = np.array(
        [compass_deg_from_yaw(plant.yaw_at(number * PERIOD_NS)) for number in range(1, len(readings) + 1)]
    )
    settled = slice(50, None)  # eleven time constants
    lag_deg = wrapped_deg(true_deg - readings)[settled].mean()
    expected_deg = math.degrees(math.atan(math.radians(rate_deg_s) * 0.45))
    assert lag_deg == pytest.approx(-expected_deg, abs=0.1)  # compass headings fall as yaw grows


def test_step_response_is_first_order_and_takes_the_short_way() -> None:
    lag = DirectionLag(0.45, 0.1)
    lag.settle(math.radians(175.0))
    outputs = [math.degrees(lag.step(math.radians(-175.0))) % 360.0 for _ in range(60)]
    assert all(175.0 <= output <= 185.0 for output in outputs)
    assert outputs == sorted(outputs)
    # The first step is held as a ramp over one period, so it is 0.05 s late; then 1 - exp(-t/tau).
    for number in (5, 10, 20):
        expected = 10.0 * (1.0 - math.exp(-(0.1 * number - 0.05) / 0.45))
        assert outputs[number - 1] - 175.0 == pytest.approx(expected, abs=0.05)


def test_no_lag_passes_directions_through() -> None:
    lag = DirectionLag(0.0, 0.1)
    lag.settle(0.0)
    assert lag.step(1.5) == pytest.approx(1.5)


def test_deviation_error_is_two_harmonic_and_a_table_removes_it() -> None:
    factors = (3.0, -2.0, 1.5, 0.5)
    settings = PERFECT.model_copy(update={"deviation_error_deg": factors, "bias_deg": -1.0})
    plant = TurningPlant(yaw_rate_rad_s=math.radians(-1.0))
    received = sentences(settings, plant, 360.0)
    readings = readings_deg(received)
    true_deg = np.array(
        [compass_deg_from_yaw(plant.yaw_at(number * PERIOD_NS)) for number in range(1, len(readings) + 1)]
    )
    true_rad = np.radians(true_deg)
    waves = np.stack([np.sin(true_rad), np.cos(true_rad), np.sin(2 * true_rad), np.cos(2 * true_rad)])
    error_deg = wrapped_deg(readings - true_deg)
    assert np.abs(error_deg - (np.array(factors) @ waves - 1.0)).max() < 0.051

    swing = slice(None, None, 100)  # every ten degrees, as in a compass swing
    order = np.argsort(readings[swing])
    table = DeviationTable(
        source="simulated swing",
        date=dt.date(2026, 5, 4),
        heading_deg=tuple(readings[swing][order].tolist()),
        deviation_deg=tuple((-error_deg[swing][order]).tolist()),
    )
    samples = decode(received, NmeaCompassCodec("compass", deviation_table=table))
    headings_deg = np.array(
        [compass_deg_from_yaw(sample.heading_rad) for sample in samples if isinstance(sample, HeadingSample)]
    )
    assert np.abs(error_deg).max() > 4.0
    assert np.abs(wrapped_deg(headings_deg - true_deg)).max() < 0.2


def test_readings_stay_below_360() -> None:
    settings = PERFECT.model_copy(update={"noise_deg": 0.2})
    readings = readings_deg(sentences(settings, TurningPlant(yaw_rad=math.pi / 2), 100.0))
    assert ((readings >= 0.0) & (readings < 360.0)).all()
    assert (readings > 359.0).any()
    assert (readings < 1.0).any()


def test_same_seed_same_bytes() -> None:
    plants = [TurningPlant(yaw_rate_rad_s=0.3) for _ in range(3)]
    runs = [
        [item.payload for item in sentences(CompassEmulatorSettings(), plant, 20.0, seed)]
        for plant, seed in zip(plants, (5, 5, 6), strict=True)
    ]
    assert runs[0] == runs[1]
    assert runs[0] != runs[2]


def test_line_that_is_too_slow_is_refused() -> None:
    settings = PERFECT.model_copy(update={"rate_hz": 40.0})
    with pytest.raises(ConfigError, match="baud_rate"):
        make_emulator("compass", DEVICE, settings, TurningPlant(), np.random.default_rng(1), start_ns=0)


def test_driver_streams_from_it_in_lockstep() -> None:
    clock, plant = VirtualClock(), TurningPlant()
    rng = np.random.default_rng(1)
    device = make_emulator("compass", DEVICE, CompassEmulatorSettings(), plant, rng, clock.now_ns())
    world = World(plant, {"compass": device})
    with DEVICE.make_driver("compass", LoopbackLink(world, device, clock), clock) as driver:
        for _ in range(200):
            clock.sleep_until(clock.now_ns() + 20_000_000)
            driver.poll()
            driver_age_s = driver.health().age_s
            assert driver_age_s is None or driver_age_s < DEVICE.max_age_s
        health = driver.health()
        assert health.state is DeviceState.STREAMING
        assert health.rate_hz == pytest.approx(10.0, abs=0.5)
        assert not health.rejected


class _Driven(TurningPlant):
    """Two motors with a constant current."""

    wheel_count = 2

    def truth(self) -> Truth:
        return replace(super().truth(), motor_current_a=(2.0, -1.0))


@pytest.mark.parametrize("yaw_deg", [-120.0, 20.0, 75.0])
def test_motor_currents_add_their_field_to_that_of_the_earth(yaw_deg: float) -> None:
    settings = PERFECT.model_copy(update={"motor_field_per_a": ((0.1, 0.05), (0.0, 0.2))})
    (first, *_) = sentences(settings, _Driven(yaw_rad=math.radians(yaw_deg)), 0.25)
    # 0.2 ahead and 0.1 - 0.2 to the left, in the axes of the rover, beside the earth's field to the north.
    total = 1j + complex(0.2, -0.1) * cmath.rect(1.0, math.radians(yaw_deg))
    shown_yaw_deg = yaw_deg - (math.degrees(cmath.phase(total)) - 90.0)
    expected = compass_deg_from_yaw(math.radians(shown_yaw_deg))
    assert readings_deg([first])[0] == pytest.approx(expected, abs=0.051)
    with pytest.raises(ConfigError, match="motor_field_per_a of 2 motors, the rover has 0"):
        sentences(settings, TurningPlant(), 0.25)
