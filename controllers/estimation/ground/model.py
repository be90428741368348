"""Motion over the ground between two frames of a camera."""

import cmath
from dataclasses import dataclass

import numpy as np

from controllers.estimation.filter.measurement_model import Array, Expected, Measured
from controllers.estimation.filter.motion_history import WayBack, pose_then
from controllers.estimation.filter.state_layout import DIRECTION, SCALE, YAW, X, Y
from controllers.ground_motion.motion import GroundMotion
from controllers.motion.planar import wrap_angle


@dataclass(frozen=True, slots=True, kw_only=True)
class GroundTravel:
    """Travel of a point of the body over the ground since an earlier frame, in the axes of the later one.

        d = (1 + s + j a) [R(-yaw2) (x2 - x1) + f - R(yaw1 - yaw2) f] + (q - f) - R(yaw1 - yaw2) (q - f),
        turn = yaw2 - yaw1

    with the poses (x1, yaw1) and (x2, yaw2) at the two frames, the first a copy of the pose then, the point q
    of the body, the scale s, and the direction a of the camera in yaw. A wrong height or focal length scales
    the view about the point f below the camera: q is then not where the rig says, and this point is.

    Attributes:
        device: Name of the camera.
        motion: A valid one.
        way_back: From the present pose to that at the later frame.
        frame_index: First state of the pose at the earlier frame; scale and direction follow.
        has_turn: Whether the turn is used, too.
    """

    device: str
    motion: GroundMotion
    way_back: WayBack
    frame_index: int
    has_turn: bool

    @property
    def names(self) -> tuple[Measured, ...]:
        """Of the travel, and of the turn where it is used."""
        parts = ("forward", "left", "turn") if self.has_turn else ("forward", "left")
        return tuple(Measured(self.device, part) for part in parts)

    @property
    def angles(self) -> tuple[int, ...]:
        """The turn."""
        return (2,)

    @property
    def measured(self) -> tuple[float, ...]:
        """The motion in the order of `names`."""
        motion = self.motion
        return (motion.forward_m, motion.left_m, motion.turn_rad)[: 3 if self.has_turn else 2]

    def predict(self, state: Array) -> Expected:
        """Return the expected motion."""
        frame, motion = self.frame_index, self.motion
        then_m, then_rad = pose_then(state, self.way_back)
        before_m = complex(state.item(frame + X), state.item(frame + Y))
        turn_rad = wrap_angle(then_rad - state.item(frame + YAW))
        axes, point_m = cmath.rect(1.0, -then_rad), complex(*motion.point_m)
        foot_m = complex(*motion.foot_m)
        turned_m, turned_foot_m = (each * cmath.rect(1.0, -turn_rad) for each in (point_m, foot_m))
        factor = complex(1.0 + state.item(frame + SCALE), state.item(frame + DIRECTION))
        chord_m = axes * (then_m - before_m)
        travel_m = chord_m + foot_m - turned_foot_m
        turned_m = factor * turned_foot_m + turned_m - turned_foot_m
        # Derivatives of the expected travel over the states, to the left as imaginary part.
        slopes = np.zeros(len(state), dtype=complex)
        slopes[X], slopes[Y] = factor * axes, factor * 1j * axes
        arm_m = then_m - complex(state.item(X), state.item(Y))
        slopes[YAW] = 1j * (factor * (axes * arm_m - chord_m) + turned_m)
        slopes[frame + X], slopes[frame + Y] = -slopes[X], -slopes[Y]
        slopes[frame + YAW] = -1j * turned_m
        slopes[frame + SCALE], slopes[frame + DIRECTION] = travel_m, 1j * travel_m
        turn_row = np.zeros(len(state))
        turn_row[YAW], turn_row[frame + YAW] = 1.0, -1.0
        expected_m = factor * chord_m + factor * foot_m + point_m - foot_m - turned_m
        used = slice(3 if self.has_turn else 2)
        return Expected(
            np.array([expected_m.real, expected_m.imag, turn_rad])[used],
            np.array([slopes.real, slopes.imag, turn_row])[used],
            np.array([motion.forward_sd_m**2, motion.left_sd_m**2, motion.turn_sd_rad**2])[used],
        )
