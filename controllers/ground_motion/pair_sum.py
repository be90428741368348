"""The motion over the ground that is measured once, for what looks at the same frames or at some of them."""

from dataclasses import replace

import numpy as np

from controllers.ground_motion.estimator import GroundMotionEstimator
from controllers.ground_motion.flow import PatchMotion
from controllers.ground_motion.ground_view import GroundView, SeenGround
from controllers.ground_motion.motion import GroundMotion
from controllers.ground_motion.parameters import DEFAULTS, GroundMotionParameters
from controllers.ground_motion.prior import MotionPrior
from controllers.ground_motion.reference_frames import rotated
from controllers.ground_motion.rig_tolerance import RigTolerance
from drivers.samples import Image


class PairSum:
    """Measures the motion between frames, and sums it up until it is taken.

    Args:
        view: The ground in the frames of the rig.
        tolerance: What is not known about the rig; None for its defaults.
        parameters: Tuned numbers.
        rotates_about_origin: As of `GroundMotionEstimator`.

    Attributes:
        view: The ground in the frames.
        estimator: Of the motion over the ground.
    """

    def __init__(
        self,
        view: GroundView,
        tolerance: RigTolerance | None = None,
        parameters: GroundMotionParameters = DEFAULTS,
        *,
        rotates_about_origin: bool = True,
    ) -> None:
        self.view = view
        self.estimator = GroundMotionEstimator(
            view, tolerance, parameters, rotates_about_origin=rotates_about_origin
        )
        self._patch: Image | None = None
        self._sum: PatchMotion | None = None
        self._is_known, self._is_open = False, False

    def measure(self, t_ns: int, ground: SeenGround, prior: MotionPrior) -> GroundMotion | None:
        """Return the motion since the frame before, as `GroundMotionEstimator.step` does."""
        measured = self.estimator.step_patch(t_ns, ground.patch, ground.structure, prior)
        pair, was_open = self.estimator.pair, self._is_open
        self._patch, self._is_open = ground.patch, measured is not None and measured.is_open
        # A pair that was open holds motion from before, which may have been taken as unknown already.
        self._is_known &= pair is not None and not (was_open and not self._is_open)
        if pair is not None:
            self._sum = pair if self._sum is None else _joined(self._sum, pair)
        return measured

    def take(self, ground: SeenGround) -> PatchMotion | None:
        """Return the motion since the frame of the last call; None where a part of it is not known.

        Args:
            ground: In the frame that was measured last: the motion up to another frame is not known.
        """
        motion = self._sum if self._is_known and self._patch is ground.patch else None
        self._sum, self._is_known = None, self._patch is ground.patch
        return motion


def _joined(first: PatchMotion, second: PatchMotion) -> PatchMotion:
    """Return the motion over two pairs, in the axes of the later frame."""
    before_m = rotated(np.array([first.forward_m, first.left_m]), -second.turn_rad)
    return replace(
        second,
        forward_m=float(before_m[0]) + second.forward_m,
        left_m=float(before_m[1]) + second.left_m,
        turn_rad=first.turn_rad + second.turn_rad,
        forward_sd_m=float(np.hypot(first.forward_sd_m, second.forward_sd_m)),
        left_sd_m=float(np.hypot(first.left_sd_m, second.left_sd_m)),
        turn_sd_rad=float(np.hypot(first.turn_sd_rad, second.turn_sd_rad)),
    )
