"""Feed device parsers random and mutated input; they must stay quick, small and silent.

`python -m benchmarks.program.fuzz_parsers --inputs 1000000` prints JSON; exit code 1 when a parser failed.
"""

import argparse
import dataclasses
import json
import math
import os
import struct
import sys
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from functools import partial, reduce
from operator import xor
from pathlib import Path
from time import thread_time_ns

import numpy as np

from drivers.clock import NANOSECONDS_PER_SECOND, nanoseconds, stopwatch_ns
from drivers.device_settings import FrameDeviceSettings
from drivers.driver import Codec, Rejection
from drivers.link import Received
from drivers.samples import Sample
from sim_backends.build import build_world
from sim_backends.settings import SimulationSettings
from tests.conformance.benches import ADAPTER, CASES, NAME, Case

BLOCK = 4096
FLOOD_BYTES = 65_536
LONGEST_NOISE = 64
SLOWEST_ALLOWED_S = 1.0
HELD_ALLOWED_BYTES = 4096
GROWTH_ALLOWED_MB = 16.0

MakeTarget = Callable[[], tuple[Codec[bytes], tuple[bytes, ...]]]


@dataclasses.dataclass(kw_only=True)
class Report:
    """What happened to one parser; `failures` is empty when all is well."""

    inputs: int = 0
    inputs_per_s: float = 0.0
    accepted: int = 0
    rejected: Counter[str] = dataclasses.field(default_factory=Counter)
    slowest_input_ms: float = 0.0
    most_held_bytes: int = 0
    rss_growth_mb: float = 0.0
    failures: list[str] = dataclasses.field(default_factory=list)


def nmea_gnss() -> tuple[Codec[bytes], tuple[bytes, ...]]:
    from drivers.nmea import encode_sentence
    from drivers.nmea_gnss.codec import NmeaGnssCodec
    from drivers.nmea_gnss.settings import NmeaGnssSettings

    place = "4800.0000000,N,01100.0000000,E"
    bodies = (
        *(f"GNGGA,1200{second:02d}.00,{place},4,12,0.8,500.0,M,47.0,M,," for second in range(20)),
        "GNGST,120000.00,,,,,0.010,0.012,0.020",
        f"GNRMC,120000.20,A,{place},0.5,84.4,010126,,,R",
    )
    return NmeaGnssCodec("gnss", NmeaGnssSettings(port="gnss")), tuple(map(encode_sentence, bodies))


def nmea_compass() -> tuple[Codec[bytes], tuple[bytes, ...]]:
    from drivers.nmea import encode_sentence
    from drivers.nmea_compass.codec import NmeaCompassCodec

    bodies = (
        "HCHDG,98.3,0.0,E,12.6,W",
        "HCHDM,238.4,M,",
        "HEHDT,274.07,T",
        "GNTHS,244.28,A",
        "TIROT,-12.5,A",
        "PASHR,130533.620,0.311,T,-80.467,-1.395,,0.066,0.067,0.215,2,3",
        "IIXDR,C,,C,AIRTEMP,A,-1.0,D,HEEL,A,2.9,D,TRIM,P,,B,BARO,A,-3.9,D,RUDDER",
        "GPGGA,094736,5251.0094,N,00518.8172,E,1,12,0.60,-4,M,46.8,M,,",
    )
    # Without checksums, or hardly a mutated sentence would get past them to the fields.
    lines = [line for body in bodies for line in (encode_sentence(body), f"${body}\r\n".encode("ascii"))]
    return NmeaCompassCodec("fuzz", require_checksum=False), tuple(lines)


def witmotion() -> tuple[Codec[bytes], tuple[bytes, ...]]:
    from drivers.witmotion.codec import WitMotionCodec, encode_frame

    frames = tuple(encode_frame(kind, 0x55, -0x5355, 17895) for kind in (0x50, 0x51, 0x52, 0x53, 0x54, 0x59))
    return WitMotionCodec("fuzz"), frames


def robotino_board() -> tuple[Codec[bytes], tuple[bytes, ...]]:
    from drivers.robotino_board.codec import BoardReply, RobotinoBoardCodec, build_reply
    from drivers.robotino_board.settings import RobotinoBoardSettings

    replies = [
        BoardReply(
            ticks=(index * 40, -index * 30, index),
            speed_steps=(12, -9, 0),
            current_raw=(60, 1023, 0),
            battery_raw=880,
            system_current_raw=100,
            bumper_pressed=index % 2 == 1,
            time_ms=index * 20,
            board="EA09" if index == 7 else "EA05",
            motor_fault=index == 5,
        )
        for index in range(8)
    ]
    settings = RobotinoBoardSettings(type="robotino_board", port="fuzz")
    return RobotinoBoardCodec("fuzz", settings), tuple(map(build_reply, replies))


def can_wheels(mapping: str) -> tuple[Codec[bytes], tuple[bytes, ...]]:
    from drivers.can.frame import CanFrame, pack_can_frame
    from drivers.can_wheels.codec import CanWheelsCodec
    from drivers.can_wheels.mapping_file import load_mapping
    from drivers.can_wheels.messages import MessageWriter

    bus = load_mapping(mapping)
    frames = [
        pack_can_frame(CanFrame(0x7FF, b"", is_remote=True)),
        pack_can_frame(CanFrame(0x40, bytes(8), is_error=True)),
    ]
    for message in bus.database.messages:
        frames += [
            pack_can_frame(CanFrame(message.frame_id, data, message.is_extended_frame))
            for data in (bytes(8), b"\xff" * 8, b"\x00\x00\x80\x7f" * 2)  # zero, NaN and infinity in float32
        ]
        if message.signals and not message.is_multiplexed():
            writer = MessageWriter(message, bus.protection(message.name))
            frames += [writer.write({}) for _ in range(4)]  # with a counter that runs on
    return CanWheelsCodec("fuzz", bus), tuple(frames)


def vectornav() -> tuple[Codec[bytes], tuple[bytes, ...]]:
    from drivers.vectornav.codec import VectorNavCodec

    angles, vector = ",+100.949,-007.330,+000.715", ",-00.000018,+00.001122,-00.000551"
    bodies = (f"VNYMR{angles}{3 * vector}", f"VNYPR{angles},S0000", f"VNGYR{vector}", "VNERR,03")
    lines = [f"${body}*{reduce(xor, body.encode()):02X}\r\n".encode() for body in bodies]
    return VectorNavCodec("fuzz"), tuple(lines)


def robotino3_board() -> tuple[Codec[bytes], tuple[bytes, ...]]:
    from drivers.robotino3_board.codec import Robotino3BoardCodec, build_message
    from drivers.robotino3_board.frames import build_frame
    from drivers.robotino3_board.settings import Robotino3BoardSettings

    def readings(ticks: int, current_a: float) -> bytes:
        return struct.pack("<4h4i4f", 30, -30, 0, 0, ticks, -ticks, 0, 0, current_a, 0.1, 0.0, 0.0)

    bodies = [build_message(53, readings(index * 40, 0.5)) for index in range(4)]
    bodies += [
        build_message(53, readings(0, math.nan)) + build_message(37, b"\x01"),
        build_message(65, struct.pack("<2f4BI", 24.0, 1.0, 0, 0, 1, 0, 0)) + build_message(39, b"\x00"),
        build_message(252, b"motor") + build_message(251, b"\xaa\x55"),
        build_message(53, bytes(39)),
        b"\x35\x28\x00",
    ]
    settings = Robotino3BoardSettings(port="fuzz")
    return Robotino3BoardCodec("fuzz", settings), tuple(map(build_frame, bodies))


def xsens() -> tuple[Codec[bytes], tuple[bytes, ...]]:
    from drivers.xsens.codec import XsensCodec

    vector, unit = struct.pack(">3f", 0.1, -0.2, 9.8), struct.pack(">4f", 1.0, 0.0, 0.0, 0.0)
    items = {
        0x1020: bytes((0, 5)),
        0x1060: bytes(4),
        0x2010: unit,
        0x2034: vector,
        0x4020: vector,
        0x4022: bytes(18),
        0x8021: bytes(12),
        0x802B: struct.pack(">3d", 0.1, -0.2, 0.3),
        0xE020: bytes((0, 0x40, 0, 3)),
    }
    packed = {kind: struct.pack(">HB", kind, len(data)) + data for kind, data in items.items()}
    clipped = b"\xe0\x20\x04\x00\x08\x14\x01"
    bodies = [b"\x36" + packed[kind] for kind in items]
    bodies += [b"\x36" + b"".join(packed.values()), b"\x36" + packed[0x4020] + packed[0x2010] + clipped]
    bodies += [b"\x42\x1e", b"\x32" + bytes(50), b"\x3e"]
    framed = [b"\xff" + body[:1] + bytes((len(body) - 1,)) + body[1:] for body in bodies]
    long = b"\xff\x36\xff\x01\x04" + 20 * packed[0x802B][:13]
    return XsensCodec("fuzz"), tuple(
        b"\xfa" + message + bytes((-sum(message) % 256,)) for message in (*framed, long)
    )


def canopen_wheels() -> tuple[Codec[bytes], tuple[bytes, ...]]:
    from drivers.can.frame import CanFrame, pack_can_frame
    from drivers.canopen_wheels.codec import CanopenWheelsCodec
    from drivers.canopen_wheels.settings import CanopenWheelsSettings

    settings = CanopenWheelsSettings.model_validate(
        {
            "interface": "virtual",
            "channel": "fuzz",
            "wheel": [{"node": 4}, {"node": 5, "sign": -1}],
            "counts_per_motor_turn": 4096,
            "gear_ratio": 50.0,
            "rated_current_a": 3.0,
        }
    )
    frames = [
        CanFrame(base + node, bytes((index, 6)) + bytes(6))
        for base in (0x080, 0x180, 0x280, 0x580, 0x700)
        for node in (4, 5, 6)
        for index in (0, 0x27, 0x60, 0x80)
    ]
    frames += [
        CanFrame(0x000, b"\x01\x04"),
        CanFrame(0x40, bytes(8), is_error=True),
        CanFrame(0x184, b"\x27"),
    ]
    return CanopenWheelsCodec("fuzz", settings), tuple(map(pack_can_frame, frames))


def vesc() -> tuple[Codec[bytes], tuple[bytes, ...]]:
    from drivers.can.frame import CanFrame, pack_can_frame
    from drivers.vesc.codec import VescCodec
    from drivers.vesc.settings import VescSettings

    settings = VescSettings.model_validate(
        {
            "interface": "virtual",
            "channel": "fuzz",
            "wheel": [{"node": 4}, {"node": 5, "sign": -1}],
            "pole_pairs": 7,
            "gear_ratio": 20.0,
        }
    )
    statuses = [(command << 8 | node, bytes(8)) for command in (9, 14, 15, 16, 27, 58) for node in (4, 5, 6)]
    turned = [(0x1B04, bytes((0, 0, 0, index, 0, 239, 0, 0))) for index in range(4)]
    answers = [(0x8FE, bytes((4, 1, 50, 0, 0, 128, 0, code))) for code in (0, 4, 200)]
    frames = [CanFrame(can_id, data, is_extended=True) for can_id, data in (*statuses, *turned, *answers)]
    frames += [CanFrame(0x905, bytes(4), is_extended=True), CanFrame(0x40, bytes(8), is_error=True)]
    return VescCodec("fuzz", settings), tuple(map(pack_can_frame, frames))


def emulated(case: Case) -> tuple[Codec[bytes], tuple[bytes, ...]]:
    """Return the codec of a device, and what its emulator sends in a second."""
    table = {"type": case.device_type, **case.settings(Path("fuzz"))}
    settings = ADAPTER.validate_python(table)
    assert not isinstance(settings, FrameDeviceSettings)
    simulation = SimulationSettings.model_validate({"plant": {"type": case.plant}})
    world = build_world({NAME: settings}, simulation, 0)
    world.advance(nanoseconds(1.0))
    sent = world.byte_devices[NAME].to_host.take(nanoseconds(1.0))
    return settings.make_codec(NAME), tuple(arrival.payload for arrival in sent)


PARSERS: dict[str, MakeTarget] = {
    **{case.device_type: partial(emulated, case) for case in CASES if isinstance(case.garbage, bytes)},
    "nmea_compass": nmea_compass,
    "nmea_gnss": nmea_gnss,
    "witmotion": witmotion,
    "vectornav": vectornav,
    "canopen_wheels": canopen_wheels,
    "vesc": vesc,
    "xsens": xsens,
    "robotino3_board": robotino3_board,
    "robotino_board": robotino_board,
    "can_wheels": partial(can_wheels, "generic_wheel"),
    "can_wheels_float": partial(can_wheels, "odrive_0_6"),
}
"""What the emulator of a device sends, or, in their place, payloads that reach more of its codec."""


def mutated_inputs(seeds: Sequence[bytes], rng: np.random.Generator) -> Iterator[bytes]:
    """Yield inputs without end: valid, random, with flipped bits, cut, with doubled parts, spliced.

    One in each block is a flood of 64 KiB. Numbers are drawn a block at a time, so that an input costs a
    microsecond.
    """
    while True:
        noise = rng.bytes(BLOCK + FLOOD_BYTES)
        yield noise[:FLOOD_BYTES] if rng.random() < 0.5 else (noise[:97] + seeds[0]) * (FLOOD_BYTES // 128)
        kinds = rng.integers(0, 6, BLOCK).tolist()
        picks = rng.integers(0, len(seeds), (BLOCK, 2)).tolist()
        places = rng.random((BLOCK, 3)).tolist()
        for kind, (first, second), (start, end, where) in zip(kinds, picks, places, strict=True):
            seed, other = seeds[first], seeds[second]
            left, right = int(start * len(seed)), int(end * len(other))
            if kind == 0:
                yield seed
            elif kind == 1:
                offset = int(where * BLOCK)
                yield noise[offset : offset + int(end * LONGEST_NOISE)]
            elif kind == 2:
                flipped = bytearray(seed)
                flipped[left] ^= 1 << int(where * 8)
                flipped[int(end * len(seed))] ^= 1 << int(where * 64) % 8
                yield bytes(flipped)
            elif kind == 3:
                yield seed[:left]
            elif kind == 4:
                yield seed + seed[left:]
            elif len(seed) == len(other) and where < 0.5:
                yield seed[:left] + other[left:]
            else:
                yield seed[:left] + other[right:]


def fuzz(codec: Codec[bytes], seeds: Sequence[bytes], inputs: int, rng: np.random.Generator) -> Report:
    """Feed `inputs` inputs to a parser and report; stops at the first exception."""
    report = Report()
    slowest_ns = 0
    rss_before_mb = 0.0
    started_ns = stopwatch_ns()
    for payload in mutated_inputs(seeds, rng):
        if report.inputs == inputs:
            break
        before_ns = thread_time_ns()  # of this parser alone, however busy the machine is
        try:
            results = codec.decode(Received(20_000_000 * report.inputs, payload))
        except Exception as error:  # noqa: BLE001 - any exception at all is what is looked for
            report.failures.append(f"{error!r} on input {report.inputs}: {payload[:200].hex()}")
            break
        slowest_ns = max(slowest_ns, thread_time_ns() - before_ns)
        report.inputs += 1
        _note_results(report, results)
        if report.inputs % BLOCK == 0 or report.inputs == inputs:
            report.most_held_bytes = max(report.most_held_bytes, held_bytes(codec))
        if report.inputs == min(4 * BLOCK, inputs // 2):  # warm by now
            rss_before_mb = _rss_mb()
    report.inputs_per_s = round(report.inputs * NANOSECONDS_PER_SECOND / (stopwatch_ns() - started_ns))
    report.slowest_input_ms = slowest_ns / 1e6
    report.rss_growth_mb = round(_rss_mb() - rss_before_mb, 2)
    _judge(report)
    return report


def held_bytes(thing: object) -> int:
    """Return how many bytes and elements an object and the parts of its own keep in buffers."""
    if isinstance(thing, bytes | bytearray | str):
        return len(thing)
    if isinstance(thing, list | dict | set):
        return len(thing)
    if type(thing).__module__.startswith("drivers.") and hasattr(thing, "__dict__"):
        return sum(held_bytes(part) for part in vars(thing).values())
    return 0


def _note_results(report: Report, results: Sequence[Sample | Rejection]) -> None:
    for result in results:
        if isinstance(result, Rejection):
            report.rejected[result.reason] += 1
            continue
        report.accepted += 1
        for field in dataclasses.fields(result):
            value = getattr(result, field.name)
            if isinstance(value, float) and not math.isfinite(value) and len(report.failures) < 10:
                report.failures.append(f"{field.name} is not finite in {result}")


def _judge(report: Report) -> None:
    if report.slowest_input_ms > 1e3 * SLOWEST_ALLOWED_S:
        report.failures.append(f"one input took {report.slowest_input_ms:.1f} ms")
    if report.most_held_bytes > HELD_ALLOWED_BYTES:
        report.failures.append(f"the parser holds {report.most_held_bytes} bytes")
    if report.rss_growth_mb > GROWTH_ALLOWED_MB:
        report.failures.append(f"memory grew by {report.rss_growth_mb} MB")
    if len(report.rejected) > 100:
        report.failures.append(
            f"{len(report.rejected)} different reasons of rejection: they cannot be counted"
        )


def _rss_mb() -> float:
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--inputs", type=int, default=100_000, help="inputs per parser")
    parser.add_argument("--parser", choices=sorted(PARSERS), help="one parser; all of them when left out")
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    names = [arguments.parser] if arguments.parser else list(PARSERS)
    reports = {}
    for name in names:
        codec, seeds = PARSERS[name]()
        report = fuzz(codec, seeds, arguments.inputs, np.random.default_rng(arguments.seed))
        reports[name] = vars(report)
    print(json.dumps({"seed": arguments.seed, "parsers": reports}, indent=2))
    return 1 if any(report["failures"] for report in reports.values()) else 0


if __name__ == "__main__":
    sys.exit(main())
