"""The pose at the newest frame of a camera, as states of the pose filter."""

import numpy as np

from controllers.estimation.filter.guarded_filter import Innovation
from controllers.estimation.filter.measurement_model import Measured
from controllers.estimation.filter.motion_history import WayBack, pose_then
from controllers.estimation.filter.pose_filter import PoseFilter
from controllers.estimation.filter.state_layout import BIAS, DIRECTION, SCALE, YAW, X, Y
from controllers.estimation.ground.model import GroundTravel
from controllers.estimation.parameters import ESTIMATION
from controllers.ground_motion.motion import GroundMotion


class FramePose:
    """Keeps a copy of the pose at a frame, and corrects by the motion over the ground since then.

    Args:
        pose_filter: With states for this pose, the scale of the travel, and the measured slip.
    """

    def __init__(self, pose_filter: PoseFilter) -> None:
        self._filter = pose_filter
        self._shared_variance = {SCALE: 0.0, DIRECTION: 0.0}

    @property
    def measured_slip(self) -> complex:
        """What is added to the wheels' travel while the motion is measured, as a share; left imaginary."""
        state, index = self._filter.kalman.state, self._filter.layout.measured_slip
        return ESTIMATION.ground.slip_sd * complex(state[index], state[index + 1])

    def mark(self, way_back: WayBack) -> None:
        """Keep the pose at the exposure of a frame; `way_back` leads to it from the present pose."""
        frame, kalman = self._filter.layout.frame, self._filter.kalman
        state = np.array(kalman.state)
        then_m, then_rad = pose_then(state, way_back)
        arm_m = then_m - complex(state[X], state[Y])
        transition = np.eye(len(state))
        transition[frame : frame + BIAS] = 0.0
        transition[[frame + X, frame + Y, frame + YAW], [X, Y, YAW]] = 1.0
        transition[frame + X, YAW], transition[frame + Y, YAW] = -arm_m.imag, arm_m.real
        state[frame : frame + BIAS] = then_m.real, then_m.imag, then_rad
        kalman.predict(0.0, state.tolist(), transition, np.zeros_like(transition))

    def correct(
        self, device: str, motion: GroundMotion, way_back: WayBack, *, corrects_yaw: bool
    ) -> tuple[Innovation, ...]:
        """Correct by the motion over the ground since the frame of `mark`.

        A motion that the wheels do not explain, as of a rover pushed at standstill, is reported as rejected.
        It is taken nevertheless: the camera sees the rover itself, and what it saw would be lost for good.

        Args:
            device: Name of the camera.
            motion: A valid one, from the time of that frame on.
            way_back: From the present pose to that at the later frame.
            corrects_yaw: Whether the turn is used, too; a gyro that is fresh measures it better.
        """
        frame, kalman = self._filter.layout.frame, self._filter.kalman
        self._take_shared(device, SCALE, motion.scale_sd**2)
        self._take_shared(device, DIRECTION, motion.direction_sd_rad**2)
        model = GroundTravel(
            device=device, motion=motion, way_back=way_back, frame_index=frame, has_turn=corrects_yaw
        )
        # The prior of the slip is too crude to teach what the camera's scale and direction are. A travel in
        # the rover's own axes says nothing of its yaw.
        held: tuple[int, ...] = (frame + SCALE, frame + DIRECTION)
        if not corrects_yaw:
            held += (YAW, frame + YAW, BIAS)
        innovations = kalman.correct(model, model.measured, held)
        residuals = [innovation.residual or 0.0 for innovation in innovations]
        if not innovations[0].accepted and innovations[0].residual is not None:
            distance_m2 = abs(complex(residuals[X], residuals[Y])) ** 2
            for index in (X, Y):
                kalman.add_variance(index, distance_m2)
            if corrects_yaw:
                kalman.add_variance(YAW, residuals[YAW] ** 2)
            kalman.correct(model, model.measured, held)
        return innovations

    def _take_shared(self, device: str, part: int, variance: float) -> None:
        """Take the variance of an error that all pairs share: it grows, or has become better known."""
        kalman, index = self._filter.kalman, self._filter.layout.frame + part
        before, self._shared_variance[part] = self._shared_variance[part], variance
        if variance > before:
            kalman.add_variance(index, variance - before)
            return
        known = kalman.covariance[index][index]
        if variance < min(before, known):
            row = np.zeros(len(kalman.state))
            row[index] = 1.0
            kalman.update(Measured(device), -kalman.value(index), row, known * variance / (known - variance))
