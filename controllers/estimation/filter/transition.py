"""Transition of the pose filter: how pose, gyro bias and slip go on with a motion of the wheels."""

import cmath
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from controllers.estimation.filter.motion_history import Step
from controllers.estimation.filter.slip_states import SlipStates, SlipStep
from controllers.estimation.filter.state_layout import BIAS, YAW, StateLayout, X, Y
from controllers.estimation.parameters import ESTIMATION
from controllers.estimation.pose_estimate import YawSource
from controllers.estimation.settings import FilterSettings
from controllers.estimation.slip_prior import SlipPrior
from controllers.estimation.wheels.odometry import BodyIncrement
from controllers.matrices import complex_product, product
from controllers.motion.planar import Pose, move
from drivers.record import record

Array = NDArray[np.float64]


@record(frozen=True, slots=True, kw_only=True)
class Turn:
    """Measured turn of the rover.

    Attributes:
        angle_rad: Bias of the gyro included.
        source: Source of the measurement.
        covered_s: The time over which the gyro's bias entered; 0 for the wheels.
        by_wheels_rad: Part of the angle that the wheels measured in a gap of the gyro; None without a gap.
        gap_error_rad: Greatest error of this part.
        unobserved_rad2: Variance of what the gyro did not see between its readings, and of noise beyond
            the configured one.
        measured_s: The time in which gyro and wheels measured the angle.
    """

    angle_rad: float
    source: YawSource
    covered_s: float = 0.0
    by_wheels_rad: float | None = None
    gap_error_rad: float = 0.0
    unobserved_rad2: float = 0.0
    measured_s: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Moved:
    """A state after a motion.

    Attributes:
        state: Of n numbers.
        transition: Its derivatives over the state before it, shape (n, n); valid until the next motion.
        noise: Covariance added, shape (n, n); valid until the next motion.
        step: The motion.
    """

    state: list[float]
    transition: Array
    noise: Array
    step: Step


ONE_SIDED = math.sqrt(3.0) / 2.0
"""Mean over rms of an error that lies anywhere between none and a limit: the part that has one sign."""


class MotionTransition:
    """Wheels that roll along their constraints and slip, and a gyro with a bias.

        x, y    += R(yaw + turn / 2) d,   d = the wheels' travel (1 + slip)
        yaw     += turn,                  turn = the gyro's angle - bias t, or that of the wheels
        slip    *= exp(-d / D),           a first-order Gauss-Markov process over the travel

    The travel of the wheels fulfils their constraints, see `motion.wheel_constraints`. A slip compensator's
    states turn it into that of the body first.

    Args:
        settings: Noise.
        layout: Where each part of the state is.
        slip: States of the slip compensator; None where it has none.
        prior: Slip of wheels whose slip nothing measures.
        is_compensated: Whether the slip is measured where an increment is sure.

    Attributes:
        prior: As given; another one acts from the next motion on.
    """

    def __init__(
        self,
        settings: FilterSettings,
        layout: StateLayout,
        slip: SlipStates | None,
        prior: SlipPrior,
        *,
        is_compensated: bool,
    ) -> None:
        self._settings, self._layout, self._slip = settings, layout, slip
        self._is_compensated = is_compensated
        self.prior = prior
        self._transition = np.eye(layout.size)
        self._noise = np.zeros((layout.size, layout.size))
        remaining = slice(layout.first_slip, layout.first_slip + 2 * layout.slip_pairs)
        self._slip_slopes = self._transition[:YAW, remaining]
        self._assumed = slice(2, 4)  # among these
        # Views of the diagonals.
        self._slip_keeps = np.einsum("ii->i", self._transition)[remaining]
        self._slip_noises = np.einsum("ii->i", self._noise)[remaining]

    def predict(self, state: list[float], increment: BodyIncrement, turn: Turn) -> Moved:
        """Return what becomes of a state by the wheels' increment; `turn` replaces the turn of the wheels.

        Args:
            state: The present one; changed in place.
            increment: Of the wheels.
            turn: Of the rover.
        """
        measured_slip = state[self._layout.measured_slip : self._layout.measured_slip + 2]
        before = Pose(x_m=state[X], y_m=state[Y], yaw_rad=state[YAW])
        turn_rad = turn.angle_rad - state[BIAS] * turn.covered_s
        rolled_m = travel_m = complex(increment.x_m, increment.y_m)
        by_slip = None
        if self._slip is not None:
            by_slip = self._slip.predict(np.array(state[self._layout.block]), increment)
            if increment.is_measured:  # what the camera measures is the whole slip
                by_slip = by_slip.without_travel(travel_m)
            rolled_m = travel_m = by_slip.travel_m
        if increment.rolled_m is not None:
            rolled_m = increment.rolled_m
        active = self._active_slips(increment)
        ground_m = abs(travel_m)
        remaining = sum((complex(sd * state[i], cross * state[i + 1]) for i, sd, cross in active), 0j)
        travel_m += rolled_m * remaining
        after = move(before, travel_m.real, travel_m.imag, turn_rad)
        state[:BIAS] = after.x_m, after.y_m, after.yaw_rad
        moved_x_m, moved_y_m = after.x_m - before.x_m, after.y_m - before.y_m
        transition = self._transition
        transition[X, YAW] = -moved_y_m
        transition[Y, YAW] = moved_x_m
        transition[X, BIAS] = 0.5 * moved_y_m * turn.covered_s
        transition[Y, BIAS] = -0.5 * moved_x_m * turn.covered_s
        transition[YAW, BIAS] = -turn.covered_s
        self._set_noise(increment, turn)
        toward = cmath.rect(1.0, before.yaw_rad + 0.5 * turn_rad)
        way_m = rolled_m * toward
        self._let_slip_change(ground_m, state)
        if increment.is_measured:
            self._let_measured_slip_change(abs(rolled_m), measured_slip, state)
        for index, sd, cross_sd in active:
            for place, effect_m in ((index, sd * way_m), (index + 1, cross_sd * 1j * way_m)):
                self._transition[X, place], self._transition[Y, place] = effect_m.real, effect_m.imag
        if by_slip is not None:
            self._take_slip(by_slip, toward * (1.0 + remaining), state)
        by_wheels_m = increment.rolled_m
        step = Step(
            x_m=travel_m.real,
            y_m=travel_m.imag,
            turn_rad=turn_rad,
            duration_s=increment.duration_s,
            position_m2=_greatest_variance(self._noise),
            yaw_rad2=float(self._noise[YAW, YAW]),
            rolled_m=complex(increment.x_m, increment.y_m) if by_wheels_m is None else by_wheels_m,
            slip_sd=math.hypot(*(sd for _, *pair in active for sd in pair)),
            covered_s=turn.covered_s,
            bias_rad_s=state[BIAS],
            measured_s=turn.measured_s,
        )
        return Moved(state=state, transition=transition, noise=self._noise, step=step)

    def _take_slip(self, step: SlipStep, toward: complex, state: list[float]) -> None:
        """Set the part of the compensator's states in transition, noise and `state`.

        Args:
            step: Their prediction.
            toward: From the body frame to the local one, with the remaining slip.
            state: Changed in place.
        """
        block = self._layout.block
        slopes_m = complex_product(step.slopes_m, toward)
        self._transition[X, block], self._transition[Y, block] = slopes_m.real, slopes_m.imag
        self._transition[block, block] = step.transition
        self._noise[block, block] = step.noise
        turned = np.array([[toward.real, -toward.imag], [toward.imag, toward.real]])
        self._noise[:YAW, :YAW] += product(product(turned, step.travel_noise_m2), turned.T)
        state[block] = step.values.tolist()

    def _active_slips(self, increment: BodyIncrement) -> tuple[tuple[int, float, float], ...]:
        """Return the index of each slip that acts, and its standard deviations along and across."""
        settings, layout, prior = self._settings, self._layout, self.prior
        if increment.is_measured:
            sd = ESTIMATION.ground.slip_sd
            return ((layout.measured_slip, sd, sd),)
        if self._acts_by_prior(increment):
            ground = (layout.assumed_slip, prior.sd, prior.cross_sd)
            return ground, (layout.first_slip, prior.local_sd, prior.local_cross_sd)
        share = settings.slip_sd_share
        if share and increment.is_slip_one_sided:
            share = max(share, ONE_SIDED)
        sd = math.hypot(settings.slip_sd, share * (increment.slip_sd or 0.0))
        return ((layout.first_slip, sd, settings.cross_slip_ratio * sd),)

    def _acts_by_prior(self, increment: BodyIncrement) -> bool:
        """Return whether nothing has measured the slip of an increment."""
        return not increment.is_measured and not (self._is_compensated and increment.is_sure)

    def _let_slip_change(self, ground_m: float, state: list[float]) -> None:
        """Set the slip's part of transition, noise and `state` for a travel of `ground_m`.

        All slips go on changing, also those that do not act. Slip belongs to a place: while the wheels turn
        and the rover stays where it is, it is the same.
        """
        keep = math.exp(-ground_m / self._settings.slip_distance_m)
        assumed = math.exp(-ground_m / self.prior.distance_m)
        self._slip_slopes[:] = 0.0
        self._slip_keeps[:] = keep
        self._slip_noises[:] = 1.0 - keep * keep
        self._slip_keeps[self._assumed] = assumed
        self._slip_noises[self._assumed] = 1.0 - assumed * assumed
        for index, kept in enumerate(self._slip_keeps.tolist(), self._layout.first_slip):
            state[index] *= kept

    def _let_measured_slip_change(self, rolled_m: float, before: list[float], state: list[float]) -> None:
        """Let the slip that a camera measures walk at random over the travel of the wheels.

        It does not return to zero by itself: then it would lag behind a slip that stays.
        """
        first = self._layout.measured_slip - self._layout.first_slip
        index = self._layout.measured_slip
        state[index : index + 2] = before
        self._slip_keeps[first:] = 1.0
        self._slip_noises[first:] = -math.expm1(-2.0 * rolled_m / self._settings.slip_distance_m)

    def _set_noise(self, increment: BodyIncrement, turn: Turn) -> None:
        settings = self._settings
        distance_m = math.hypot(increment.x_m, increment.y_m)
        noise_m_sqrt_m = (
            settings.position_noise_m_sqrt_m if increment.is_sure else settings.unsure_position_noise_m_sqrt_m
        )
        if increment.is_measured:
            noise_m_sqrt_m = ESTIMATION.ground.noise_m_sqrt_m
        elif self.prior.noise_m_sqrt_m is not None and self._acts_by_prior(increment):
            noise_m_sqrt_m = self.prior.noise_m_sqrt_m
        position_m2 = noise_m_sqrt_m**2 * distance_m
        if self._acts_by_prior(increment):
            position_m2 += self.prior.noise_m_sqrt_rad**2 * abs(turn.angle_rad)
        yaw_rad2 = 0.0
        by_wheels_rad: float | None = turn.angle_rad
        if turn.source is YawSource.GYRO:
            yaw_rad2 = settings.gyro_noise_rad_sqrt_s**2 * turn.covered_s + turn.unobserved_rad2
            by_wheels_rad = turn.by_wheels_rad
        if by_wheels_rad is not None:
            yaw_rad2 += (
                settings.wheel_yaw_noise_rad_sqrt_rad**2 * abs(by_wheels_rad)
                + settings.wheel_yaw_noise_rad_sqrt_m**2 * distance_m
            )
        bias_rad2_s2 = settings.gyro_bias_walk_rad_s_sqrt_s**2 * increment.duration_s
        noise = self._noise
        noise[X, Y] = noise[Y, X] = 0.0
        noise[X, X] = noise[Y, Y] = position_m2
        noise[YAW, YAW], noise[BIAS, BIAS] = yaw_rad2, bias_rad2_s2


def _greatest_variance(covariance: Array) -> float:
    """Return the variance of the position along its most uncertain axis."""
    xx, xy, yy = float(covariance[X, X]), float(covariance[X, Y]), float(covariance[Y, Y])
    return 0.5 * (xx + yy) + math.hypot(0.5 * (xx - yy), xy)
