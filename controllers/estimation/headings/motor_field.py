"""Correction of a compass for the field of motor currents.

The earth's horizontal field has strength one, and each motor adds a field in the axes of the rover that is
proportional to its current. A compass shows the direction of the sum; the currents are measured, so the
direction of the earth's field alone follows (as ArduPilot's compassmot with `COMPASS_MOTCT = 2`).
"""

import math
from dataclasses import replace

from controllers.estimation.settings import MotorFields
from controllers.motion.planar import wrap_angle
from drivers.clock import nanoseconds, seconds
from drivers.samples import HeadingSample, Sample, WheelSample

GREATEST_SHARE = 0.9
"""Of the earth's field; beside a stronger one the direction of the earth's is not found."""


class MotorCurrents:
    """Newest current of each motor, smoothed as a damped compass smooths its heading.

    Args:
        count: Number of motors.
        smoothing_s: Time constant of the compass; 0 for none.
        max_age_s: Age from which on a current is not known any more.
    """

    def __init__(self, count: int, smoothing_s: float, max_age_s: float) -> None:
        self._smoothing_s = smoothing_s
        self._max_age_ns = nanoseconds(max_age_s)
        self._current_a = [0.0] * count
        self._t_ns: list[int | None] = [None] * count

    def take(self, sample: WheelSample, t_ns: int) -> None:
        """Take the current in a sample of the wheels; that of a magnitude has the sign of the speed."""
        wheel, current_a = sample.wheel, sample.current_a
        if current_a is None or not math.isfinite(current_a) or not 0 <= wheel < len(self._current_a):
            return
        if not sample.current_is_signed:
            if sample.speed_rad_s is None:
                return
            current_a = math.copysign(current_a, sample.speed_rad_s)
        before_ns = self._t_ns[wheel]
        if before_ns is None or self._smoothing_s <= 0.0:
            self._current_a[wheel] = current_a
        else:
            share = -math.expm1(-seconds(max(0, t_ns - before_ns)) / self._smoothing_s)
            self._current_a[wheel] += share * (current_a - self._current_a[wheel])
        self._t_ns[wheel] = t_ns

    def at(self, t_ns: int) -> tuple[float, ...] | None:
        """Return the currents in A; None where that of a motor is not known."""
        for each_ns in self._t_ns:
            if each_ns is None or t_ns - each_ns > self._max_age_ns:
                return None
        return tuple(self._current_a)


def without_motor_field(heading_rad: float, ahead: float, left: float) -> float | None:
    """Return the yaw that a compass would show without a field of the rover; None where it is not found.

    Args:
        heading_rad: Yaw that it shows, counter-clockwise from magnetic east.
        ahead: Field of the rover ahead, as share of the earth's horizontal field.
        left: Field to the left.
    """
    # In the axes of the rover magnetic north, the direction of the field, lies at 90 deg minus the yaw.
    toward_x, toward_y = math.sin(heading_rad), math.cos(heading_rad)
    across = ahead * toward_y - left * toward_x
    if math.hypot(ahead, left) > GREATEST_SHARE:
        return None
    total = ahead * toward_x + left * toward_y + math.sqrt(1.0 - across * across)
    return wrap_angle(math.atan2(total * toward_x - ahead, total * toward_y - left))


class MotorFieldCorrection:
    """Takes the field of the motors out of the headings of one compass.

    Args:
        fields: Of each motor.
        wheels: Device that reports the currents.
        smoothing_s: Time constant of the compass.
        max_age_s: Age from which on a current is not known any more.
    """

    def __init__(self, fields: MotorFields, wheels: str, smoothing_s: float, max_age_s: float) -> None:
        self._fields = fields
        self._wheels = wheels
        self._currents = MotorCurrents(len(fields.per_ampere), smoothing_s, max_age_s)

    def correct(self, sample: Sample, t_ns: int) -> Sample | None:
        """Return a sample for filter and stop rules: of the compass, without the field of the motors.

        None for a heading that cannot be corrected: a current is not known, or the field is too strong.
        """
        if isinstance(sample, WheelSample) and sample.device == self._wheels:
            self._currents.take(sample, t_ns)
        if not isinstance(sample, HeadingSample) or sample.device != self._fields.device:
            return sample
        currents_a = self._currents.at(t_ns)
        if currents_a is None or not math.isfinite(sample.heading_rad):
            return None
        ahead, left = (
            sum(
                each[axis] * current
                for each, current in zip(self._fields.per_ampere, currents_a, strict=True)
            )
            for axis in (0, 1)
        )
        heading_rad = without_motor_field(sample.heading_rad, ahead, left)
        return None if heading_rad is None else replace(sample, heading_rad=heading_rad)
