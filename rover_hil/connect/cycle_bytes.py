"""A cycle as bytes, from the loop to those who make records of it.

The loop rests between two cycles, and other programs use the caches meanwhile: what costs time is how much
code and memory are touched, not how many bytes are made. So attributes are read by name, numbers are packed
at once, and what seldom changes goes as text, only when it has changed.
"""

import json
import math
import struct
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from typing import Any, NamedTuple, cast

from pydantic_core import to_json

from controllers.control_loop import StepOutput
from drivers.samples import AccelerationSample, PowerSample, RateSample, Sample, WheelSample
from rover_hil.config import Config
from rover_hil.recording.schema import EstimateRecord, health_record
from rover_hil.run.executive import CycleView

POSE = ("x_m", "y_m", "yaw_rad")
VELOCITY = ("velocity_x_m_s", "velocity_y_m_s", "yaw_rate_rad_s")
_HEAD = struct.Struct("<IH")
"""Bytes of text, and how many numbers there are beside those that every cycle has."""
_TIMES = 3
_NUMBERS = 15
"""Of every cycle: pose, velocity, covariance, and the pose of the wheels alone."""
_SAMPLE = struct.Struct("<Bq3d")
_SAMPLE_VALUES = 5
_NAN = math.nan


WHEEL, RATE, FORCE, POWER = range(4)
"""Kinds of samples. Their numbers: index, position in rad and speed in rad/s of a wheel; rates in rad/s and
specific force in m/s2 of the gyro's device; voltage in V and current in A of the supply. NaN for none."""


class SampleFacts(NamedTuple):
    """A sample of one of the kinds above."""

    kind: int
    t_ns: int
    values: Sequence[float]


class CycleFacts(NamedTuple):
    """What was handed over of a cycle.

    Attributes:
        offset_ns: Real minus simulated time; 0 for a real rover.
        cycle: The record of what it computed, as in a log, as far as it was handed over.
        samples: What was measured.
        healths: Of all devices.
        extra: Further facts about the run by their names.
    """

    offset_ns: int
    cycle: EstimateRecord
    samples: Sequence[SampleFacts]
    healths: Sequence[Mapping[str, Any]]
    extra: Mapping[str, object]


class CyclePacker:
    """Makes bytes of the cycles of a run.

    Args:
        config: The rover.
    """

    def __init__(self, config: Config) -> None:
        self._wheels, self._gyro = config.roles.wheels, config.roles.gyro
        self._told: object = None

    def pack(self, view: CycleView, offset_ns: int, extra: Mapping[str, object]) -> bytes:
        """Return a cycle.

        Args:
            view: The cycle.
            offset_ns: Real minus simulated time; 0 for a real rover.
            extra: Further facts about the run by their names; another object where they have changed.
        """
        output = view.output
        pose, wheels_alone = output.estimate, output.odometry
        numbers, reasons = _parts(output)
        samples = self._samples(view.samples)
        words = b""
        texts = (output.mode, output.reason, output.suspicion, pose.yaw_source, reasons)
        told = (*texts, output.is_ground_contradicted, view.healths, extra)
        if told != self._told:
            self._told = told
            words = to_json((*told[:6], list(map(health_record, view.healths)), extra), inf_nan_mode="null")
        layout = _layout(len(numbers), len(samples) // _SAMPLE_VALUES)
        packed = layout.pack(
            len(words),
            len(numbers),
            offset_ns,
            output.t_ns,
            pose.t_ns,
            pose.x_m,
            pose.y_m,
            pose.yaw_rad,
            pose.velocity_x_m_s,
            pose.velocity_y_m_s,
            pose.yaw_rate_rad_s,
            *pose.covariance,
            wheels_alone.x_m,
            wheels_alone.y_m,
            wheels_alone.yaw_rad,
            *numbers,
            *samples,
        )
        return packed + words

    def forget(self) -> None:
        """Hand over all text with the next cycle: the last one was lost."""
        self._told = None

    def _samples(self, samples: Sequence[Sample]) -> list[float]:
        """Return kind, time and numbers of each sample."""
        numbers: list[float] = []
        for sample in samples:
            if type(sample) is WheelSample:
                if sample.device == self._wheels:
                    position_rad, speed_rad_s = _or_nan(sample.position_rad), _or_nan(sample.speed_rad_s)
                    numbers += WHEEL, sample.t_ns, sample.wheel, position_rad, speed_rad_s
            elif type(sample) is RateSample:
                if sample.device == self._gyro:
                    x, y = _or_nan(sample.rate_x_rad_s), _or_nan(sample.rate_y_rad_s)
                    numbers += RATE, sample.t_ns, x, y, sample.rate_z_rad_s
            elif type(sample) is AccelerationSample:
                if sample.device == self._gyro:
                    numbers += FORCE, sample.t_ns, sample.x_m_s2, sample.y_m_s2, sample.z_m_s2
            elif type(sample) is PowerSample:
                numbers += POWER, sample.t_ns, sample.voltage_v, _or_nan(sample.current_a), _NAN
        return numbers


@cache
def _layout(numbers: int, samples: int) -> struct.Struct:
    return struct.Struct(f"{_HEAD.format}{_TIMES}q{_NUMBERS + numbers}d{samples * _SAMPLE.format[1:]}")


class CycleUnpacker:
    """Takes cycles from bytes, in the order in which they were made."""

    def __init__(self) -> None:
        self._told: Sequence[Any] = ()

    def unpack(self, data: bytes) -> CycleFacts:
        """Return the cycle."""
        text_bytes, number_count = _HEAD.unpack_from(data)
        text_begin = len(data) - text_bytes
        sample_count = (text_begin - _layout(number_count, 0).size) // _SAMPLE.size
        _, _, offset_ns, t_ns, pose_ns, *values = _layout(number_count, sample_count).unpack_from(data)
        known, numbers = values[:_NUMBERS], iter(values[_NUMBERS : _NUMBERS + number_count])
        after_numbers = values[_NUMBERS + number_count :]
        samples = [
            SampleFacts(after_numbers[at], after_numbers[at + 1], after_numbers[at + 2 : at + _SAMPLE_VALUES])
            for at in range(0, len(after_numbers), _SAMPLE_VALUES)
        ]
        if text_bytes:
            self._told = json.loads(data[text_begin:])
        mode, reason, suspicion, yaw_source, reasons, is_contradicted, healths, extra = self._told
        cycle = {
            "t_ns": t_ns,
            "mode": mode,
            "reason": reason,
            "suspicion": suspicion,
            "is_ground_contradicted": is_contradicted,
            "estimate": {
                "t_ns": pose_ns,
                **_pose(known[:3]),
                **dict(zip(VELOCITY, known[3:6], strict=True)),
                "covariance": tuple(known[6:12]),
                "yaw_source": yaw_source,
            },
            "odometry": _pose(known[12:15]),
            **_named_parts(numbers, reasons),
        }
        return CycleFacts(offset_ns, cast(EstimateRecord, cycle), samples, healths, extra)


def _parts(output: StepOutput) -> tuple[list[float], Sequence[Any]]:
    """Return the numbers of what not every cycle has, and what says which of them are there, and why not."""
    ground, slip, drift = output.ground, output.slip, output.scomp
    reckoned, steering_rad = output.dead_reckoned, output.steering_rad
    numbers: list[float] = []
    ground_reason = rover_reason = wheel_reasons = drift_reason = None
    if ground is not None:
        ground_reason = ground.reason
        numbers += _or_nan(ground.slip), _or_nan(ground.slip_sd)
    if slip is not None and slip.rover is not None:
        rover_reason = slip.rover.reason
        numbers += slip.rover.slip, slip.rover.sd
    elif slip is not None:
        wheel_reasons = tuple((wheel.valid, wheel.reason) for wheel in slip.wheels)
        numbers += (wheel.slip for wheel in slip.wheels)
    if drift is not None:
        drift_reason = drift.reason
        numbers.append(drift.slip)
    if reckoned is not None:
        numbers += (reckoned.x_m, reckoned.y_m, reckoned.yaw_rad, *reckoned.covariance)
    numbers += steering_rad or ()
    steered = None if steering_rad is None else len(steering_rad)
    return numbers, (ground_reason, rover_reason, wheel_reasons, drift_reason, reckoned is not None, steered)


def _named_parts(numbers: Iterator[float], reasons: Sequence[Any]) -> Mapping[str, Any]:
    ground_reason, rover_reason, wheel_reasons, drift_reason, is_reckoned, steered = reasons
    parts: dict[str, Any] = dict.fromkeys(("ground", "slip", "drift", "dead_reckoned", "steering_rad"))
    if ground_reason is not None:
        slip, sd = or_none(next(numbers)), or_none(next(numbers))
        parts["ground"] = {"slip": slip, "slip_sd": sd, "reason": ground_reason}
    if rover_reason is not None:
        rover = {"slip": next(numbers), "sd": next(numbers), "reason": rover_reason}
        parts["slip"] = {"rover": rover, "wheels": []}
    elif wheel_reasons is not None:
        wheels = [{"slip": next(numbers), "valid": valid, "reason": why} for valid, why in wheel_reasons]
        parts["slip"] = {"rover": None, "wheels": wheels}
    if drift_reason is not None:
        parts["drift"] = {"slip": next(numbers), "reason": drift_reason}
    if is_reckoned:
        pose = _pose([next(numbers) for _ in range(3)])
        parts["dead_reckoned"] = {**pose, "covariance": tuple(next(numbers) for _ in range(6))}
    if steered is not None:
        parts["steering_rad"] = [next(numbers) for _ in range(steered)]
    return parts


def _pose(values: Sequence[float]) -> dict[str, float]:
    return dict(zip(POSE, values, strict=True))


def _or_nan(value: float | None) -> float:
    return _NAN if value is None else value


def or_none(value: float) -> float | None:
    """Return a number of a sample; None for one that was not measured."""
    return None if math.isnan(value) else value
