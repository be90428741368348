"""Compare the bandwidth that a WitMotion sensor states with the yaw excitation.

The sensor answers a request to read its register 0x1F with a frame of type 0x5F, which holds that register
and the next three. Source: WIT standard communication protocol, registers; the bandwidths are those of the
filter of the MPU-6000 (RM-MPU-6000A-00, register 26).
"""

import math
import struct

from controllers.slip.effort.settings import YAW_PROBE
from drivers.witmotion.codec import FRAME_SIZE, HEADER, REGISTERS
from drivers.witmotion.settings import WitMotionSettings
from rover_hil.config import Config
from rover_hil.doctor.devices.listening import Reception
from rover_hil.doctor.finding import Finding, ok, warning

CHECK = "bandwidth"
BANDWIDTHS_HZ = (256.0, 188.0, 98.0, 42.0, 20.0, 10.0, 5.0)
"""By the value of the register."""
FASTEST = 8.0
"""Bandwidth over frequency from which on the low-pass is not noticed; chosen by hand: 10 ms at 2 Hz."""
SAME = 1.6
"""Factor within which stated and identified bandwidth agree; chosen by hand."""


def stated_bandwidth_hz(received: bytes) -> float | None:
    """Return the bandwidth in what a sensor sent; None where it did not state one."""
    for start in range(len(received) - FRAME_SIZE + 1):
        frame = received[start : start + FRAME_SIZE]
        if frame[:2] == bytes((HEADER, REGISTERS)) and sum(frame[:-1]) & 0xFF == frame[-1]:
            (value,) = struct.unpack_from("<H", frame, 2)
            if value < len(BANDWIDTHS_HZ):
                return BANDWIDTHS_HZ[value]
    return None


def check_gyro_bandwidth(reception: Reception, config: Config) -> list[Finding]:
    """Check the stated bandwidth of the gyro if slip is read from the yaw excitation; else nothing."""
    slip, name = config.slip, reception.device
    if slip is None or slip.use != YAW_PROBE or name != config.roles.gyro:
        return []
    if not isinstance(reception.settings, WitMotionSettings):
        return []
    stated_hz = stated_bandwidth_hz(b"".join(item.payload for item in reception.arrivals))
    if stated_hz is None:
        return [ok(CHECK, name, "not stated by the sensor; `rover-hil calibrate imu` identifies it")]
    frequency_hz, response = slip.excitation.frequency_hz, slip.gyro_response
    what = f"the sensor states {stated_hz:g} Hz, the yaw excitation has {frequency_hz:g} Hz"
    if response is None and stated_hz < FASTEST * frequency_hz:
        lag_ms = 1e3 * math.atan2(frequency_hz, stated_hz) / (math.tau * frequency_hz)
        cause = f"its low-pass delays the excitation by {lag_ms:.0f} ms, which looks like slip"
        fix = f"set the sensor to at least {FASTEST * frequency_hz:g} Hz, or run `rover-hil calibrate imu`"
        return [warning(CHECK, name, what, cause, fix)]
    if (
        response is not None
        and stated_hz < 100.0
        and not 1.0 / SAME < response.bandwidth_hz / stated_hz < SAME
    ):
        what = f"the sensor states {stated_hz:g} Hz, slip.gyro_response has {response.bandwidth_hz:.3g} Hz"
        cause = "the sensor's setting was changed after the calibration, or another sensor is used"
        return [warning(CHECK, name, what, cause, "run `rover-hil calibrate imu` again")]
    return [ok(CHECK, name, what)]
