"""What `--live` costs per cycle of the virtual Robotino at 50 Hz: no viewer, one that reads or does not.

    python -m benchmarks.program.live_cost [--seconds 10]

A virtual run notes what a log gets; it is then written at 50 Hz of real time. Time is that of the processor:
of the loop's thread, and of all threads. The peer is the same log without `--live`.
"""

import argparse
import base64
import json
import os
import socket
import struct
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path

from benchmarks.program.log_cost import Call, drive
from drivers.clock import NANOSECONDS_PER_SECOND, SystemClock
from rover_hil.live.server import LiveServer
from rover_hil.recording.writer import LogWriter

BAR_US = 300.0
RATE_HZ = 50
CHANNELS = range(1, 60)
"""Numbers that the server gives to channels; a viewer asks for all."""
MODES = ("without --live", "no viewer", "viewer that reads", "viewer that never reads")


def main() -> int:
    """Print the figures as JSON; exit code 1 when a viewer costs more than the bar."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seconds", type=float, default=10.0)
    seconds = parser.parse_args().seconds
    calls, start_ns, cycles = drive(with_camera=False)
    portions = [
        calls[len(calls) * index // cycles : len(calls) * (index + 1) // cycles] for index in range(cycles)
    ]
    portions = portions[: round(seconds * RATE_HZ)]
    rows = {mode: measure(mode, portions, start_ns) for mode in MODES}
    base = rows[MODES[0]]
    extra = {
        mode: {name: round(row[name] - base[name], 1) for name in ("loop_us", "all_threads_us")}
        for mode, row in rows.items()
        if mode != MODES[0]
    }
    print(json.dumps({"per_cycle": rows, "extra_per_cycle": extra, "bar_us": BAR_US}, indent=2))
    reads, stalls = rows[MODES[2]]["viewer_kb"], rows[MODES[3]]["viewer_kb"]
    is_within = all(value <= BAR_US for row in extra.values() for value in row.values())
    return 0 if is_within and reads > 0 and stalls == 0 else 1


def measure(mode: str, portions: Sequence[Sequence[Call]], start_ns: int) -> dict[str, float]:
    """Return the time per cycle in us, the longest cycle of the loop, and what the viewer got."""
    clock = SystemClock()
    with ExitStack() as stack:
        path = Path(stack.enter_context(tempfile.TemporaryDirectory())) / "run.mcap"
        server = None if mode == MODES[0] else stack.enter_context(LiveServer(port=0))
        mirror = None if server is None else server.publish
        log = stack.enter_context(LogWriter(path, start_ns, b"{}", {}, "virtual", mirror=mirror))
        received = [0]
        if server is not None and mode in MODES[2:]:
            stack.enter_context(viewer(server.port, received, reads=mode == MODES[2]))
        longest_ns = loop_ns = 0
        process_ns = time.process_time_ns()
        deadline_ns = clock.now_ns()
        for portion in portions:
            begun_ns, thread_ns = clock.now_ns(), time.thread_time_ns()
            for call in portion:
                call(log)
            loop_ns += time.thread_time_ns() - thread_ns
            longest_ns = max(longest_ns, clock.now_ns() - begun_ns)
            deadline_ns += NANOSECONDS_PER_SECOND // RATE_HZ
            clock.sleep_until(deadline_ns)
        process_ns = time.process_time_ns() - process_ns
    return {
        "loop_us": round(loop_ns / 1e3 / len(portions), 1),
        "all_threads_us": round(process_ns / 1e3 / len(portions), 1),
        "longest_ms": round(longest_ns / 1e6, 2),
        "viewer_kb": round(received[0] / 1e3),
    }


@contextmanager
def viewer(port: int, received: list[int], *, reads: bool) -> Iterator[None]:
    """Connect a viewer that asks for every channel, and reads or not; counts the bytes it got."""
    connection = socket.create_connection(("127.0.0.1", port))
    key = base64.b64encode(os.urandom(16)).decode()
    connection.sendall(
        f"GET / HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
        f"Sec-WebSocket-Key: {key}\r\nSec-WebSocket-Version: 13\r\n"
        "Sec-WebSocket-Protocol: foxglove.sdk.v1\r\n\r\n".encode()
    )

    def ask() -> None:
        # Channels appear with their first records.
        SystemClock().sleep_until(SystemClock().now_ns() + NANOSECONDS_PER_SECOND)
        pairs = [{"id": number, "channelId": number} for number in CHANNELS]
        text = json.dumps({"op": "subscribe", "subscriptions": pairs}).encode()
        connection.sendall(bytes([0x81, 0xFE]) + struct.pack(">H", len(text)) + bytes(4) + text)
        while reads:
            data = connection.recv(65536)
            if not data:
                return
            received[0] += len(data)

    thread = threading.Thread(target=_quietly, args=(ask,), daemon=True)
    thread.start()
    try:
        yield
    finally:
        connection.close()


def _quietly(work: object) -> None:
    try:
        if callable(work):
            work()
    except OSError:
        return


if __name__ == "__main__":
    sys.exit(main())
