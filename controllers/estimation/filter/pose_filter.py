"""Pose of the rover: an extended Kalman filter of pose, gyro bias, and the frames of other devices."""

import cmath
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from controllers.estimation.filter.guarded_filter import FilterStep, GuardedFilter, Innovation
from controllers.estimation.filter.measurement_model import MeasurementModel
from controllers.estimation.filter.motion_history import Step
from controllers.estimation.filter.slip_states import SlipStates
from controllers.estimation.filter.state_layout import BIAS, YAW, X, Y, lay_out
from controllers.estimation.filter.transition import MotionTransition, Turn
from controllers.estimation.settings import FilterSettings
from controllers.estimation.slip_prior import UNKNOWN, SlipPrior
from controllers.estimation.wheels.odometry import BodyIncrement
from controllers.motion.planar import Pose

Array = NDArray[np.float64]


class PoseFilter:
    """State [x, y, yaw, gyro bias, offsets, origins, frame, remaining slip, states of the slip compensator].

    There is one offset per heading device and reference.

    An offset is the heading at a yaw of zero. It starts unknown. While the rover settles the yaw is certain,
    so the first headings give the offset, and later ones correct the yaw as far as the offset is known.
    Magnetic and true headings have offsets of their own.

    An origin is the pose of the local frame on the floor of a device that gives fixes, three states. It is
    estimated in the same way: the first fix ties the frames together, best while the rover is at standstill,
    and later ones correct pose and origin as far as each is known. The mission stays in the local frame.

    A slip compensator may have states of its own. They turn the motion of the wheels into that of the body,
    so that every measurement corrects pose, gyro bias and slip together.

    The slip that remains is a share of the way of the wheels, along it and across: two first-order
    Gauss-Markov processes over the travel (Gelb 1974, section 3.8), as states in units of their standard
    deviation. Its effect on the position grows with the distance, not with its root, and fixes correct it
    together with the position. There are two such pairs: that of a place, or what compensation leaves, and
    that of the ground, where nothing measures the slip, as the prior assumes.

    With a camera that measures the motion over the ground there are the pose at the newest frame, a copy of
    the pose then (stochastic cloning, Roumeliotis and Burdick 2002), and the scale of the measured travel,
    the same for all pairs of frames: the position is uncertain in proportion to the travel. A further pair
    of slips acts while the motion is measured; it is wide, so that the measurement decides.

    Args:
        settings: Noise.
        heading_devices: Names of the devices that give headings.
        fix_devices: Names of the devices that give absolute fixes.
        is_compensated: Whether slip is compensated where an increment is sure.
        has_ground: Whether a camera measures the motion over the ground.
        slip: States of the slip compensator; None where it has none.
        prior: What is assumed about slip that nothing measures.

    Attributes:
        layout: Where each part of the state is.
        kalman: The filter itself, for sensors whose frames or scales are states.
        slip: As given.
        path_m: What the wheels have rolled, or may have moved without a measurement.
    """

    def __init__(
        self,
        settings: FilterSettings,
        heading_devices: Sequence[str],
        fix_devices: Sequence[str] = (),
        *,
        is_compensated: bool = False,
        has_ground: bool = False,
        slip: SlipStates | None = None,
        prior: SlipPrior = UNKNOWN,
    ) -> None:
        self.layout = layout = lay_out(
            settings,
            heading_devices,
            fix_devices,
            has_ground=has_ground,
            block_variances=() if slip is None else slip.start_variances.tolist(),
        )
        self.slip = slip
        start = np.zeros(layout.size)
        if slip is not None:
            start[layout.block] = slip.start
        self.kalman = GuardedFilter(
            start.tolist(), layout.variances, layout.angles, settings.gate_probability
        )
        self._motion = MotionTransition(settings, layout, slip, prior, is_compensated=is_compensated)
        self.path_m = 0.0

    def keep_steps(self) -> list[FilterStep]:
        """Keep every step of the filter from now on, for a smoother; return the growing list."""
        return self.kalman.keep_steps()

    @property
    def pose(self) -> Pose:
        """The estimated pose."""
        x_m, y_m, yaw_rad = self.kalman.state[:BIAS]
        return Pose(x_m=x_m, y_m=y_m, yaw_rad=yaw_rad)

    @property
    def gyro_bias_rad_s(self) -> float:
        """The estimated bias of the gyro."""
        return self.kalman.value(BIAS)

    @property
    def covariance(self) -> tuple[float, float, float, float, float, float]:
        """Upper triangle of the covariance over (x, y, yaw), by rows."""
        x_row, y_row, yaw_row = self.kalman.covariance[:BIAS]
        return (x_row[X], x_row[Y], x_row[YAW], y_row[Y], y_row[YAW], yaw_row[YAW])

    def predict(self, increment: BodyIncrement, turn: Turn) -> Step:
        """Move by the wheels' increment; `turn` replaces the turn of the wheels. Return the step."""
        moved = self._motion.predict(self.kalman.state, increment, turn)
        self.kalman.predict(increment.duration_s, moved.state, moved.transition, moved.noise)
        self.path_m += abs(moved.step.rolled_m)
        return moved.step

    def inflate(self, x_m: float, y_m: float, yaw_rad: float) -> None:
        """Add the uncertainty of motion that was not measured.

        Any value from zero to the greatest is equally likely, hence the variance of a third of its square.

        Args:
            x_m: The rover may have moved forward or backward by this at most.
            y_m: The same to the left or right.
            yaw_rad: It may have turned by this at most.
        """
        self.path_m += math.hypot(x_m, y_m)
        direction = cmath.rect(1.0, self.kalman.value(YAW))
        noise = np.zeros((self.layout.size,) * 2)
        for axis, greatest_m in ((direction, x_m), (1j * direction, y_m)):
            column = np.array([axis.real, axis.imag])
            noise[:YAW, :YAW] += np.outer(column, column) * greatest_m**2 / 3.0
        noise[YAW, YAW] = yaw_rad**2 / 3.0
        self.kalman.add_covariance(noise)

    def assume(self, prior: SlipPrior, path_m: complex) -> None:
        """Assume another slip of wheels whose slip nothing measures, from now on and on a part of the path.

        The slip is taken to be the same on both: what later measures it also corrects the position. That of
        a place begins anew: its state counts in standard deviations of the prior before.

        Args:
            prior: What is assumed now; its mean is that of the prior before.
            path_m: From the beginning to the end of that part, in the local frame, y as imaginary part.
        """
        self._motion.prior = prior
        state, size = self.kalman.state, self.layout.size
        transition, noise = np.eye(size), np.zeros((size, size))
        for index, effect_m in enumerate(
            (0j, 0j, prior.sd * path_m, prior.cross_sd * 1j * path_m), self.layout.first_slip
        ):
            state[index] = transition[index, index] = 0.0
            column = np.zeros(size)
            column[X], column[Y], column[index] = effect_m.real, effect_m.imag, 1.0
            noise += np.outer(column, column)
        self.kalman.predict(0.0, state, transition, noise)

    @property
    def gyro_bias_rad2_s2(self) -> float:
        """Its variance."""
        return self.kalman.covariance[BIAS][BIAS]

    def inflate_with_bias(self, error_rad_s: float) -> float:
        """Make the bias uncertain by an error that it may have, and all that depends on it.

        The covariance becomes what it would be had the bias been as uncertain before: every state follows the
        bias by its regression on it.

        Returns:
            By how much the yaw is wrong with that error.
        """
        column = np.array([row[BIAS] for row in self.kalman.covariance])
        followed = error_rad_s * column / column[BIAS]
        self.kalman.add_covariance(np.outer(followed, followed))
        return abs(float(followed[YAW]))

    @property
    def slip_values(self) -> Array:
        """The states of the slip compensator, shape (n,)."""
        return np.array(self.kalman.state[self.layout.block])

    def correct(self, model: MeasurementModel, measured: Sequence[float]) -> tuple[Innovation, ...]:
        """Correct by what a model measures."""
        return self.kalman.correct(model, measured)

    def add_slip_variance(self, index: int, variance: float) -> None:
        """Increase the variance of one state of the slip compensator."""
        self.kalman.add_variance(self.layout.block.start + index, variance)

    def reset_slip_variances(self) -> None:
        """Make the states of slip as uncertain as at the start: what has taught them was wrong."""
        variances = () if self.slip is None else self.slip.start_variances
        covariance = self.kalman.covariance
        for index, variance in enumerate(variances, self.layout.block.start):
            self.kalman.add_variance(index, max(0.0, float(variance) - covariance[index][index]))
