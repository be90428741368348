"""JSON schema of every topic, in the simple form that Foxglove and PlotJuggler understand.

Each property has one type, and shapes are repeated instead of referred to: neither program reads `$ref` or
`anyOf`. A value that may be missing has the type that it has when it is there.
"""

from collections.abc import Mapping
from dataclasses import is_dataclass
from enum import Enum
from functools import cache
from types import NoneType, UnionType
from typing import Literal, NamedTuple, Union, get_args, get_origin

from pydantic_core import to_json
from typing_extensions import get_type_hints, is_typeddict

from drivers import samples
from drivers.link import LinkChange
from rover_hil.recording import schema

OBJECT: dict[str, object] = {"type": "object"}

_SIMPLE: dict[object, str] = {
    bool: "boolean",
    int: "integer",
    float: "number",
    str: "string",
    object: "object",
}


class TopicSchema(NamedTuple):
    """Name of a schema, and its JSON text."""

    name: str
    text: bytes


def _schema_of(kind: object) -> dict[str, object]:
    """Return the schema of values of a type.

    Raises:
        TypeError: The type has none.
    """
    if kind in _SIMPLE:
        return {"type": _SIMPLE[kind]}
    origin, options = get_origin(kind), [item for item in get_args(kind) if item is not NoneType]
    if origin in (Union, UnionType):
        return _schema_of(options[0])
    if origin is Literal or (isinstance(kind, type) and issubclass(kind, Enum)):
        return {"type": "string"}
    if origin in (tuple, list):
        return {"type": "array", "items": _schema_of(options[0])}
    if isinstance(origin, type) and issubclass(origin, Mapping):
        return {"type": "object"}
    if is_typeddict(kind) or is_dataclass(kind):
        return {
            "type": "object",
            "properties": {
                name: _with_unit(name, _schema_of(inner)) for name, inner in get_type_hints(kind).items()
            },
        }
    raise TypeError(f"{kind} has no JSON schema")


_UNITS = {
    "_rad_s": "rad/s",
    "_m_s": "m/s",
    "_m_s2": "m/s2",
    "_ns": "ns",
    "_hz": "Hz",
    "_nm": "N m",
    "_rad": "rad",
    "_s": "s",
    "_m": "m",
    "_a": "A",
    "_v": "V",
}


def unit_of(name: str) -> str:
    """Return the unit in a name, "" where it has none."""
    return next((unit for suffix, unit in _UNITS.items() if name.endswith(suffix)), "")


def _with_unit(name: str, shape: dict[str, object]) -> dict[str, object]:
    unit = unit_of(name)
    return {**shape, "description": unit} if unit else shape


_SAMPLES = {
    kind.__name__: {"type": "array", "items": _schema_of(kind)}
    for kind in vars(samples).values()
    if isinstance(kind, type) and issubclass(kind, samples.Sample) and kind is not samples.FrameSample
}
_FRAME = {
    "device": {"type": "string"},
    "t_ns": {"type": "integer"},
    "t_capture_ns": {"type": "integer"},
    "index": {"type": "integer"},
    "shape": {"type": "array", "items": {"type": "integer"}},
}
_TIME = {"type": "object", "properties": {"sec": {"type": "integer"}, "nsec": {"type": "integer"}}}
_NUMBER = {"type": "number"}
_TEXT = {"type": "string"}


def _object(**properties: object) -> dict[str, object]:
    return {"type": "object", "properties": properties}


_POSE = _object(
    position=_object(x=_NUMBER, y=_NUMBER, z=_NUMBER),
    orientation=_object(x=_NUMBER, y=_NUMBER, z=_NUMBER, w=_NUMBER),
)
_LIST_OF_TEXTS = {"type": "array", "items": _object(key=_TEXT, value=_TEXT)}
VIEWER_SCHEMAS = {
    "foxglove.CompressedImage": _object(
        timestamp=_TIME,
        frame_id=_TEXT,
        data={"type": "string", "contentEncoding": "base64"},
        format=_TEXT,
        t_capture_ns={"type": "integer"},
    ),
    "foxglove.PoseInFrame": _object(timestamp=_TIME, frame_id=_TEXT, pose=_POSE),
    "foxglove.PosesInFrame": _object(
        timestamp=_TIME, frame_id=_TEXT, poses={"type": "array", "items": _POSE}
    ),
    "foxglove.Log": _object(timestamp=_TIME, level={"type": "integer"}, message=_TEXT, name=_TEXT),
    "diagnostic_msgs/DiagnosticArray": _object(
        header=_object(stamp=_TIME, frame_id=_TEXT),
        status={
            "type": "array",
            "items": _object(
                level={"type": "integer"}, name=_TEXT, message=_TEXT, hardware_id=_TEXT, values=_LIST_OF_TEXTS
            ),
        },
    ),
}
"""Schemas that viewers know: https://docs.foxglove.dev/docs/sdk/schemas, and for diagnostics that of ROS."""

_TOPICS: dict[str, object] = {
    schema.ESTIMATE: schema.EstimateRecord,
    schema.COMMAND: schema.SetPointRecord,
    schema.SET_POINT: schema.SetPointRecord,
    schema.TRUTH: schema.TruthRecord,
    schema.CYCLE: schema.CycleRecord,
    schema.END: schema.EndRecord,
    schema.IMPORT: schema.ImportRecord,
    schema.OPERATOR: schema.OperatorRecord,
    schema.HEALTH: schema.HealthRecord,
    schema.BYTES: schema.BytesRecord,
    schema.WATCHDOG: schema.WatchdogRecord,
}


@cache
def topic_schema(topic: str) -> TopicSchema:
    """Return the schema of a topic; that of any object for a topic of no known shape."""
    if topic == schema.SAMPLES:
        table = {"FrameSample": {"type": "array", "items": {"type": "object", "properties": _FRAME}}}
        return _named("rover_hil.Samples", {"type": "object", "properties": {**_SAMPLES, **table}})
    if topic.startswith(schema.LINK):
        return _named("rover_hil.LinkChange", _schema_of(LinkChange))
    if topic.startswith(schema.CAMERA):
        return viewer_schema("foxglove.CompressedImage")
    if topic in VIEWS:
        return viewer_schema(VIEWS[topic])
    if topic not in _TOPICS:
        return _named("rover_hil.Object", OBJECT)
    kind = _TOPICS[topic]
    return _named(f"rover_hil.{getattr(kind, '__name__', '').removesuffix('Record')}", _schema_of(kind))


VIEWS = {
    schema.VIEW_POSE: "foxglove.PoseInFrame",
    schema.VIEW_TRUE_POSE: "foxglove.PoseInFrame",
    schema.VIEW_PATH: "foxglove.PosesInFrame",
    schema.VIEW_LOG: "foxglove.Log",
    schema.VIEW_DIAGNOSTICS: "diagnostic_msgs/DiagnosticArray",
}


def viewer_schema(name: str) -> TopicSchema:
    """Return a schema that viewers know."""
    return _named(name, VIEWER_SCHEMAS[name])


def _named(name: str, shape: dict[str, object]) -> TopicSchema:
    return TopicSchema(name, to_json({"title": name, **shape}))
