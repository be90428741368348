"""The messages as types of DDS, made from their declarations, and back."""

from collections.abc import Callable
from functools import cache
from typing import Any, TypeVar

from cyclonedds.idl import make_idl_struct, types
from cyclonedds.idl.annotations import final

from rover_hil.connect.ros2.messages import FieldType, Message, dds_name, field_types

MessageT = TypeVar("MessageT", bound=Message)
Convert = Callable[[Any], Any]

_PRIMITIVES: dict[str, Any] = {
    "bool": bool,
    "string": str,
    "byte": types.uint8,  # newer ROS declares octets so; the bytes are the same
    "uint8": types.uint8,
    "int32": types.int32,
    "uint32": types.uint32,
    "float32": types.float32,
    "float64": types.float64,
}


@cache
def dds_type(message: type[Message]) -> Any:
    """Return the type of DDS of a message; its fields are final, without keys."""
    fields = {name: _dds_field(kind) for name, kind in field_types(message).items()}
    typename = dds_name(message.ros_type).replace("::", ".")
    return final(make_idl_struct(f"{message.__name__}_", typename, fields))


def _dds_field(kind: FieldType) -> Any:
    item = _PRIMITIVES[kind.base] if isinstance(kind.base, str) else dds_type(kind.base)
    if not kind.is_list:
        return item
    return types.sequence[item] if kind.size is None else types.array[item, kind.size]


@cache
def to_dds(message: type[Message]) -> Convert:
    """Return a function from a message to its DDS type."""
    made = dds_type(message)
    parts = [(name, _item(kind, to_dds)) for name, kind in field_types(message).items()]
    return lambda value: made(**{name: convert(getattr(value, name)) for name, convert in parts})


@cache
def from_dds(message: type[MessageT]) -> Callable[[Any], MessageT]:
    """Return a function from the DDS type of a message to the message."""
    parts = [(name, _item(kind, from_dds)) for name, kind in field_types(message).items()]
    return lambda value: message(**{name: convert(getattr(value, name)) for name, convert in parts})


def _item(kind: FieldType, convert_part: Callable[[type[Message]], Convert]) -> Convert:
    if isinstance(kind.base, str):
        return list if kind.is_list else lambda value: value
    part = convert_part(kind.base)
    return (lambda values: [part(value) for value in values]) if kind.is_list else part
