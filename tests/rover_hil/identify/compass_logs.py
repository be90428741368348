"""Logs of a magnetised rover that turns, of which the truth is known."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np

from drivers.link import Received
from drivers.samples import RateSample, Sample
from drivers.witmotion.codec import WitMotionCodec
from rover_hil.config import Config
from rover_hil.drives.arrays import Array
from rover_hil.recording.data_files import collect_data_files
from rover_hil.recording.writer import LogWriter
from tests.nature.magnetised_rover import Rover, Turns, turn

START_NS = 1_000_000_000
CONFIG = {
    "schema": "rover-hil-config/1",
    "rover": {"kinematics": "skid_steer_4", "wheel_radius_m": 0.1, "track_m": 0.6},
    "limits": {"wheel_speed_rad_s": 4, "wheel_acceleration_rad_s2": 4},
    "loop": {"rate_hz": 50},
    "roles": {"wheels": "wheels", "gyro": "imu", "headings": ["compass"]},
    "devices": {
        "wheels": {"type": "can_wheels", "interface": "slcan", "channel": "a", "mapping": "generic_wheel"},
        "imu": {"type": "witmotion", "port": "b"},
        "compass": {"type": "nmea_compass", "port": "c"},
    },
}


def write_turns(path: Path, rover: Rover, seed: int, *, flip_gyro: bool = False) -> Turns:
    """Write what the sensors of a rover sent while it turned; return the truth."""
    config = Config.model_validate(CONFIG)
    turns = turn(rover, seed)
    codec = WitMotionCodec("imu")
    with LogWriter(
        path, START_NS, config.model_dump_json(by_alias=True).encode(), collect_data_files(config), "real"
    ) as log:
        for t_s, frames, sentence in zip(turns.t_s.tolist(), turns.frames, turns.sentences, strict=True):
            t_ns = START_NS + round(1e9 * t_s)
            log.received("imu", Received(t_ns, frames))
            samples: list[Sample] = [
                sample for sample in codec.decode(Received(t_ns, frames)) if isinstance(sample, Sample)
            ]
            if flip_gyro:
                samples = [_flipped(sample) for sample in samples]
            log.samples(t_ns, samples)
            if sentence:
                log.received("compass", Received(t_ns, sentence))
    return turns


def _flipped(sample: Sample) -> Sample:
    return replace(sample, rate_z_rad_s=-sample.rate_z_rad_s) if isinstance(sample, RateSample) else sample


def truth_rms_deg(turns: Turns, t_s: Array, yaw_rad: Array) -> float:
    """Return the rms error of headings against the truth, without its mean."""
    error = np.asarray(yaw_rad) - np.interp(t_s, turns.t_s, turns.yaw)
    mean = math.atan2(np.sin(error).sum(), np.cos(error).sum())
    rest = (error - mean + math.pi) % math.tau - math.pi
    return float(np.degrees(np.sqrt(np.mean(rest**2))))
