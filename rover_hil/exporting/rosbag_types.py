"""The messages of the program as those of the library rosbags."""

from typing import Any

import numpy as np

from rover_hil.connect.ros2.messages import FieldType, Message, field_types


def to_rosbags(message: Message, types: Any) -> Any:
    """Return a message of a type store of rosbags.

    Args:
        message: The message.
        types: The `types` of the store.
    """
    values = {
        name: _value(getattr(message, name), kind, types) for name, kind in field_types(type(message)).items()
    }
    return types[message.ros_type](**values)


def _value(value: Any, kind: FieldType, types: Any) -> Any:
    if not isinstance(kind.base, str):
        return [to_rosbags(item, types) for item in value] if kind.is_list else to_rosbags(value, types)
    if not kind.is_list:
        return value
    if isinstance(value, bytes):
        return np.frombuffer(value, np.uint8)
    return list(value) if kind.base == "string" else np.array(value, kind.base)
