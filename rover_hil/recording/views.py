"""Repetitions of poses, events and the path in Foxglove's own schemas, for its 3D and log panels."""

import math
from collections.abc import Sequence

from pydantic_core import to_json

from drivers.clock import NANOSECONDS_PER_SECOND

FRAME = "local"
"""Poses of the estimate: origin and x axis are the rover's pose at start."""
TRUE_FRAME = "world"
WARNING, INFORMATION = 3, 2
"""Levels of `foxglove.Log`."""


def timestamp(time_ns: int) -> dict[str, int]:
    """Return a time since 1970 as Foxglove's schemas have it."""
    seconds, nanoseconds = divmod(time_ns, NANOSECONDS_PER_SECOND)
    return {"sec": seconds, "nsec": nanoseconds}


def pose_view(time_ns: int, frame: str, x_m: float, y_m: float, yaw_rad: float) -> bytes:
    """Return a `foxglove.PoseInFrame` of a pose on the plane."""
    seconds, nanoseconds = divmod(time_ns, NANOSECONDS_PER_SECOND)
    return (
        f'{{"timestamp":{{"sec":{seconds},"nsec":{nanoseconds}}},"frame_id":"{frame}","pose":{{'
        f'"position":{{"x":{x_m:.4f},"y":{y_m:.4f},"z":0}},'
        f'"orientation":{{"x":0,"y":0,"z":{math.sin(yaw_rad / 2):.5f},"w":{math.cos(yaw_rad / 2):.5f}}}}}}}'
    ).encode()


def path_view(time_ns: int, points_m: Sequence[tuple[float, float]]) -> bytes:
    """Return a `foxglove.PosesInFrame` of the corners of a planned path."""
    poses = [
        {"position": {"x": x_m, "y": y_m, "z": 0}, "orientation": {"x": 0, "y": 0, "z": 0, "w": 1}}
        for x_m, y_m in points_m
    ]
    return to_json({"timestamp": timestamp(time_ns), "frame_id": FRAME, "poses": poses})


def log_view(time_ns: int, level: int, name: str, message: str) -> bytes:
    """Return a `foxglove.Log`."""
    return to_json({"timestamp": timestamp(time_ns), "level": level, "message": message, "name": name})
