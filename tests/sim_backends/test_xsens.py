"""The simulated Xsens sensor: bytes of the manual, the truth in them, its line."""

import math

import numpy as np
import pytest

from drivers.clock import VirtualClock, nanoseconds
from drivers.driver import DeviceState
from drivers.errors import ConfigError
from drivers.samples import AccelerationSample, AttitudeSample, HeadingSample, RateSample
from drivers.units import STANDARD_GRAVITY_M_S2
from drivers.xsens.settings import XsensSettings
from sim_backends.devices.xsens import XsensEmulatorSettings, make_emulator
from sim_backends.world.loopback import LoopbackLink
from sim_backends.world.world import World
from tests.sim_backends.turning_plant import TurningPlant, decode, run

DEVICE = XsensSettings(port="simulated")
PERFECT = XsensEmulatorSettings(
    gyro_bias_deg_s=0,
    gyro_walk_deg_s=0,
    gyro_noise_deg_s=0,
    acceleration_noise_m_s2=0,
    angle_lag_s=0,
    angle_noise_deg=0,
    yaw_bias_deg=0,
)


def sent(settings: XsensEmulatorSettings, plant: TurningPlant, until_s: float, seed: int = 1) -> bytes:
    device = make_emulator("imu", DEVICE, settings, plant, np.random.default_rng(seed), start_ns=0)
    return b"".join(item.payload for item in run(plant, device, nanoseconds(until_s)))


def test_bytes_are_those_of_the_manual() -> None:
    """Second message, at 20 ms: counter 1, 200 ticks of 10 kHz, a rate of 0.1 rad/s, a recorded status."""
    settings = PERFECT.model_copy(update={"content": ("rate",)})
    message = sent(settings, TurningPlant(yaw_rate_rad_s=0.1), 0.025)[39:]
    assert message == bytes.fromhex(
        "fa ff 36 22 10 20 02 00 01 10 60 04 00 00 00 c8 80 20 0c 00 00 00 00 00 00 00 00 3d cc cc cd"
        "e0 20 04 00 40 00 03 a5"
    )


@pytest.mark.parametrize("mounting_yaw_deg", [0.0, -90.0, 37.0])
@pytest.mark.parametrize("yaw_zero_deg", [0.0, 90.0])
def test_perfect_sensor_tells_the_truth_however_mounted(mounting_yaw_deg: float, yaw_zero_deg: float) -> None:
    settings = XsensSettings(port="simulated", mounting_yaw_deg=mounting_yaw_deg, yaw_zero_deg=yaw_zero_deg)
    plant = TurningPlant(yaw_rad=3.0, yaw_rate_rad_s=0.5, roll_rad=0.2, pitch_rad=-0.1, speed_m_s=0.8)
    device = make_emulator("imu", settings, PERFECT, plant, np.random.default_rng(1), start_ns=0)
    received = run(plant, device, nanoseconds(0.018))
    attitude, heading, acceleration, rate = decode(received, settings.make_codec("imu"))
    assert isinstance(attitude, AttitudeSample)
    assert isinstance(heading, HeadingSample)
    assert isinstance(acceleration, AccelerationSample)
    assert isinstance(rate, RateSample)
    g = STANDARD_GRAVITY_M_S2
    assert (acceleration.x_m_s2, acceleration.y_m_s2, acceleration.z_m_s2) == pytest.approx(
        (
            g * math.sin(0.1),
            g * math.cos(0.1) * math.sin(0.2) + 0.5 * 0.8,
            g * math.cos(0.1) * math.cos(0.2),
        ),
        abs=0.004,
    )
    assert rate.rate_z_rad_s == pytest.approx(0.5)
    assert attitude.roll_rad == pytest.approx(0.2, abs=1e-6)
    assert attitude.pitch_rad == pytest.approx(-0.1, abs=1e-6)
    assert heading.heading_rad == pytest.approx(3.0 + 0.5 * 0.01, abs=1e-6)
    assert heading.t_device_ns == nanoseconds(0.01)
    assert heading.t_ns == nanoseconds(0.01) + nanoseconds(73 * 10 / 115_200)


def test_same_seed_same_bytes() -> None:
    runs = [sent(XsensEmulatorSettings(), TurningPlant(), 1.0, seed) for seed in (5, 5, 6)]
    assert runs[0] == runs[1] != runs[2]


def test_line_that_is_too_slow_is_refused() -> None:
    slow = XsensSettings(port="simulated", baud_rate=57_600)
    with pytest.raises(ConfigError, match="needs 73000 bit/s"):
        make_emulator(
            "imu", slow, XsensEmulatorSettings(), TurningPlant(), np.random.default_rng(1), start_ns=0
        )


def test_driver_streams_from_it_in_lockstep() -> None:
    clock, plant = VirtualClock(), TurningPlant()
    settings = XsensEmulatorSettings()
    device = make_emulator("imu", DEVICE, settings, plant, np.random.default_rng(1), clock.now_ns())
    world = World(plant, {"imu": device})
    with DEVICE.make_driver("imu", LoopbackLink(world, device, clock), clock) as driver:
        for _ in range(150):
            clock.sleep_until(clock.now_ns() + 20_000_000)
            driver.poll()
        health = driver.health()
        assert health.state is DeviceState.STREAMING
        assert health.rate_hz == pytest.approx(100.0, abs=1.0)
        assert not health.rejected
