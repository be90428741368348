"""What the loop hands over of a cycle to those who make records of it: plain values."""

import json
from collections.abc import Callable, Mapping, Sequence
from operator import attrgetter
from typing import Any, NamedTuple, TypeAlias, cast

from pydantic_core import to_json

from controllers.control_loop import StepOutput
from drivers.driver import Health
from drivers.samples import AccelerationSample, PowerSample, RateSample, Sample, WheelSample
from rover_hil.recording.schema import EstimateRecord
from rover_hil.run.executive import CycleView

Values: TypeAlias = Sequence[Any]
Get: TypeAlias = Callable[[object], Values]

POSE = ("x_m", "y_m", "yaw_rad")
VELOCITY = ("velocity_x_m_s", "velocity_y_m_s", "yaw_rate_rad_s")
ESTIMATE = ("t_ns", *POSE, *VELOCITY, "covariance", "yaw_source")
CYCLE = ("t_ns", "mode", "reason", "suspicion", "steering_rad")
DEAD_RECKONED = (*POSE, "covariance")
GROUND = ("slip", "slip_sd", "reason")
ROVER_SLIP = ("slip", "sd", "reason")
WHEEL_SLIP = ("slip", "valid", "reason")
DRIFT = ("slip", "reason")
HEALTH = ("device", "state", "rate_hz", "age_s", "accepted", "lost", "breaks", "last_link_reason")
"""Followed by how often wire data was rejected."""
SAMPLES: Mapping[type[Sample], tuple[str, ...]] = {
    WheelSample: ("t_ns", "device", "wheel", "position_rad", "speed_rad_s"),
    AccelerationSample: ("t_ns", "device", "x_m_s2", "y_m_s2", "z_m_s2"),
    RateSample: ("t_ns", "device", "rate_x_rad_s", "rate_y_rad_s", "rate_z_rad_s"),
    PowerSample: ("t_ns", "voltage_v", "current_a"),
}
"""The fields of samples that are handed over; other kinds are not."""


class CycleFacts(NamedTuple):
    """A cycle in plain values, in the order of the names above.

    Attributes:
        offset_ns: Real minus simulated time; 0 for a real rover.
        cycle: Time, mode and reasons.
        pose: Of the estimate, then that of the wheels alone.
        parts: Ground motion, slip of the rover, of each wheel, drift, dead reckoning; None for none.
        samples: Name of the kind of each, and its values.
        healths: Of all devices; None where nothing has changed.
        extra: Further facts about the run by their names.
    """

    offset_ns: int
    cycle: Values
    pose: Values
    parts: Values
    samples: Sequence[tuple[str, Values]]
    healths: Sequence[Values] | None
    extra: Mapping[str, object]


def _getter(names: Sequence[str]) -> Get:
    """Return what reads attributes; members of an enumeration are read as text."""
    members = {"mode", "state", "yaw_source"}
    return cast(Get, attrgetter(*(f"{name}.value" if name in members else name for name in names)))


_cycle, _health = _getter(CYCLE), _getter(HEALTH)
_ground, _rover_slip, _wheel_slip, _drift = map(_getter, (GROUND, ROVER_SLIP, WHEEL_SLIP, DRIFT))
_dead_reckoned = _getter(DEAD_RECKONED)
_estimate, _odometry = _getter(ESTIMATE), _getter(POSE)
_samples = {kind: (kind.__name__, _getter(names)) for kind, names in SAMPLES.items()}


def facts_of(
    view: CycleView, offset_ns: int, healths: Sequence[Health] | None, extra: Mapping[str, object]
) -> CycleFacts:
    """Return what is handed over of a cycle.

    Args:
        view: The cycle.
        offset_ns: Real minus simulated time; 0 for a real rover.
        healths: Of all devices where they have changed, else None.
        extra: Further facts about the run by their names.
    """
    output = view.output
    samples = []
    for sample in view.samples:
        found = _samples.get(type(sample))
        if found is not None:
            name, get = found
            samples.append((name, get(sample)))
    return CycleFacts(
        offset_ns,
        _cycle(output),
        (_estimate(output.estimate), _odometry(output.odometry)),
        _parts(output),
        samples,
        None if healths is None else [(*_health(each), sum(each.rejected.values())) for each in healths],
        extra,
    )


def _parts(output: StepOutput) -> Values:
    ground, slip, drift, reckoned = output.ground, output.slip, output.scomp, output.dead_reckoned
    rover = None if slip is None else slip.rover
    return (
        None if ground is None else _ground(ground),
        None if rover is None else _rover_slip(rover),
        None if slip is None or rover is not None else [_wheel_slip(wheel) for wheel in slip.wheels],
        None if drift is None else _drift(drift),
        None if reckoned is None else _dead_reckoned(reckoned),
    )


def packed(facts: CycleFacts) -> bytes:
    """Return a cycle for another process."""
    return to_json(facts, inf_nan_mode="constants")


def unpacked(data: bytes) -> CycleFacts:
    """Return a cycle of another process."""
    return CycleFacts(*json.loads(data))


def estimate_of(facts: CycleFacts) -> EstimateRecord:
    """Return the record of what a cycle computed, as in a log, as far as it was handed over."""
    estimate, odometry = facts.pose
    ground, rover, wheels, drift, reckoned = facts.parts
    slip = {"rover": _named(ROVER_SLIP, rover), "wheels": [_named(WHEEL_SLIP, each) for each in wheels or ()]}
    found = {
        **dict(zip(CYCLE, facts.cycle, strict=True)),
        "estimate": _named(ESTIMATE, estimate),
        "odometry": _named(POSE, odometry),
        "ground": _named(GROUND, ground),
        "slip": None if rover is None and wheels is None else slip,
        "drift": _named(DRIFT, drift),
        "dead_reckoned": _named(DEAD_RECKONED, reckoned),
    }
    return cast(EstimateRecord, found)


def _named(names: Sequence[str], values: Values | None) -> Mapping[str, Any] | None:
    return None if values is None else dict(zip(names, values, strict=True))
