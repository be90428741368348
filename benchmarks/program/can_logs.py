"""How fast are logs of a CAN bus decoded and imported?

    python -m benchmarks.program.can_logs [--frames 400000] [--seconds 30]

Decoding: all signals of a message from many frames at once, in processor time per frame and signal, next to
cantools and to the codec on frames of the same message; the numbers are compared to the last bit. Import: a
bus with 2000 frames/s, of which 400 are of four wheels, as candump and BLF; elapsed time of the import next
to that of python-can's reader alone on the same file, in turns. Prints JSON; exit code 1 where numbers
differ.
"""

import argparse
import json
import resource
import sys
import tempfile
import time
from collections.abc import Callable, Iterable
from pathlib import Path

import can
import numpy as np

from drivers.can_wheels.mapping_file import SHIPPED_FOLDER, read_dbc
from drivers.can_wheels.messages import MessageReader
from drivers.clock import NANOSECONDS_PER_SECOND, stopwatch_ns
from rover_hil.drives.files.can_frames import read_can_log
from rover_hil.drives.files.can_signals import MessageFrames
from rover_hil.drives.formats.can.rover import rover_of_log
from rover_hil.drives.formats.can.to_log import write_can_as_log

FRAMES_PER_S = 2000
CHECKED = 20_000
ROVER = """[rover]
kinematics = "skid_steer_4"
wheel_radius_m = 0.1
track_m = 0.5
[limits]
wheel_speed_rad_s = 100
wheel_acceleration_rad_s2 = 500
"""


def decoding(count: int) -> dict[str, float | bool]:
    """Return the cost of decoding the signals of a message, and whether the numbers are the same."""
    message = read_dbc(SHIPPED_FOLDER / "odrive_0_6.dbc").get_message_by_name("Axis0_Get_Encoder_Estimates")
    data = np.random.default_rng(1).normal(0.0, 9.0, (count, 2)).astype("<f4").view(np.uint8)
    lengths = np.full(count, 8, np.uint8)
    names = [signal.name for signal in message.signals]

    def by_columns() -> list[list[float]]:
        columns = MessageFrames(message, lengths, data)
        return [columns.values(name).tolist() for name in names]

    def arrays() -> None:
        columns = MessageFrames(message, lengths, data)
        for name in names:
            columns.values(name)

    rows = [bytes(row) for row in data[:CHECKED]]
    reader = MessageReader(message, names, None)
    decoded = [message.decode(row, decode_choices=False) for row in rows]
    raws = [reader.read(row)[0] for row in rows]
    columns = by_columns()
    same = all(
        columns[place][:CHECKED] == [row[name] for row in decoded]  # type: ignore[call-overload]
        and columns[place][:CHECKED] == [None if row is None else row[name] for row in raws]
        for place, name in enumerate(names)
    )
    ours_us = least_us(arrays) / count
    return {
        "frames_per_s_and_core": 1e6 / ours_us,
        "us_per_frame": ours_us,
        "cantools_us_per_frame": least_us(lambda: [message.decode(row) for row in rows]) / CHECKED,
        "codec_us_per_frame": least_us(lambda: [reader.read(row) for row in rows]) / CHECKED,
        "same": same,
    }


def least_us(call: Callable[[], object]) -> float:
    """Return the least processor time of a call, of three, in microseconds."""
    times_ns = []
    for _ in range(3):
        start_ns = time.process_time_ns()
        call()
        times_ns.append(time.process_time_ns() - start_ns)
    return min(times_ns) / 1000


def bus(seconds: float) -> Iterable[can.Message]:
    """Yield the frames of a bus; every fifth is of a wheel that turns evenly."""
    for number in range(round(seconds * FRAMES_PER_S)):
        t_s = 1.7e9 + number / FRAMES_PER_S
        wheel, is_wheel = number // 5 % 4, number % 5 == 0
        position = np.float32(number / FRAMES_PER_S).tobytes() + np.float32(1.0).tobytes()
        identifier = wheel * 32 + 9 if is_wheel else 0x400 + number % 64
        data = position if is_wheel else number.to_bytes(8, "little")
        yield can.Message(t_s, identifier, is_extended_id=False, data=data, channel="can0")


def importing(suffix: str, seconds: float) -> dict[str, float]:
    """Return elapsed times of reading a log and of importing it."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        log, rover = folder / f"bus{suffix}", folder / "rover.toml"
        rover.write_text(ROVER, "utf-8")
        with can.Logger(log) as logger:
            for message in bus(seconds):
                logger.on_message_received(message)
        config = rover_of_log(str(rover), SHIPPED_FOLDER / "odrive_0_6.toml")
        start_ns = stopwatch_ns()
        count = sum(1 for _ in can.LogReader(log))
        read_ns = stopwatch_ns()
        frames = read_can_log(log)
        own_ns = stopwatch_ns()
        cycles = sum(1 for _ in write_can_as_log(frames, config, folder / "drive.mcap"))
        end_ns = stopwatch_ns()
    return {
        "frames": count,
        "cycles": cycles,
        "reader_s": (read_ns - start_ns) / NANOSECONDS_PER_SECOND,
        "own_reading_over_reader": (own_ns - read_ns) / (read_ns - start_ns),
        "import_over_reader": (end_ns - read_ns) / (read_ns - start_ns),
        "import_s_per_hour": (end_ns - read_ns) / NANOSECONDS_PER_SECOND * 3600.0 / seconds,
    }


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--frames", type=int, default=400_000)
    parser.add_argument("--seconds", type=float, default=30.0)
    options = parser.parse_args()
    result: dict[str, object] = {"decoding": (rates := decoding(options.frames))}
    for suffix in (".log", ".blf"):
        result[f"import{suffix}"] = importing(suffix, options.seconds)
    result["peak_mb"] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(json.dumps(result, indent=2))
    return 0 if rates["same"] else 1


if __name__ == "__main__":
    sys.exit(main())
