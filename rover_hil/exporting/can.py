"""Write the frames of a log for other programs that read CAN buses."""

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import can

from drivers.can.frame import unpack_can_frame
from drivers.clock import NANOSECONDS_PER_SECOND
from drivers.device_settings import CanDeviceSettings
from drivers.errors import ConfigError, LogError
from rover_hil.config import Config
from rover_hil.recording.reader import LogMessage, LogReader
from rover_hil.recording.schema import RAW, SENT

WRITERS: Mapping[str, Callable[[str], Any]] = {
    ".log": can.CanutilsLogWriter,
    ".asc": can.ASCWriter,
    ".blf": can.BLFWriter,
    ".trc": can.TRCWriter,
}
"""By the ending of the file's name."""


def check_name(path: Path) -> None:
    """Check that a file's name ends as one of the formats.

    Raises:
        ConfigError: It does not.
    """
    if path.suffix.lower() not in WRITERS:
        raise ConfigError(
            f"{path}: --can writes {', '.join(WRITERS)}: name a file with such an ending with --out"
        )


def write_can(
    log: LogReader, config: Config, path: Path, on_message: Callable[[], None] = lambda: None
) -> Mapping[str, int]:
    """Write what the devices on CAN buses received and were sent, with its own times; return the counts.

    Args:
        log: The log.
        config: Its configuration.
        path: The file; its ending chooses the format.
        on_message: Called after each message, to show progress.

    Raises:
        LogError: The log is damaged, or has no device on a CAN bus.
    """
    channels = _channels(config)
    if not channels:
        raise LogError(f"log {log.path} has no device on a CAN bus: nothing can be written")
    counts: dict[str, int] = {}
    with WRITERS[path.suffix.lower()](str(path)) as writer:
        if isinstance(writer, can.TRCWriter):
            writer.filepath = path.name  # it would be a temporary one
        for message in _frames(log, channels, counts, on_message):
            writer.on_message_received(message)
    return counts


def _channels(config: Config) -> dict[str, str]:
    """Return the bus that each device is the first one on."""
    channels: dict[tuple[str, str], str] = {}
    for name, device in config.devices.items():
        if isinstance(device, CanDeviceSettings):
            channels.setdefault((device.interface, device.channel), name)
    return {name: f"can{number}" for number, name in enumerate(channels.values())}


def _frames(
    log: LogReader, channels: Mapping[str, str], counts: dict[str, int], on_message: Callable[[], None]
) -> Iterator[can.Message]:
    for message in log.messages():
        on_message()
        frame = _frame_of(log, message, channels)
        if frame is not None:
            counts[str(frame.channel)] = counts.get(str(frame.channel), 0) + 1
            yield frame


def _frame_of(log: LogReader, message: LogMessage, channels: Mapping[str, str]) -> can.Message | None:
    topic = next((topic for topic in (RAW, SENT) if message.topic.startswith(topic)), None)
    channel = None if topic is None else channels.get(message.topic.removeprefix(topic))
    frame = None if channel is None else unpack_can_frame(message.data)
    if frame is None:
        return None
    return can.Message(
        timestamp=(log.wall_offset_ns + message.t_ns) / NANOSECONDS_PER_SECOND,
        arbitration_id=frame.can_id,
        data=frame.data,
        dlc=len(frame.data),
        is_extended_id=frame.is_extended,
        is_remote_frame=frame.is_remote,
        is_error_frame=frame.is_error,
        is_rx=topic == RAW,
        channel=channel,
    )
