"""Frames of the Robotino 3/4 board: AA, length, body, checksum; 16 bits little endian.

Behind AA every AA and 55 is sent as 55 and the byte with its bit 5 inverted, so AA only ever begins a frame.
The checksum makes the sum over length, body and itself zero. It cannot see errors that cancel out, nor
swapped bytes.

Source: openrobotino `common/lib/rec/robotino3/serialio/{Producer,Parser,utils}.cpp`; fawkes
`direct_com_message.cpp`.
"""

from drivers.driver import Rejection

HEAD, ESCAPE, MANGLE = 0xAA, 0x55, 0x20
LARGEST_BODY = 400
"""The board sends less; a damaged length is noticed after at most so many bytes."""

_FRAMING = Rejection("framing")
_CHECKSUM = Rejection("checksum")


def build_frame(body: bytes) -> bytes:
    """Return the frame of a body, escaped."""
    data = len(body).to_bytes(2, "little") + body
    data += (-sum(data) & 0xFFFF).to_bytes(2, "little")
    frame = bytearray((HEAD,))
    for byte in data:
        frame += bytes((ESCAPE, byte ^ MANGLE)) if byte in (HEAD, ESCAPE) else bytes((byte,))
    return bytes(frame)


class FrameScanner:
    """Finds frames in a byte stream; keeps less than one."""

    def __init__(self) -> None:
        self._frame = bytearray()
        self._is_inside = False
        self._is_escaped = False
        self._is_lost = False

    def reset(self) -> None:
        """Forget a half-received frame."""
        self._is_inside = self._is_lost = False

    def feed(self, payload: bytes) -> list[bytes | Rejection]:
        """Return the bodies of the frames that `payload` completes, and one rejection per run of others."""
        frames: list[bytes | Rejection] = []
        for byte in payload:
            if byte == HEAD:
                if self._is_inside:
                    self._lose(frames, _FRAMING)
                self._frame.clear()
                self._is_inside, self._is_escaped = True, False
            elif not self._is_inside:
                self._lose(frames, _FRAMING)
            elif byte == ESCAPE and not self._is_escaped:
                self._is_escaped = True
            else:
                self._frame.append(byte ^ MANGLE if self._is_escaped else byte)
                self._is_escaped = False
                self._check_end(frames)
        return frames

    def _check_end(self, results: list[bytes | Rejection]) -> None:
        frame = self._frame
        size = int.from_bytes(frame[:2], "little")
        if len(frame) == 2 and size > LARGEST_BODY:
            self._lose(results, _FRAMING)
        elif len(frame) >= 4 and len(frame) == size + 4:
            self._is_inside = False
            checksum = int.from_bytes(frame[-2:], "little")
            if (sum(frame[:-2]) + checksum) & 0xFFFF:
                self._lose(results, _CHECKSUM)
            else:
                self._is_lost = False
                results.append(bytes(frame[2:-2]))

    def _lose(self, results: list[bytes | Rejection], reason: Rejection) -> None:
        if not self._is_lost:
            results.append(reason)
        self._is_lost = True
        self._is_inside = False
