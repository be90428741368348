"""Reads the text of candump and feeds it to a codec."""

from collections.abc import Callable

from drivers.can.frame import CanFrame, pack_can_frame
from drivers.driver import Codec, Rejection
from drivers.link import Received
from drivers.samples import Sample


def feed(
    codec: Codec[bytes], text: str, before: Callable[[int], object] = lambda t_ns: None
) -> list[tuple[float, Sample | Rejection]]:
    """Return what a codec makes of the frames, with the times in s; `before` is called before each."""
    results: list[tuple[float, Sample | Rejection]] = []
    for line in text.splitlines():
        stamp, _, words = line.split()
        number, _, data = words.partition("#")
        t_ns = round(float(stamp.strip("()")) * 1e9)
        before(t_ns)
        frame = CanFrame(int(number, 16), bytes.fromhex(data), is_extended=len(number) == 8)
        results += [(t_ns / 1e9, each) for each in codec.decode(Received(t_ns, pack_can_frame(frame)))]
    return results
