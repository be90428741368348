"""Logs of a rover whose motors disturb its compass, of which the truth is known.

The earth's field points to 90 deg in the world. The fields of the motors turn with the rover; the compass
shows the yaw at which the sum would point north.
"""

import cmath
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from drivers.link import Received
from drivers.samples import HeadingReference, HeadingSample, RateSample, WheelSample
from rover_hil.config import Config
from rover_hil.recording.data_files import collect_data_files
from rover_hil.recording.writer import LogWriter
from tests.rover_hil.identify.compass_logs import CONFIG, START_NS

STEP_S = 0.1
LEG_S = 6.0
GYRO_BIAS_RAD_S = math.radians(0.1)


def write_motor_drive(
    path: Path,
    fields: Sequence[complex],
    seed: int,
    *,
    patterns: Sequence[Sequence[float]],
    ripple: float = 0.2,
    noise_deg: float = 0.4,
    turn_rad_s: float = 0.9,
    legs: int = 48,
    has_currents: bool = True,
    lost_heading: int = -1,
) -> None:
    """Write a drive of legs with and without current, the rover turned between them.

    Args:
        path: The log.
        fields: Of each motor per ampere, ahead and to the left, over the earth's.
        seed: Of the noise.
        patterns: Currents of the motors in A on a leg, one of them for every second leg.
        ripple: Of each current by itself, standard deviation over the current.
        noise_deg: Of the compass.
        turn_rad_s: Yaw rate for a second between two legs.
        legs: Number of legs.
        has_currents: Whether the drive reports them.
        lost_heading: Number of a heading that is no number; -1 for none.
    """
    rng = np.random.default_rng(seed)
    config = Config.model_validate(CONFIG)
    steps = int(LEG_S / STEP_S)
    yaw, bias = 0.3, GYRO_BIAS_RAD_S
    with LogWriter(
        path, START_NS, config.model_dump_json(by_alias=True).encode(), collect_data_files(config), "real"
    ) as log:
        for step in range(legs * steps):
            t_ns = START_NS + round(1e9 * STEP_S * step)
            leg, place = divmod(step, steps)
            rate = turn_rad_s * (1.0 if leg % 16 < 8 else -1.0) if place < 10 and leg else 0.0
            yaw += rate * STEP_S
            pattern = patterns[leg // 2 % len(patterns)] if leg % 2 else (0.0,) * len(fields)
            current = [each * (1.0 + ripple * rng.standard_normal()) for each in pattern]
            own = sum(field * each for field, each in zip(fields, current, strict=True))
            north = 1j + own * cmath.rect(1.0, yaw)
            shown = yaw - (cmath.phase(north) - math.pi / 2) + math.radians(noise_deg) * rng.standard_normal()
            heading = math.nan if step == lost_heading else math.remainder(shown, math.tau)
            read_rate = rate + bias + 0.002 * rng.standard_normal()
            log.received("compass", Received(t_ns, b"$"))
            log.samples(
                t_ns,
                [
                    RateSample(device="imu", t_ns=t_ns, rate_z_rad_s=read_rate),
                    *(
                        WheelSample(
                            device="wheels", t_ns=t_ns, wheel=wheel, current_a=each if has_currents else None
                        )
                        for wheel, each in enumerate(current)
                    ),
                    HeadingSample(
                        device="compass", t_ns=t_ns, heading_rad=heading, reference=HeadingReference.MAGNETIC
                    ),
                ],
            )
