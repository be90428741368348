"""Cycles for tests of stop rules: each piece of evidence by one name."""

from dataclasses import replace
from typing import Any

from controllers.estimation.pose_estimate import PoseEstimate, YawSource
from controllers.estimation.wheels.evidence import WheelSetpoints
from controllers.safety.reasons import Cycle

AT_START = PoseEstimate(
    t_ns=0,
    x_m=0.0,
    y_m=0.0,
    yaw_rad=0.0,
    velocity_x_m_s=0.0,
    velocity_y_m_s=0.0,
    yaw_rate_rad_s=0.0,
    gyro_bias_rad_s=0.0,
    covariance=(0.0,) * 6,
    yaw_source=YawSource.GYRO,
)


def changed(cycle: Cycle, **evidence: Any) -> Cycle:
    """Return a cycle with other evidence.

    Args:
        cycle: The cycle before.
        evidence: Attributes of the parts of a cycle by their names; `commanded_rad_s` and `set_steering_rad`
            are the setpoints.
    """
    setpoints = dict(zip(WheelSetpoints._fields, cycle.wheels.set, strict=True))
    for name, field in (("commanded_rad_s", "speed_rad_s"), ("set_steering_rad", "steering_rad")):
        setpoints[field] = evidence.pop(name, setpoints[field])
    cycle = cycle._replace(wheels=cycle.wheels._replace(set=WheelSetpoints(**setpoints)))
    for name, value in evidence.items():
        if name == "now_ns":
            cycle = cycle._replace(now_ns=value)
        elif hasattr(cycle.estimate, name):
            cycle = cycle._replace(estimate=replace(cycle.estimate, **{name: value}))
        else:
            part = next(part for part in Cycle._fields[2:] if name in getattr(cycle, part)._fields)
            cycle = cycle._replace(**{part: getattr(cycle, part)._replace(**{name: value})})
    return cycle


def make_cycle(now_ns: int, **evidence: Any) -> Cycle:
    """Return a cycle at a time, with evidence as for `changed`; without it nothing has been noticed."""
    return changed(Cycle(now_ns, AT_START), **evidence)
