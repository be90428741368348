"""The simulated VectorNav sensor: bytes as the manual formats them, the truth in them, its line."""

import math
import re

import numpy as np
import pytest

from drivers.clock import VirtualClock, nanoseconds
from drivers.driver import DeviceState
from drivers.errors import ConfigError
from drivers.samples import AccelerationSample, AttitudeSample, HeadingSample, RateSample
from drivers.units import STANDARD_GRAVITY_M_S2
from drivers.vectornav.settings import VectorNavSettings
from sim_backends.devices.vectornav import VectorNavEmulatorSettings, make_emulator
from sim_backends.world.loopback import LoopbackLink
from sim_backends.world.world import World
from tests.sim_backends.turning_plant import TurningPlant, decode, run

DEVICE = VectorNavSettings(port="simulated")
PERFECT = VectorNavEmulatorSettings(
    gyro_bias_deg_s=0,
    gyro_walk_deg_s=0,
    gyro_noise_deg_s=0,
    acceleration_noise_m_s2=0,
    angle_lag_s=0,
    angle_noise_deg=0,
    yaw_bias_deg=0,
)
PUBLISHED = (
    b"$VNYMR,+100.949,-007.330,+000.715,-00.0049,-00.2449,+00.5397,-01.258,-00.100,-09.701,"
    b"-00.000018,+00.001122,-00.000551*69\r\n"
)


def sent(settings: VectorNavEmulatorSettings, plant: TurningPlant, until_s: float, seed: int = 1) -> bytes:
    rng = np.random.default_rng(seed)
    device = make_emulator("imu", DEVICE, settings, plant, rng, start_ns=0)
    return b"".join(item.payload for item in run(plant, device, nanoseconds(until_s)))


def test_bytes_have_the_form_of_a_published_message() -> None:
    message = sent(PERFECT, TurningPlant(yaw_rad=1.0, yaw_rate_rad_s=-0.3), 0.05)
    assert re.sub(rb"[+-]", b"s", re.sub(rb"[0-9A-F]", b"0", message[7:])) == re.sub(
        rb"[+-]", b"s", re.sub(rb"[0-9A-F]", b"0", PUBLISHED[7:])
    )
    assert message.startswith(b"$VNYMR,")


@pytest.mark.parametrize("mounting_yaw_deg", [0.0, -90.0, 37.0])
def test_perfect_sensor_tells_the_truth_however_mounted(mounting_yaw_deg: float) -> None:
    device_settings = VectorNavSettings(port="simulated", mounting_yaw_deg=mounting_yaw_deg)
    plant = TurningPlant(yaw_rad=3.0, yaw_rate_rad_s=0.5, roll_rad=0.2, pitch_rad=-0.1, speed_m_s=0.8)
    device = make_emulator("imu", device_settings, PERFECT, plant, np.random.default_rng(1), start_ns=0)
    received = run(plant, device, nanoseconds(0.04))
    attitude, heading, acceleration, rate = decode(received, device_settings.make_codec("imu"))
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
        abs=0.002,
    )
    assert rate.rate_z_rad_s == pytest.approx(0.5, abs=1e-6)
    assert attitude.roll_rad == pytest.approx(0.2, abs=2e-5)
    assert attitude.pitch_rad == pytest.approx(-0.1, abs=2e-5)
    assert heading.heading_rad == pytest.approx(3.0 + 0.5 * 0.025, abs=2e-5)
    assert heading.t_ns == nanoseconds(0.025) + nanoseconds(len(PUBLISHED) * 10 / 115_200)


def test_gyro_only() -> None:
    settings = PERFECT.model_copy(update={"message": "VNGYR"})
    assert sent(settings, TurningPlant(yaw_rate_rad_s=0.25), 0.04) == (
        b"$VNGYR,+00.000000,-00.000000,-00.250000*7A\r\n"
    )


def test_same_seed_same_bytes() -> None:
    runs = [sent(VectorNavEmulatorSettings(), TurningPlant(), 2.0, seed) for seed in (5, 5, 6)]
    assert runs[0] == runs[1] != runs[2]


def test_line_that_is_too_slow_is_refused() -> None:
    slow = VectorNavSettings(port="simulated", baud_rate=9600)
    with pytest.raises(ConfigError, match="needs 48800 bit/s"):
        make_emulator(
            "imu", slow, VectorNavEmulatorSettings(), TurningPlant(), np.random.default_rng(1), start_ns=0
        )


def test_driver_streams_from_it_in_lockstep() -> None:
    clock, plant = VirtualClock(), TurningPlant()
    settings = VectorNavEmulatorSettings()
    device = make_emulator("imu", DEVICE, settings, plant, np.random.default_rng(1), clock.now_ns())
    world = World(plant, {"imu": device})
    with DEVICE.make_driver("imu", LoopbackLink(world, device, clock), clock) as driver:
        for _ in range(150):
            clock.sleep_until(clock.now_ns() + 20_000_000)
            driver.poll()
        health = driver.health()
        assert health.state is DeviceState.STREAMING
        assert health.rate_hz == pytest.approx(40.0, abs=1.0)
        assert not health.rejected
