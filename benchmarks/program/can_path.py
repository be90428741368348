"""Does the CAN path lose frames, and what does decoding one cost?

    python -m benchmarks.program.can_path [--seconds 60]

Four wheels at 100 Hz, an IMU at 100 Hz that nobody listens to, and setpoints at 100 Hz the other way, with
the real driver and link, on python-can's virtual bus and over slcan on a pseudo-terminal. Prints JSON; exit
code 1 when a frame was lost.
"""

import argparse
import json
import struct
import sys
import tempfile
import threading
from collections.abc import Callable
from itertools import cycle
from pathlib import Path
from typing import Literal

from drivers.can.frame import CanFrame, pack_can_frame
from drivers.can_wheels.codec import CanWheelsCodec
from drivers.can_wheels.mapping_file import load_mapping
from drivers.can_wheels.messages import MessageWriter
from drivers.can_wheels.settings import CanWheelsSettings
from drivers.clock import NANOSECONDS_PER_SECOND, SystemClock, nanoseconds, stopwatch_ns
from drivers.driver import WheelDrive
from drivers.link import Received
from drivers.samples import WheelCommand, WheelSample
from sim_backends.serving.can_bus_port import CanBusPort
from sim_backends.serving.port import Port
from sim_backends.serving.slcan_port import SlcanPort

CLOCK = SystemClock()
FRAME_PERIOD_NS = 2_000_000
COMMAND_PERIOD_NS = 10_000_000
SETTLING_NS = NANOSECONDS_PER_SECOND // 2
CALLS, REPEATS = 20_000, 7


class Rover(threading.Thread):
    """The far end: sends a frame of wheels at rest every 2 ms and counts the setpoints it hears."""

    def __init__(self, port: Port[bytes]) -> None:
        super().__init__(daemon=True)
        self.sent = self.refused = self.heard = 0
        self.is_sending = True
        self.is_listening = True
        self._port = port
        bus = load_mapping("generic_wheel")
        names = [f"Wheel{wheel}_State" for wheel in range(4)]
        self._writers = [MessageWriter(bus.message(name), bus.protection(name)) for name in names]

    def run(self) -> None:
        """Keep the pace; what is late is caught up."""
        next_ns = CLOCK.now_ns()
        kinds = cycle([*self._writers, None])
        while self.is_listening:
            self.heard += len(self._port.read())
            if self.is_sending:
                writer = next(kinds)
                foreign = pack_can_frame(CanFrame(0x301, self.sent.to_bytes(8, "little")))
                is_taken = self._port.write(foreign if writer is None else writer.write({}))
                self.sent += is_taken
                self.refused += not is_taken
            next_ns += FRAME_PERIOD_NS
            CLOCK.sleep_until(next_ns)


def sustain(interface: Literal["virtual", "slcan"], seconds: float) -> dict[str, float]:
    """Return what was sent, received and lost in both directions."""
    with tempfile.TemporaryDirectory() as folder:
        channel = str(Path(folder) / "can")
        port: Port[bytes] = SlcanPort(channel) if interface == "slcan" else CanBusPort("virtual", channel)
        settings = CanWheelsSettings(interface=interface, channel=channel, mapping="generic_wheel")
        drive = settings.make_driver("wheels", settings.make_link(CLOCK), CLOCK)
        port.open()
        rover = Rover(port)
        rover.is_sending = False
        rover.start()
        with drive:
            received, commanded = drive_rover(drive, rover, seconds)
            heard = rover.heard  # before the zero setpoints with which the drive closes
        rejected = dict(drive.health().rejected)
        rover.is_listening = False
        rover.join()
        port.close()
    received += rejected.pop("other_traffic", 0)
    return {
        "sent": rover.sent,
        "received": received,
        "lost": rover.sent - received + rover.refused,
        "rejected": sum(rejected.values()),
        "set_points_sent": commanded,
        "set_points_heard": heard,
        "set_points_lost": commanded - heard,
    }


def drive_rover(drive: WheelDrive, rover: Rover, seconds: float) -> tuple[int, int]:
    """Poll and command at 100 Hz; return how many wheel samples came and setpoints were tried."""
    received = commanded = 0
    start_ns = CLOCK.now_ns()
    stop_ns = start_ns + nanoseconds(seconds)
    cycle_ns = start_ns + SETTLING_NS  # the adapter needs a moment to open its channel
    while cycle_ns < stop_ns + 2 * SETTLING_NS:
        CLOCK.sleep_until(cycle_ns)
        rover.is_sending = cycle_ns < stop_ns + SETTLING_NS
        received += sum(isinstance(sample, WheelSample) for sample in drive.poll())
        if rover.is_sending:
            drive.command(
                WheelCommand(t_ns=cycle_ns, expires_ns=cycle_ns + SETTLING_NS, speed_rad_s=(1.0,) * 4)
            )
            commanded += 4
        cycle_ns += COMMAND_PERIOD_NS
    return received, commanded


def cost_us(call: Callable[[], object]) -> float:
    """Return the cost of one call in microseconds, the best of several repeats."""
    costs_us = []
    for _ in range(REPEATS):
        start_ns = stopwatch_ns()
        for _ in range(CALLS):
            call()
        costs_us.append((stopwatch_ns() - start_ns) / CALLS / 1000.0)
    return min(costs_us)


def decode_costs(mapping: str, name: str, layout: struct.Struct) -> dict[str, float]:
    """Return what one frame costs with a bare struct, bare cantools and our codec, and the ratios."""
    bus = load_mapping(mapping)
    message = bus.message(name)
    writer = MessageWriter(message, bus.protection(name))
    # All values of a rolling counter in turn; every frame is accepted.
    frames = cycle([Received(1, writer.write({})) for _ in range(16)])
    codec = CanWheelsCodec("wheels", bus)
    data = next(frames).payload[8 : 8 + message.length]
    struct_us = cost_us(lambda: layout.unpack(data))
    cantools_us = cost_us(lambda: message.decode(data))
    codec_us = cost_us(lambda: codec.decode(next(frames)))
    return {
        "struct_us": round(struct_us, 3),
        "cantools_us": round(cantools_us, 3),
        "codec_us": round(codec_us, 3),
        "codec_to_struct": round(codec_us / struct_us, 1),
        "codec_to_cantools": round(codec_us / cantools_us, 2),
    }


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--seconds", type=float, default=60.0, help="how long each bus is loaded")
    seconds = parser.parse_args().seconds
    sustained = {"virtual": sustain("virtual", seconds), "slcan": sustain("slcan", seconds)}
    lost = sum(figures["lost"] + figures["set_points_lost"] for figures in sustained.values())
    report = {
        "seconds": seconds,
        "sustained": sustained,
        "decode": {
            "odrive_estimates": decode_costs(
                "odrive_0_5", "Axis0_Get_Encoder_Estimates", struct.Struct("<ff")
            ),
            "generic_state_with_counter_and_crc": decode_costs(
                "generic_wheel", "Wheel0_State", struct.Struct("<3shhB")
            ),
        },
        "passed": lost == 0,
    }
    print(json.dumps(report, indent=2))
    return 0 if lost == 0 else 1


if __name__ == "__main__":
    sys.exit(main())
