"""Stream what goes into a log to viewers, over the Foxglove protocol.

The thread of the log hands each record over; the library sends it from threads of its own, and drops the
oldest for a viewer that does not read. The control loop takes no part in it.
"""

import logging
from types import TracebackType
from typing import Any, Self

from drivers.errors import ConfigError
from rover_hil.recording.json_schema import topic_schema

HOST = "127.0.0.1"
BACKLOG = 512
"""Messages kept for a viewer that does not keep up: a second of a rover at 50 Hz."""


class LiveServer:
    """A server for viewers on this computer; it takes nothing from them.

    Args:
        port: TCP port on 127.0.0.1; 0 chooses a free one.

    Attributes:
        port: The port in use.

    Raises:
        ConfigError: The library is missing, or the port cannot be used.
    """

    def __init__(self, port: int) -> None:
        try:
            import foxglove
            from foxglove import Context
        except ImportError as error:
            raise ConfigError("--live needs foxglove-sdk: `pip install rover-hil[live]`") from error
        # What it complains of is the fault of a viewer, and would fill the terminal of a run.
        logging.getLogger("foxglove").propagate = False
        self._library: Any = foxglove
        self._context = Context()
        self._channels: dict[str, Any] = {}
        try:
            self._server: Any = foxglove.start_server(
                name="rover_hil", host=HOST, port=port, context=self._context, message_backlog_size=BACKLOG
            )
        except Exception as error:
            raise ConfigError(
                f"cannot open port {port} for viewers: {error}; end the program that uses it, "
                "or choose another --live-port"
            ) from error
        self.port: int = self._server.port

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """End the server; may be called again."""
        self._server.stop()

    def publish(self, topic: str, time_ns: int, data: bytes) -> None:
        """Hand a record of a log to the viewers; returns at once.

        Args:
            topic: Of the log.
            time_ns: Since 1970.
            data: JSON.
        """
        channel = self._channels.get(topic)
        if channel is None:
            channel = self._channels[topic] = self._make_channel(topic)
        channel.log(data, log_time=time_ns)

    def _make_channel(self, topic: str) -> Any:
        shape = topic_schema(topic)
        schema = self._library.Schema(name=shape.name, encoding="jsonschema", data=shape.text)
        return self._library.Channel(topic, schema=schema, message_encoding="json", context=self._context)
