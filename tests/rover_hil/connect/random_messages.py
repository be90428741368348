"""Random ROS messages, by their declarations."""

import string
from typing import Any

import numpy as np

from rover_hil.connect.ros2.messages import FieldType, Message, field_types

RANGES = {
    "byte": (0, 127),
    "uint8": (0, 255),
    "int32": (-(2**31), 2**31 - 1),
    "uint32": (0, 2**32 - 1),
}


def random_message(message: type[Message], rng: np.random.Generator) -> Any:
    """Return a message with random content in every field."""
    return message(**{name: _value(kind, rng) for name, kind in field_types(message).items()})


def _value(kind: FieldType, rng: np.random.Generator) -> Any:
    if kind.is_list:
        size = int(rng.integers(0, 5)) if kind.size is None else kind.size
        values = [_value(FieldType(kind.base), rng) for _ in range(size)]
        return bytes(values) if kind.base == "uint8" else values
    if not isinstance(kind.base, str):
        return random_message(kind.base, rng)
    if kind.base == "string":
        return "".join(rng.choice(list(string.printable + "äß€"), int(rng.integers(0, 12))))
    if kind.base == "bool":
        return bool(rng.integers(0, 2))
    if kind.base in RANGES:
        return int(rng.integers(*RANGES[kind.base], endpoint=True))
    value = float(rng.normal(scale=10.0 ** rng.integers(-9, 9)))
    return float(np.float32(value)) if kind.base == "float32" else value
