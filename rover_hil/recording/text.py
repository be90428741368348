"""JSON text of the records that every cycle writes, and the JSON schema of every record.

Both follow the declarations in `schema.py` and `drivers/samples.py`. One format string per record is faster
than a mapping that is serialised, and rounds: digits beyond the resolution of every sensor would be two
thirds of a compressed log. What a replay compares stays exact by a checksum in `/estimate`.
"""

import re
import struct
import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields, is_dataclass
from functools import cache, lru_cache
from operator import attrgetter
from types import NoneType, UnionType
from typing import TypeAlias, Union, get_args, get_origin

from pydantic_core import to_json
from typing_extensions import get_type_hints, is_typeddict

from controllers.control_loop import StepOutput
from drivers.samples import FrameSample, Sample, SentCommand
from rover_hil.recording.schema import (
    EstimateRecord,
    SourceCheckRecord,
    TruthRecord,
    frame_record,
    set_point_record,
)

Encode: TypeAlias = Callable[[object], str]

DECIMALS = "%.7f"
"""Of estimates and truth: 0.1 um, 0.1 urad."""
SAMPLE_DECIMALS = "%.9f"
"""Of measurements: below the smallest step of every sensor."""
VARIANCE_DIGITS = "%.6g"
VARIANCES = frozenset({"covariance", "variance", "nis"})
"""Numbers far below 1, of which the relative size counts."""
ATTRIBUTES = {"drift": "scomp"}
"""Attribute of the controller behind a key, where the two have different names."""
ONLY_WRITTEN = frozenset({"checks", "exact", "is_ground_contradicted", "is_new", "waits_for_operator"})
"""Keys that the source of a record has no attribute for, or that are written only where they are known."""
EXACT = struct.Struct("<16d")

_TRUTH_VALUES = {True: "true", False: "false"}


@lru_cache(maxsize=1024)
def quoted(text: str) -> str:
    """Return a text as JSON."""
    return to_json(text).decode()


def estimate_text(output: StepOutput) -> bytes:
    """Return the record of a cycle, its numbers rounded, and a checksum over the estimate's exact ones."""
    pose, odometry = output.estimate, output.odometry
    exact = zlib.crc32(
        EXACT.pack(
            pose.x_m,
            pose.y_m,
            pose.yaw_rad,
            pose.velocity_x_m_s,
            pose.velocity_y_m_s,
            pose.yaw_rate_rad_s,
            pose.gyro_bias_rad_s,
            odometry.x_m,
            odometry.y_m,
            odometry.yaw_rad,
            *pose.covariance,
        )
    )
    waits = ',"waits_for_operator":true' if output.waits_for_operator else ""
    contradicted = ',"is_ground_contradicted":true' if output.is_ground_contradicted else ""
    checks = "" if output.checks is None else f',"checks":[{",".join(map(_source_check, output.checks))}]'
    return _finite(f'{_estimate(output)[:-1]}{waits}{contradicted}{checks},"exact":"{exact:08x}"}}')


def truth_text(truth: object) -> bytes:
    """Return the record of the true state of a simulated rover, its numbers rounded."""
    return _finite(_truth(truth))


def samples_text(samples: Sequence[Sample]) -> bytes:
    """Return samples grouped by kind; of a camera frame only what surrounds the pixels; b"" for none."""
    if not samples:
        return b""
    grouped: dict[str, list[str]] = {}
    for sample in samples:
        kind = type(sample)
        text = (
            strict_json(frame_record(sample)).decode()
            if isinstance(sample, FrameSample)
            else _sample_encoder(kind)(sample)
        )
        grouped.setdefault(kind.__name__, []).append(text)
    lists = [f'"{kind}":[{",".join(texts)}]' for kind, texts in grouped.items()]
    return _finite("{" + ",".join(lists) + "}")


def command_text(sent: SentCommand) -> bytes:
    """Return the record of the setpoints sent, with all digits."""
    return strict_json(set_point_record(sent))


_NOT_FINITE = re.compile(r"(?<=[:,\[])(-?)(nan|inf)(?=[,\]}])")


def _finite(text: str) -> bytes:
    """Return the text in UTF-8; numbers that are not finite as null, as JSON has none."""
    if "nan" in text or "inf" in text:
        text = _NOT_FINITE.sub("null", text)
    return text.encode()


def strict_json(record: object, indent: int | None = None) -> bytes:
    """Return a record as JSON; numbers that are not finite as null, as JSON has none."""
    return to_json(record, indent=indent, inf_nan_mode="null")


def _encoder(kind: object, number: str) -> tuple[str, Encode | None]:
    """Return a format code for values of a type, and what converts them before, or None."""
    if kind is int:
        return "%d", None
    if kind is float:
        return number, None
    if kind is bool:
        return "%s", _TRUTH_VALUES.__getitem__  # type: ignore[return-value]
    if isinstance(kind, type) and issubclass(kind, str):
        return "%s", quoted
    if get_origin(kind) in (Union, UnionType):
        (inner,) = (option for option in get_args(kind) if option is not NoneType)
        return "%s", _optional(*_encoder(inner, number))
    if get_origin(kind) is tuple:
        return "%s", _sequence(*_encoder(get_args(kind)[0], number))
    if is_typeddict(kind) or is_dataclass(kind):
        return "%s", _record(kind, number)
    raise TypeError(f"{kind} has no text")


def _optional(code: str, convert: Encode | None) -> Encode:
    if convert is None:
        return lambda value: "null" if value is None else code % value
    return lambda value: "null" if value is None else convert(value)


def _sequence(code: str, convert: Encode | None) -> Encode:
    @cache
    def pattern(length: int) -> str:
        return "[" + ",".join([code] * length) + "]"

    def encode(values: object) -> str:
        assert isinstance(values, tuple | list)  # noqa: S101 - for the type checker
        items = tuple(values) if convert is None else tuple(map(convert, values))
        return pattern(len(items)) % items

    return encode


def _record(shape: object, number: str) -> Encode:
    """Return a function that writes an object whose attributes are named as the keys of a record."""
    kinds = _kinds(shape)
    codes, converters = [], []
    for index, (name, kind) in enumerate(kinds.items()):
        code, convert = _encoder(kind, VARIANCE_DIGITS if name in VARIANCES else number)
        codes.append(f'"{name}":{code}')
        if convert is not None:
            converters.append((index, convert))
    pattern = "{" + ",".join(codes) + "}"
    read = attrgetter(*(ATTRIBUTES.get(name, name) for name in kinds))

    def encode(source: object) -> str:
        values = list(read(source))
        for index, convert in converters:
            values[index] = convert(values[index])
        return pattern % tuple(values)

    return encode


def _kinds(shape: object) -> Mapping[str, object]:
    hints = get_type_hints(shape)
    names = [field.name for field in fields(shape)] if is_dataclass(shape) else list(hints)
    return {name: hints[name] for name in names if name not in ONLY_WRITTEN}


_sample_encoders: dict[str, Encode] = {}


def _sample_encoder(kind: type[Sample]) -> Encode:
    encoder = _sample_encoders.get(kind.__name__)
    if encoder is None:
        encoder = _sample_encoders[kind.__name__] = _record(kind, SAMPLE_DECIMALS)
    return encoder


_estimate = _record(EstimateRecord, DECIMALS)
_source_check = _record(SourceCheckRecord, DECIMALS)
_truth = _record(TruthRecord, DECIMALS)
