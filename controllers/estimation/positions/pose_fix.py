"""Fix of the pose by a device on the floor, or by an antenna."""

import cmath
from dataclasses import dataclass

import numpy as np

from controllers.estimation.filter.measurement_model import Array, Expected, Measured
from controllers.estimation.filter.motion_history import WayBack, pose_then
from controllers.estimation.filter.state_layout import BIAS, YAW, X, Y
from drivers.samples import UNKNOWN_YAW_STD_RAD, PoseFixSample


def has_yaw(fix: PoseFixSample) -> bool:
    """Return whether a fix measures the yaw."""
    return not fix.yaw_std_rad >= UNKNOWN_YAW_STD_RAD


def place_then(state: Array, fix: PoseFixSample, way_back: WayBack) -> tuple[complex, float]:
    """Return, in the local frame, where a fix was measured on the rover, and the yaw of the rover."""
    then_m, then_rad = pose_then(state, way_back)
    return then_m + complex(fix.arm_x_m, fix.arm_y_m) * cmath.rect(1.0, then_rad), then_rad


@dataclass(frozen=True, slots=True, kw_only=True)
class PoseFix:
    """Pose on the floor of a device, at a past moment.

        p = o + R(a) (x + R(yaw) w + R(yaw - t) l),   yaw_fix = yaw - t + a

    with the place o and the yaw a of the local frame on the floor, the pose (x, yaw) of the rover, the way w
    back to the exposure in its frame, the turn t since, and the arm l to the antenna. Way and turn are by the
    gyro: both are those of the present bias. The slip since the exposure is noise here.

    Attributes:
        fix: The reading.
        way_back: From the present pose to that at exposure.
        origin_index: First state of o and a.
    """

    fix: PoseFixSample
    way_back: WayBack
    origin_index: int

    @property
    def names(self) -> tuple[Measured, ...]:
        """Of the position, and of the yaw where it is measured."""
        parts = ("x", "y", "yaw") if has_yaw(self.fix) else ("x", "y")
        return tuple(Measured(self.fix.device, part) for part in parts)

    @property
    def angles(self) -> tuple[int, ...]:
        """The yaw."""
        return (2,)

    @property
    def measured(self) -> tuple[float, ...]:
        """The reading in the order of `names`."""
        fix = self.fix
        return (fix.x_m, fix.y_m, fix.yaw_rad) if has_yaw(fix) else (fix.x_m, fix.y_m)

    def predict(self, state: Array) -> Expected:
        """Return the expected pose."""
        fix, origin = self.fix, self.origin_index
        then_m, then_rad = place_then(state, fix, self.way_back)
        axes, covered_s = cmath.rect(1.0, state.item(YAW)), self.way_back.covered_s
        arm_m = complex(fix.arm_x_m, fix.arm_y_m) * cmath.rect(1.0, then_rad)
        by_bias_m, by_bias_rad = self.way_back.with_bias(state.item(BIAS))
        then_m += by_bias_m * axes + 1j * by_bias_rad * arm_m
        then_rad += by_bias_rad
        then_s_m = self.way_back.place_s_m * axes + 1j * covered_s * arm_m
        frame = cmath.rect(1.0, state.item(origin + YAW))
        expected_m = complex(state.item(origin + X), state.item(origin + Y)) + frame * then_m
        # Derivatives of the expected place over the states; x is the real part, y the imaginary one.
        slopes = np.zeros(len(state), dtype=complex)
        slopes[X], slopes[Y] = frame, 1j * frame
        slopes[YAW] = 1j * frame * (then_m - complex(state.item(X), state.item(Y)))
        slopes[BIAS] = frame * then_s_m
        slopes[origin + X], slopes[origin + Y] = 1.0, 1j
        slopes[origin + YAW] = 1j * frame * then_m
        position_m2 = fix.position_std_m**2 + self.way_back.position_m2
        values, rows = [expected_m.real, expected_m.imag], [slopes.real, slopes.imag]
        variances = [position_m2, position_m2]
        if has_yaw(fix):
            yaw_row = np.zeros(len(state))
            yaw_row[YAW] = yaw_row[origin + YAW] = 1.0
            yaw_row[BIAS] = covered_s
            values.append(then_rad + state.item(origin + YAW))
            rows.append(yaw_row)
            variances.append(fix.yaw_std_rad**2 + self.way_back.yaw_rad2)
        return Expected(np.array(values), np.array(rows), np.array(variances))
