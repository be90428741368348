"""A viewer of the Foxglove protocol: handshake of a web socket, subscription, messages."""

import base64
import json
import os
import socket
import struct
from typing import Any


class Viewer:
    """A viewer on this computer, without any library."""

    def __init__(self, port: int) -> None:
        self._socket = socket.create_connection(("127.0.0.1", port), timeout=20)
        key = base64.b64encode(os.urandom(16)).decode()
        self._socket.sendall(
            f"GET / HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
            f"Sec-WebSocket-Key: {key}\r\nSec-WebSocket-Version: 13\r\n"
            "Sec-WebSocket-Protocol: foxglove.sdk.v1\r\n\r\n".encode()
        )
        self._data = b""
        self._subscribed: dict[int, int] = {}
        while b"\r\n\r\n" not in self._data:
            self._data += self._receive()
        head, _, self._data = self._data.partition(b"\r\n\r\n")
        assert head.startswith(b"HTTP/1.1 101"), head

    def close(self) -> None:
        self._socket.close()

    def subscribe(self, channels: dict[int, int]) -> None:
        """Subscribe to channels: subscription by channel."""
        self._subscribed = channels
        pairs = [{"id": number, "channelId": channel} for channel, number in channels.items()]
        self._send(json.dumps({"op": "subscribe", "subscriptions": pairs}).encode())

    def read(self) -> dict[str, Any] | tuple[int, int, bytes]:
        """Return what the server announces, or a message: subscription, time in ns, data."""
        kind, payload = self._frame()
        while kind not in (1, 2):
            kind, payload = self._frame()
        if kind == 1:
            told: dict[str, Any] = json.loads(payload)
            # The server announces a channel a moment before it accepts a subscription to it.
            if told["op"] == "status" and told["message"].startswith("Unknown channel ID"):
                self.subscribe(self._subscribed)
            return told
        subscription, time_ns = struct.unpack_from("<IQ", payload, 1)
        return subscription, time_ns, payload[13:]

    def _frame(self) -> tuple[int, bytes]:
        first, second = self._take(2)
        length = second & 127
        if length == 126:
            (length,) = struct.unpack(">H", self._take(2))
        elif length == 127:
            (length,) = struct.unpack(">Q", self._take(8))
        return first & 15, self._take(length)

    def _take(self, count: int) -> bytes:
        while len(self._data) < count:
            self._data += self._receive()
        taken, self._data = self._data[:count], self._data[count:]
        return taken

    def _receive(self) -> bytes:
        data = self._socket.recv(65536)
        assert data, "the server closed the connection"
        return data

    def _send(self, payload: bytes) -> None:
        assert len(payload) < 65536
        mask = os.urandom(4)
        head = bytes([0x81, 0x80 | 126]) + struct.pack(">H", len(payload)) + mask
        self._socket.sendall(head + bytes(byte ^ mask[i % 4] for i, byte in enumerate(payload)))
