"""What the log of the virtual Robotino costs: time per cycle and size per hour.

    python -m benchmarks.program.log_cost [--rounds 5]

One virtual run notes everything that a log gets. The writer then takes these calls in each round. Time is
that of the processor, of the loop's thread and of all threads. With `--camera` a camera of 640 x 480 pixels
at 5 Hz (MJPG) is added: photographs of ground as JPEG of quality 90.
"""

import argparse
import json
import statistics
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeAlias

from controllers.control_loop import StepOutput
from drivers.clock import NANOSECONDS_PER_SECOND, VirtualClock
from drivers.driver import Health
from drivers.link import CameraImage, LinkItem, Received
from drivers.samples import Sample
from rover_hil.config import load_config
from rover_hil.recording.schema import (
    COMMAND,
    CYCLE,
    set_point_record,
)
from rover_hil.recording.writer import LogWriter
from rover_hil.run.composition import build_virtual_rig
from sim_backends.world.plant import Truth

BAR_GB_PER_HOUR = 0.1
BAR_CAMERA_GB_PER_HOUR = 1.5
DRIVEN_S = 45.0
CAMERA_HZ = 5
JPEG_QUALITY = 90
PHOTOGRAPHS = Path(__file__).parents[2] / "sim_backends" / "rear_scene" / "photographs"

Call: TypeAlias = Callable[[LogWriter], None]


@dataclass
class Calls:
    """A tap that keeps what a log gets, cycle by cycle."""

    calls: list[Call] = field(default_factory=list)

    def received(self, device: str, item: LinkItem[bytes] | LinkItem[CameraImage]) -> None:
        """Keep what arrived."""
        self.calls.append(lambda log: log.received(device, item))

    def sent(self, device: str, t_ns: int, payload: bytes, delivered: bool) -> None:
        """Keep what was sent."""
        self.calls.append(lambda log: log.sent(device, t_ns, payload, delivered))

    def cycle(self, t_ns: int, samples: Sequence[Sample], output: StepOutput, truth: Truth) -> None:
        """Keep the records of a cycle."""

        def call(log: LogWriter) -> None:
            log.samples(t_ns, samples)
            log.estimate(output)
            log.truth(t_ns, truth)
            log.write_json(CYCLE, t_ns, {"late_ns": 51_234, "work_ns": 1_234_567})

        self.calls.append(call)

    def record(self, topic: str, t_ns: int, record: object) -> None:
        """Keep any other record."""
        self.calls.append(lambda log: log.write_json(topic, t_ns, record))

    def health(self, t_ns: int, healths: Sequence[Health]) -> None:
        """Keep the health of the devices."""
        self.calls.append(lambda log: log.health(t_ns, healths))


def drive(*, with_camera: bool) -> tuple[list[Call], int, int]:
    """Return what the log of a virtual run gets, the time of its start in ns, and the number of cycles."""
    config = load_config("robotino")
    clock = VirtualClock()
    start_ns = clock.now_ns()
    calls = Calls()
    rig, world = build_virtual_rig(config, clock, calls)
    pictures = jpeg_pictures() if with_camera else []
    rig.connect(1.0)
    cycles = round(DRIVEN_S * config.loop.rate_hz)
    for index in range(cycles):
        t_ns = start_ns + round((index + 1) * NANOSECONDS_PER_SECOND / config.loop.rate_hz)
        clock.sleep_until(t_ns)
        samples, output, sent = rig.cycle(t_ns)
        if pictures and index % round(config.loop.rate_hz / CAMERA_HZ) == 0:
            calls.received("camera", Received(t_ns, pictures[index % len(pictures)]))
        calls.cycle(t_ns, samples, output, world.plant.truth())
        calls.record(COMMAND, sent.t_ns, set_point_record(sent))
        if index % round(config.loop.rate_hz) == 0:
            calls.health(t_ns, rig.healths())
    rig.close()
    return calls.calls, start_ns, cycles


def jpeg_pictures() -> list[CameraImage]:
    """Return photographs of ground, shifted from frame to frame, as a camera with MJPG sends them."""
    import cv2
    import numpy as np

    pictures = []
    for path in sorted(PHOTOGRAPHS.glob("*.png"))[:4]:
        read = cv2.imread(str(path), cv2.IMREAD_COLOR)
        assert read is not None
        photograph = cv2.resize(read, (900, 700))
        for shift in range(0, 160, 40):
            pixels = np.ascontiguousarray(photograph[shift : shift + 480, shift : shift + 640], np.uint8)
            data = cv2.imencode(".jpg", pixels, (cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY))[1].tobytes()
            pictures.append(CameraImage(pixels, None, data))
    return pictures


def measure(path: Path, calls: Sequence[Call], start_ns: int, cycles: int) -> tuple[float, float]:
    """Return us per cycle of the loop's thread, and of all threads, for one log."""
    config_json = load_config("robotino").model_dump_json(by_alias=True).encode()
    log = LogWriter(path, start_ns, config_json, {}, "virtual")
    process_ns, thread_ns = time.process_time_ns(), time.thread_time_ns()
    for call in calls:
        call(log)
    thread_ns = time.thread_time_ns() - thread_ns
    log.close()
    process_ns = time.process_time_ns() - process_ns
    return thread_ns / 1e3 / cycles, process_ns / 1e3 / cycles


def main() -> int:
    """Print the figures as JSON; exit code 1 when a bar is missed."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--camera", action="store_true")
    arguments = parser.parse_args()
    calls, start_ns, cycles = drive(with_camera=arguments.camera)
    loop_us, all_us, gb_per_hour = [], [], 0.0
    with tempfile.TemporaryDirectory() as folder:
        for index in range(arguments.rounds):
            path = Path(folder) / f"{index}.mcap"
            loop, everything = measure(path, calls, start_ns, cycles)
            loop_us.append(loop)
            all_us.append(everything)
            gb_per_hour = path.stat().st_size / DRIVEN_S * 3600 / 1e9
            path.unlink()
    bar_gb = BAR_CAMERA_GB_PER_HOUR if arguments.camera else BAR_GB_PER_HOUR
    figures = {
        "cycles": cycles,
        "loop_us_per_cycle": round(statistics.median(loop_us), 1),
        "all_threads_us_per_cycle": round(statistics.median(all_us), 1),
        "gb_per_hour": round(gb_per_hour, 3),
        "bar_gb_per_hour": bar_gb,
    }
    print(json.dumps(figures, indent=2))
    return 0 if gb_per_hour <= bar_gb else 1


if __name__ == "__main__":
    sys.exit(main())
