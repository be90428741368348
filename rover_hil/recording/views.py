"""Repetitions of poses, events, the path and diagnostics in schemas that viewers have panels for."""

import math
from collections.abc import Sequence

from drivers.clock import NANOSECONDS_PER_SECOND
from drivers.driver import DeviceState, Health
from rover_hil.recording.text import strict_json

FRAME = "local"
"""Poses of the estimate: origin and x axis are the rover's pose at start."""
TRUE_FRAME = "world"
WARNING, INFORMATION = 3, 2
"""Levels of `foxglove.Log`."""


_OK, _WARN, _ERROR, _STALE = range(4)
"""Levels of `diagnostic_msgs/DiagnosticStatus`."""
_LEVELS = {DeviceState.STREAMING: _OK, DeviceState.FAILED: _ERROR, DeviceState.CLOSED: _STALE}


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
    return strict_json({"timestamp": timestamp(time_ns), "frame_id": FRAME, "poses": poses})


def log_view(time_ns: int, level: int, name: str, message: str) -> bytes:
    """Return a `foxglove.Log`."""
    return strict_json({"timestamp": timestamp(time_ns), "level": level, "message": message, "name": name})


def diagnostics_view(time_ns: int, healths: Sequence[Health]) -> bytes:
    """Return a `diagnostic_msgs/DiagnosticArray` of the health of all devices.

    Foxglove's panels for diagnostics take this schema of ROS; Foxglove has none of its own.
    """
    status = [
        {
            "level": _LEVELS.get(health.state, _WARN),
            "name": health.device,
            "message": _words(health),
            "hardware_id": health.device,
            "values": [
                {"key": key, "value": value if isinstance(value, str) else f"{value:.6g}"}
                for key, value in _facts(health).items()
            ],
        }
        for health in healths
    ]
    return strict_json({"header": {"stamp": timestamp(time_ns), "frame_id": ""}, "status": status})


def _words(health: Health) -> str:
    return (
        f"{health.state.value}: {health.last_link_reason}" if health.last_link_reason else health.state.value
    )


def _facts(health: Health) -> dict[str, str | float]:
    age_s = {} if health.age_s is None else {"age_s": health.age_s}
    rejected = {f"rejected: {reason}": count for reason, count in health.rejected.items()}
    counts = {"accepted": health.accepted, "breaks": health.breaks, "lost": health.lost}
    return {"rate_hz": health.rate_hz, **age_s, **counts, **rejected, "send_failures": health.send_failures}
