"""Logs of a CAN bus with two wheels, a gyro and perhaps a steering wheel, with mapping and DBC file."""

import math
import struct
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

import numpy as np

from tests.nature.odd_drives.motion import Drive
from tests.nature.odd_drives.table import toml

EPOCH_S = 1_700_000_000
DBC = """VERSION ""

NS_ :

BS_:

BU_: Host Drive

BO_ 256 WheelLeft: 4 Drive
 SG_ Angle : 0|32@1- (1,0) [0|0] "" Host

BO_ 257 WheelRight: 4 Drive
 SG_ Angle : 0|32@1- (1,0) [0|0] "" Host

BO_ 272 SpeedLeft: 4 Drive
 SG_ Speed : 0|32@1- (0.001,0) [0|0] "" Host

BO_ 273 SpeedRight: 4 Drive
 SG_ Speed : 0|32@1- (0.001,0) [0|0] "" Host

BO_ 288 Inertial: 2 Drive
 SG_ YawRate : 0|16@1- (0.0005,0) [0|0] "rad/s" Host

BO_ 304 Steering: 2 Drive
 SG_ Angle : 0|16@1- (0.1,0) [0|0] "deg" Host
"""
Frame = tuple[float, int, bytes]


@dataclass(frozen=True, kw_only=True)
class CanKit:
    """What is on the bus, and how the mapping describes it."""

    speeds: bool = False
    speed_factor: float = 1.0
    """Unit of the speed signal, per rad/s; the mapping says rad/s."""
    gyro: bool = True
    steering_ratio: float = 0.0
    """Turns of the steering wheel per turn of the front wheel; 0: none on the bus."""
    has_ratio: bool = True
    nodes: tuple[str, str] = ("Left", "Right")


def candump(frames: list[Frame]) -> str:
    """Return the log of `candump -L`."""
    return "".join(f"({EPOCH_S + t:.6f}) can0 {name:03X}#{data.hex().upper()}\n" for t, name, data in frames)


def candump_delta(frames: list[Frame]) -> str:
    """Return what `candump -t d` prints: each time counts from the frame before."""
    times = [frame[0] for frame in frames]
    steps = [0.0] + [later - earlier for earlier, later in pairwise(times)]
    lines = []
    for step, (_, name, data) in zip(steps, frames, strict=True):
        payload = " ".join(f"{byte:02X}" for byte in data)
        lines.append(f" ({step:010.6f})  can0  {name:03X}   [{len(data)}]  {payload}\n")
    return "".join(lines)


def savvycan(first_us: int, *, bits: int = 63) -> Callable[[list[Frame]], str]:
    """Return a writer of SavvyCAN's CSV whose clock begins at `first_us` and has so many bits."""

    def write(frames: list[Frame]) -> str:
        names = ",".join(f"D{index}" for index in range(1, 9))
        lines = [f"Time Stamp,ID,Extended,Dir,Bus,LEN,{names}"]
        for t, name, data in frames:
            stamp = first_us + round(t * 1e6)
            if first_us >= 0:
                stamp %= 2**bits
            cells = [f"{byte:02X}" for byte in data] + [""] * (8 - len(data))
            lines.append(f"{stamp},{name:08X},false,Rx,0,{len(data)},{','.join(cells)}")
        return "\n".join(lines) + "\n"

    return write


@dataclass(kw_only=True)
class CanLog:
    """Frames in the order of the recording, and all files."""

    frames: list[Frame]
    rover: dict[str, object]
    mapping: dict[str, object]
    writer: Callable[[list[Frame]], str] = candump
    name: str = "drive.log"
    files: dict[str, str] = field(default_factory=lambda: {"drive.dbc": DBC})

    def write(self, folder: Path) -> list[str]:
        """Write log, mapping, DBC file and rover. Return the arguments of the import."""
        (folder / self.name).write_text(self.writer(self.frames), encoding="utf-8")
        (folder / "rover.toml").write_text(toml(self.rover), encoding="utf-8")
        (folder / "mapping.toml").write_text(toml(self.mapping), encoding="utf-8")
        for name, text in self.files.items():
            (folder / name).write_text(text, encoding="utf-8")
        return ["can", self.name, "--config", "rover.toml", "--map", "mapping.toml"]


def record_can(drive: Drive, kit: CanKit, rng: np.random.Generator) -> CanLog:
    """Return the log of a drive."""
    frames: list[Frame] = []
    for index in range(2):
        times = _times(drive, 50.0, rng)
        if kit.speeds:
            speed = drive.at(drive.speeds[:, index], times)
            noise = np.where(np.abs(speed) < 1e-6, 0.0, rng.normal(0.0, 0.02, len(times)))
            values = np.round((speed + noise) * kit.speed_factor * 1000.0)
        else:
            values = np.floor(drive.at(drive.angles[:, index], times) / math.tau * 4096.0)
        first = 272 if kit.speeds else 256
        frames += _frames(times, first + index, "<i", values)
    if kit.gyro:
        times = _times(drive, 100.0, rng)
        rate = drive.at(drive.yaw_rate, times) + rng.normal(0.0, 0.003, len(times)) + 0.001
        frames += _frames(times, 288, "<h", np.round(rate / 0.0005))
    if kit.steering_ratio:
        times = _times(drive, 50.0, rng)
        angle = np.degrees(drive.at(drive.steering, times)) * kit.steering_ratio
        frames += _frames(times, 304, "<h", np.round((angle + rng.normal(0.0, 0.2, len(times))) * 10.0))
    frames.sort(key=lambda frame: frame[0])
    limits = {"wheel_speed_rad_s": drive.rover.limit_rad_s, "wheel_acceleration_rad_s2": 500}
    return CanLog(
        frames=frames,
        rover={"rover": drive.rover.description, "limits": limits},
        mapping=_mapping(kit),
    )


def _times(drive: Drive, rate_hz: float, rng: np.random.Generator) -> np.ndarray:
    """Return the times of a periodic message."""
    count = int(drive.t[-1] * rate_hz)
    times = (np.arange(count) + float(rng.uniform())) / rate_hz + rng.normal(0.0, 0.0002, count).clip(
        -0.001, 0.001
    )
    return np.asarray(np.maximum(times, 0.0))


def _frames(times: np.ndarray, name: int, layout: str, values: np.ndarray) -> list[Frame]:
    """Return the frames of one signal."""
    pairs = zip(times, values, strict=True)
    return [(float(t), name, struct.pack(layout, int(value))) for t, value in pairs]


def _mapping(kit: CanKit) -> dict[str, object]:
    """Return the mapping of the signals."""
    if kit.speeds:
        every: dict[str, object] = {
            "speed": {"message": "Speed{node}", "signal": "Speed", "unit": "rad/s"},
        }
    else:
        angle = {"message": "Wheel{node}", "signal": "Angle", "unit": "ticks", "ticks_per_revolution": 4096}
        every = {"position": angle}
    wheels: list[dict[str, object]] = [{"node": node} for node in kit.nodes]
    if kit.steering_ratio:
        steering: dict[str, object] = {"message": "Steering", "signal": "Angle", "unit": "deg"}
        if kit.has_ratio:
            steering["ratio"] = kit.steering_ratio
        wheels.append({"node": "Front", "measured": False, "steering": steering})
    mapping: dict[str, object] = {"dbc": ["drive.dbc"], "every_wheel": every, "wheel": wheels}
    if kit.gyro:
        mapping["yaw_rate"] = {"message": "Inertial", "signal": "YawRate", "unit": "rad/s"}
    return mapping
