"""Angle of the rear left wheel's trace."""

import math
from dataclasses import dataclass

import numpy as np

from controllers.estimation.filter.measurement_model import Array, Expected, Measured
from controllers.estimation.filter.state_layout import BIAS
from controllers.slip.scomp.motion_model import GAIN, RESIDUAL, TRACE_NOISE, TRACE_OFFSET, MotionModel, Tilt


@dataclass(frozen=True, slots=True, kw_only=True)
class TraceAngle:
    """Direction of the rear wheel's velocity in the body, eq 2 of paper 000.

        a = atan(tan(g + beta) - w b / v) + n + o

    with the steering angle g, the slip angle beta, the yaw rate w, the rear axle at b behind the centre of
    mass, the speed v, and the correlated and constant errors n and o of the trace.

    Attributes:
        model: Of the slip angle.
        tilt: Of the rover.
        block: The states of slip.
        steering_rad: g.
        arm_s: b / v.
        yaw_rate_rad_s: w.
        bias_slope_s: Derivative of the angle over the bias of the gyro; 0 where w is not the gyro's.
        variance_rad2: Of the white noise of a reading.
    """

    model: MotionModel
    tilt: Tilt
    block: slice
    steering_rad: float
    arm_s: float
    yaw_rate_rad_s: float
    bias_slope_s: float
    variance_rad2: float

    @property
    def names(self) -> tuple[Measured, ...]:
        """Of the angle."""
        return (Measured("trace"),)

    @property
    def angles(self) -> tuple[int, ...]:
        """The angle."""
        return (0,)

    def predict(self, state: Array) -> Expected:
        """Return the expected angle; its slope over the slip angle is taken as 1."""
        values = state[self.block]
        course_rad = self.steering_rad + self.model.drift(values, self.tilt)
        wheel_rad = math.atan(math.tan(course_rad) - self.arm_s * self.yaw_rate_rad_s)
        row = np.zeros((1, len(state)))
        slopes = row[0, self.block]
        slopes[[RESIDUAL, TRACE_NOISE, TRACE_OFFSET]] = 1.0
        slopes[GAIN] = self.tilt.expected_drift_rad
        row[0, BIAS] = self.bias_slope_s
        value_rad = wheel_rad + values.item(TRACE_NOISE) + values.item(TRACE_OFFSET)
        return Expected(np.array([value_rad]), row, np.array([self.variance_rad2]))
