"""Pose of the rover: an extended Kalman filter of pose, gyro bias, and the frames of other devices."""

import cmath
import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from controllers.estimation.guarded_filter import FilterStep, GuardedFilter, Innovation
from controllers.estimation.measurements.heading import HeadingModel
from controllers.estimation.odometry import BodyIncrement
from controllers.estimation.parameters import ESTIMATION
from controllers.estimation.pose_fixes import Step, WayBack, displaced
from controllers.estimation.settings import FilterSettings
from controllers.estimation.slip_states import SlipStates, SlipStep
from controllers.estimation.state_layout import BIAS, SCALE, YAW, StateLayout, X, Y, lay_out
from controllers.ground_motion.motion import GroundMotion
from controllers.matrices import complex_product, product
from controllers.motion.planar import Pose, move, wrap_angle
from drivers.record import record
from drivers.samples import UNKNOWN_YAW_STD_RAD, HeadingReference, PoseFixSample

Array = NDArray[np.float64]

LEAST_BASELINE_SD = 10.0
"""Two fixes without yaw turn the floor's axes from so many deviations of their difference on: to 6 deg."""


class YawSource(StrEnum):
    """Source of the yaw: the gyro, or the wheels at rest and while there is no fresh gyro."""

    GYRO = "gyro"
    WHEELS = "wheels"


@record(frozen=True, slots=True, kw_only=True)
class Turn:
    """Measured turn of the rover.

    Attributes:
        angle_rad: Bias of the gyro included.
        source: Source of the measurement.
        covered_s: The time over which the gyro's bias entered; 0 for the wheels.
        by_wheels_rad: Part of the angle that the wheels measured in a gap of the gyro; None without a gap.
        gap_error_rad: Greatest error of this part.
        unseen_rad2: Variance of what the gyro did not see between its readings.
    """

    angle_rad: float
    source: YawSource
    covered_s: float = 0.0
    by_wheels_rad: float | None = None
    gap_error_rad: float = 0.0
    unseen_rad2: float = 0.0


@record(frozen=True, slots=True, kw_only=True)
class PoseEstimate:
    """The estimated motion in the local frame: origin and x axis are the pose at start, y to the left.

    Attributes:
        t_ns: Time of the wheel positions that the position is based on. The yaw is that of the newest reading
            of gyro or wheels.
        velocity_x_m_s: In the body frame, as are `velocity_y_m_s` and `yaw_rate_rad_s`.
        gyro_bias_rad_s: Reading of the gyro at rest.
        covariance: Upper triangle over (x, y, yaw) by rows: xx, xy, x yaw, yy, y yaw, yaw yaw. Of the pose in
            the cycle: it contains the travel since `t_ns`.
        yaw_source: Source of the last turn.
    """

    t_ns: int
    x_m: float
    y_m: float
    yaw_rad: float
    velocity_x_m_s: float
    velocity_y_m_s: float
    yaw_rate_rad_s: float
    gyro_bias_rad_s: float
    covariance: tuple[float, float, float, float, float, float]
    yaw_source: YawSource

    @property
    def is_finite(self) -> bool:
        """Return whether every number is finite."""
        return math.isfinite(
            self.x_m
            + self.y_m
            + self.yaw_rad
            + self.velocity_x_m_s
            + self.velocity_y_m_s
            + self.yaw_rate_rad_s
            + self.gyro_bias_rad_s
            + sum(self.covariance)
        )


@dataclass(frozen=True, slots=True)
class _Unoriented:
    """The first fix of a device that gives no yaw: by the fix, and in the local frame."""

    place_m: complex
    then_m: complex
    position_std_m: float


def _has_yaw(fix: PoseFixSample) -> bool:
    return not fix.yaw_std_rad >= UNKNOWN_YAW_STD_RAD


class PoseFilter:
    """State [x, y, yaw, gyro bias, offsets, origins, frame, remaining slip, states of the slip compensator].

    There is one offset per heading device and reference.

    An offset is the heading at a yaw of zero. It starts unknown. While the rover settles the yaw is certain,
    so the first headings give the offset, and later ones correct the yaw as far as the offset is known.
    Magnetic and true headings have offsets of their own.

    An origin is the pose of the local frame on the floor of a device that gives fixes, three states. It is
    estimated in the same way: the first fix ties the frames together, best while the rover is at rest, and
    later ones correct pose and origin as far as each is known. The mission stays in the local frame.

    A slip compensator may have states of its own. They turn the motion of the wheels into that of the body,
    so that every measurement corrects pose, gyro bias and slip together.

    The slip that remains is a share of the way of the wheels, along it and across: two first-order
    Gauss-Markov processes over the travel (Gelb 1974, section 3.8), as states in units of their standard
    deviation. Its effect on the position grows with the distance, not with its root, and fixes correct it
    together with the position. With compensation there are two such pairs: what it leaves, and the slip of
    wheels where it is not valid. These states are left out where all standard deviations are 0.

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
    ) -> None:
        self._settings = settings
        self._layout = layout = lay_out(
            settings,
            heading_devices,
            fix_devices,
            is_compensated=is_compensated,
            has_ground=has_ground,
            block_variances=() if slip is None else slip.start_variances.tolist(),
        )
        self._rejections: dict[str, int] = {}
        self._unoriented: dict[str, _Unoriented] = {}
        self._has_scale = False
        self._slip = slip
        start = np.zeros(layout.size)
        if slip is not None:
            start[layout.block] = slip.start
        self._filter = GuardedFilter(
            start.tolist(), layout.variances, layout.angles, settings.gate_probability
        )
        self._transition = np.eye(layout.size)
        self._noise = np.zeros((layout.size, layout.size))
        remaining = slice(layout.first_slip, layout.first_slip + 2 * layout.slip_pairs)
        self._slip_slopes = self._transition[:YAW, remaining]
        # Views of the diagonals.
        self._slip_keeps = np.einsum("ii->i", self._transition)[remaining]
        self._slip_noises = np.einsum("ii->i", self._noise)[remaining]
        self._bias_row = np.eye(layout.size)[BIAS]

    def keep_steps(self) -> list[FilterStep]:
        """Keep every step of the filter from now on, for a smoother; return the growing list."""
        return self._filter.keep_steps()

    @property
    def layout(self) -> StateLayout:
        """Where each part of the state is."""
        return self._layout

    @property
    def pose(self) -> Pose:
        """The estimated pose."""
        x_m, y_m, yaw_rad = self._filter.state[:BIAS]
        return Pose(x_m=x_m, y_m=y_m, yaw_rad=yaw_rad)

    @property
    def gyro_bias_rad_s(self) -> float:
        """The estimated bias of the gyro."""
        return self._filter.value(BIAS)

    @property
    def covariance(self) -> tuple[float, float, float, float, float, float]:
        """Upper triangle of the covariance over (x, y, yaw), by rows."""
        x_row, y_row, yaw_row = self._filter.covariance[:BIAS]
        return (x_row[X], x_row[Y], x_row[YAW], y_row[Y], y_row[YAW], yaw_row[YAW])

    def predict(self, increment: BodyIncrement, turn: Turn) -> Step:
        """Move by the wheels' increment, rotated by the mid heading; `turn` replaces the turn of the wheels.

        Returns:
            The step that was made.
        """
        state = self._filter.state
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
        active, slip_sd, across_sd = self._active_slip(increment)
        remaining, ground_m = 0j, abs(travel_m)
        if self._layout.slip_pairs:
            remaining = complex(slip_sd * state[active], across_sd * state[active + 1])
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
        if self._layout.slip_pairs:
            way_m = rolled_m * toward
            self._let_slip_change(ground_m, state)
            if increment.is_measured:
                self._let_measured_slip_change(abs(rolled_m), state)
            for index, effect_m in ((active, slip_sd * way_m), (active + 1, across_sd * 1j * way_m)):
                self._transition[X, index], self._transition[Y, index] = effect_m.real, effect_m.imag
        if by_slip is not None:
            self._take_slip(by_slip, toward * (1.0 + remaining), state)
        self._filter.predict(increment.duration_s, state, transition, self._noise)
        by_wheels_m = increment.rolled_m
        return Step(
            x_m=travel_m.real,
            y_m=travel_m.imag,
            turn_rad=turn_rad,
            duration_s=increment.duration_s,
            position_m2=_greatest_variance(self._noise),
            yaw_rad2=float(self._noise[YAW, YAW]),
            rolled_m=complex(increment.x_m, increment.y_m) if by_wheels_m is None else by_wheels_m,
            slip_sd=math.hypot(slip_sd, across_sd),
        )

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

    def widen(self, x_m: float, y_m: float, yaw_rad: float) -> None:
        """Add the uncertainty of motion that was not measured.

        Any value from zero to the greatest is equally likely, hence the variance of a third of its square.

        Args:
            x_m: The rover may have moved forward or backward by this at most.
            y_m: The same to the left or right.
            yaw_rad: It may have turned by this at most.
        """
        direction = cmath.rect(1.0, self._filter.value(YAW))
        noise = np.zeros_like(self._noise)
        for axis, greatest_m in ((direction, x_m), (1j * direction, y_m)):
            column = np.array([axis.real, axis.imag])
            noise[:YAW, :YAW] += np.outer(column, column) * greatest_m**2 / 3.0
        noise[YAW, YAW] = yaw_rad**2 / 3.0
        self._filter.widen_by(noise)

    def correct_heading(
        self, device: str, reference: HeadingReference, heading_rad: float, turned_since_rad: float
    ) -> Innovation:
        """Correct by a heading; `turned_since_rad` is the turn of the rover since it was measured."""
        source = (device, reference)
        model = HeadingModel(
            name=f"{device} {reference}",
            offset_index=self._layout.offsets[source],
            deviation_index=self._layout.deviations.get(source),
            turned_since_rad=turned_since_rad,
            sd_rad=self._settings.heading_noise_rad,
        )
        return self._filter.correct(model, (heading_rad,))[0]

    def correct_bias(self, device: str, rate_rad_s: float) -> Innovation:
        """Correct by a gyro reading at standstill: it is the bias."""
        return self._filter.update(
            f"{device} standstill",
            rate_rad_s - self._filter.value(BIAS),
            self._bias_row,
            self._settings.gyro_rate_noise_rad_s**2,
        )

    @property
    def gyro_bias_rad2_s2(self) -> float:
        """Its variance."""
        return self._filter.covariance[BIAS][BIAS]

    def doubt_bias(self, error_rad_s: float) -> float:
        """Make the bias uncertain by an error that it may have, and all that depends on it.

        The covariance becomes what it would be had the bias been as uncertain before: every state follows the
        bias by its regression on it.

        Returns:
            By how much the yaw is wrong with that error.
        """
        column = np.array([row[BIAS] for row in self._filter.covariance])
        followed = error_rad_s * column / column[BIAS]
        self._filter.widen_by(np.outer(followed, followed))
        return abs(float(followed[YAW]))

    @property
    def slip_values(self) -> Array:
        """The states of the slip compensator, shape (n,)."""
        return np.array(self._filter.state[self._layout.block])

    def correct_slip(
        self, name: str, residual: float, slopes: Array, bias_slope: float, variance: float
    ) -> Innovation:
        """Correct by a measurement of the slip, see `SlipEstimate`."""
        row = np.zeros(self._layout.size)
        row[BIAS], row[self._layout.block] = bias_slope, slopes
        return self._filter.update(name, residual, row, variance)

    def widen_slip(self, index: int, variance: float) -> None:
        """Increase the variance of one state of the slip compensator."""
        self._filter.widen(self._layout.block.start + index, variance)

    def doubt_slip(self) -> None:
        """Make the states of slip as uncertain as at the start: what has taught them was wrong."""
        variances = () if self._slip is None else self._slip.start_variances
        covariance = self._filter.covariance
        for index, variance in enumerate(variances, self._layout.block.start):
            self._filter.widen(index, max(0.0, float(variance) - covariance[index][index]))

    def correct_pose(self, fix: PoseFixSample, way_back: WayBack) -> tuple[Innovation, ...]:
        """Correct by a fix of the pose; `way_back` leads from the present pose to that at exposure.

        A fix is accepted or rejected as a whole. After two rejections in a row the rover has been moved, or
        has slipped more than the noise allows: the uncertainty of the pose then becomes its difference from
        the next fix, which is reported as displaced.
        """
        origin = self._layout.origins[fix.device]
        if fix.device not in self._rejections and not _has_yaw(fix):
            if not self._orient(origin, fix, way_back):
                return ()
        elif fix.device not in self._rejections and math.isfinite(fix.x_m + fix.y_m + fix.yaw_rad):
            self._rejections[fix.device] = 0
            self._assign_origin(origin, fix, way_back)
        innovations = self._update_pose(origin, fix, way_back)
        if innovations[0].accepted:
            self._rejections[fix.device] = 0
            return innovations
        residuals = [innovation.residual for innovation in innovations if innovation.residual is not None]
        if len(residuals) < len(innovations):
            return innovations
        self._rejections[fix.device] += 1
        if self._rejections[fix.device] <= ESTIMATION.pose.most_rejections:
            return innovations
        self._rejections[fix.device] = 0
        # The axes of the floor are not those of the local frame: widen both by the distance.
        distance_m2 = residuals[X] ** 2 + residuals[Y] ** 2
        turned_rad = residuals[YAW] if _has_yaw(fix) else 0.0
        for index, variance in ((X, distance_m2), (Y, distance_m2), (YAW, turned_rad**2)):
            self._filter.widen(index, variance)
        report = displaced(fix, math.sqrt(distance_m2), abs(turned_rad))
        return (*self._update_pose(origin, fix, way_back), *report[: len(innovations) - 1])

    def _then(self, way_back: WayBack) -> tuple[complex, float]:
        """Return place and yaw of the rover in the local frame at exposure."""
        x_m, y_m, yaw_rad = self._filter.state[:BIAS]
        arm_m = complex(way_back.x_m, way_back.y_m) * cmath.rect(1.0, yaw_rad)
        return complex(x_m, y_m) + arm_m, yaw_rad - way_back.turned_rad

    def _assign_origin(self, origin: int, fix: PoseFixSample, way_back: WayBack) -> None:
        """Set the unknown origin by the first fix."""
        then_m, then_rad = self._measured_place(fix, way_back)
        origin_rad = wrap_angle(fix.yaw_rad - then_rad)
        origin_m = complex(fix.x_m, fix.y_m) - then_m * cmath.rect(1.0, origin_rad)
        for index, value in zip((X, Y, YAW), (origin_m.real, origin_m.imag, origin_rad), strict=True):
            self._filter.assign(origin + index, value)

    def _orient(self, origin: int, fix: PoseFixSample, way_back: WayBack) -> bool:
        """Set the unknown origin by two fixes without yaw that lie far apart; returns whether it is set.

        The axes of the floor are turned by the direction between the two places by the fixes less that by
        the motion of the rover. So it does not matter whether the rover drives ahead, back or aside.
        """
        then_m, _ = self._measured_place(fix, way_back)
        place_m = complex(fix.x_m, fix.y_m)
        if not cmath.isfinite(place_m) or not 0.0 < fix.position_std_m < math.inf:
            return False
        first = self._unoriented.setdefault(fix.device, _Unoriented(place_m, then_m, fix.position_std_m))
        moved_m, fixed_m = then_m - first.then_m, place_m - first.place_m
        least_m = LEAST_BASELINE_SD * math.hypot(fix.position_std_m, first.position_std_m)
        if min(abs(moved_m), abs(fixed_m)) < least_m or abs(abs(fixed_m) - abs(moved_m)) > 0.5 * abs(moved_m):
            return False
        origin_rad = wrap_angle(cmath.phase(fixed_m) - cmath.phase(moved_m))
        origin_m = place_m - then_m * cmath.rect(1.0, origin_rad)
        for index, value in zip((X, Y, YAW), (origin_m.real, origin_m.imag, origin_rad), strict=True):
            self._filter.assign(origin + index, value)
        self._rejections[fix.device] = 0
        return True

    def _measured_place(self, fix: PoseFixSample, way_back: WayBack) -> tuple[complex, float]:
        """Return, in the local frame, where a fix was measured on the rover, and the yaw of the rover."""
        then_m, then_rad = self._then(way_back)
        return then_m + complex(fix.arm_x_m, fix.arm_y_m) * cmath.rect(1.0, then_rad), then_rad

    def _update_pose(self, origin: int, fix: PoseFixSample, way_back: WayBack) -> tuple[Innovation, ...]:
        state = self._filter.state
        then_m, then_rad = self._measured_place(fix, way_back)
        frame = cmath.rect(1.0, state[origin + YAW])
        expected_m = complex(state[origin + X], state[origin + Y]) + frame * then_m
        residual_m = complex(fix.x_m, fix.y_m) - expected_m
        # Derivatives of the expected place over the states; x is the real part, y the imaginary one.
        slopes = np.zeros(len(state), dtype=complex)
        slopes[X], slopes[Y] = frame, 1j * frame
        slopes[YAW] = 1j * frame * (then_m - complex(state[X], state[Y]))
        slopes[origin + X], slopes[origin + Y] = 1.0, 1j
        slopes[origin + YAW] = 1j * frame * then_m
        position_m2 = fix.position_std_m**2 + way_back.position_m2
        names, residuals = ["x", "y"], [residual_m.real, residual_m.imag]
        rows, variances = [slopes.real, slopes.imag], [position_m2, position_m2]
        if _has_yaw(fix):
            yaw_row = np.zeros(len(state))
            yaw_row[YAW] = yaw_row[origin + YAW] = 1.0
            names.append("yaw")
            residuals.append(wrap_angle(fix.yaw_rad - then_rad - state[origin + YAW]))
            rows.append(yaw_row)
            variances.append(fix.yaw_std_rad**2 + way_back.yaw_rad2)
        return self._filter.update_together(
            [f"{fix.device} {name}" for name in names],
            np.array(residuals),
            np.array(rows),
            np.array(variances),
        )

    def _active_slip(self, increment: BodyIncrement) -> tuple[int, float, float]:
        """Return the index of the slip that acts, and its standard deviations along and across the travel."""
        settings = self._settings
        if increment.is_measured:
            sd = ESTIMATION.ground.slip_sd
            return self._layout.measured_slip, sd, sd
        if self._layout.estimated_pairs < 2 or not increment.is_sure:
            index = self._layout.first_slip + max(0, 2 * self._layout.estimated_pairs - 2)
            sd = settings.unsure_slip_sd if self._layout.estimated_pairs else 0.0
        else:
            index = self._layout.first_slip
            sd = math.hypot(settings.slip_sd, settings.slip_sd_share * (increment.slip_sd or 0.0))
        return index, sd, settings.cross_slip_ratio * sd

    @property
    def measured_slip(self) -> complex:
        """What is added to the wheels' travel while the motion is measured, as a share; left imaginary."""
        state, index = self._filter.state, self._layout.measured_slip
        return ESTIMATION.ground.slip_sd * complex(state[index], state[index + 1])

    def mark_frame(self, way_back: WayBack) -> None:
        """Keep the pose at the exposure of a frame; `way_back` leads to it from the present pose."""
        frame = self._layout.frame
        then_m, then_rad = self._then(way_back)
        state = self._filter.state
        arm_m = then_m - complex(state[X], state[Y])
        transition = np.eye(len(state))
        transition[frame : frame + BIAS] = 0.0
        transition[[frame + X, frame + Y, frame + YAW], [X, Y, YAW]] = 1.0
        transition[frame + X, YAW], transition[frame + Y, YAW] = -arm_m.imag, arm_m.real
        state[frame : frame + BIAS] = then_m.real, then_m.imag, then_rad
        self._filter.predict(0.0, state, transition, np.zeros_like(transition))

    def correct_ground(
        self, device: str, motion: GroundMotion, way_back: WayBack, *, corrects_yaw: bool
    ) -> tuple[Innovation, ...]:
        """Correct by the motion over the ground since the frame of `mark_frame`.

        A motion that the wheels do not explain, as of a rover pushed at rest, is reported as rejected.
        It is taken nevertheless: the camera sees the rover itself, and what it saw would be lost for good.

        Args:
            device: Name of the camera.
            motion: A valid one, from the time of that frame on.
            way_back: From the present pose to that at the later frame.
            corrects_yaw: Whether the turn is used, too; a gyro that is fresh measures it better.
        """
        frame, state = self._layout.frame, self._filter.state
        if not self._has_scale:
            self._has_scale = True
            self._filter.widen(frame + SCALE, motion.scale_sd**2)
        then_m, then_rad = self._then(way_back)
        before_m, before_rad = complex(state[frame + X], state[frame + Y]), state[frame + YAW]
        turn_rad = wrap_angle(then_rad - before_rad)
        axes, point_m = cmath.rect(1.0, -then_rad), complex(*motion.point_m)
        swing_m = point_m * cmath.rect(1.0, -turn_rad)
        factor = 1.0 + state[frame + SCALE]
        chord_m = axes * (then_m - before_m)
        travel_m = chord_m + point_m - swing_m
        # Derivatives of the expected travel over the states, to the left as imaginary part.
        slopes = np.zeros(len(state), dtype=complex)
        slopes[X], slopes[Y] = factor * axes, factor * 1j * axes
        arm_m = then_m - complex(state[X], state[Y])
        slopes[YAW] = factor * 1j * (axes * arm_m - chord_m + swing_m)
        slopes[frame + X], slopes[frame + Y] = -slopes[X], -slopes[Y]
        slopes[frame + YAW] = -factor * 1j * swing_m
        slopes[frame + SCALE] = travel_m
        turn_row = np.zeros(len(state))
        turn_row[YAW], turn_row[frame + YAW] = 1.0, -1.0
        residual_m = complex(motion.forward_m, motion.left_m) - factor * travel_m
        names = [f"{device} forward", f"{device} left", f"{device} turn"]
        residuals = np.array([residual_m.real, residual_m.imag, wrap_angle(motion.turn_rad - turn_rad)])
        rows = np.array([slopes.real, slopes.imag, turn_row])
        variances = np.array([motion.forward_sd_m**2, motion.left_sd_m**2, motion.turn_sd_rad**2])
        used = slice(3 if corrects_yaw else 2)
        measured = names[used], residuals[used], rows[used], variances[used]
        innovations = self._filter.update_together(*measured)
        if not innovations[0].accepted and math.isfinite(abs(residual_m)):
            for index, variance in ((X, abs(residual_m) ** 2), (Y, abs(residual_m) ** 2)):
                self._filter.widen(index, variance)
            if corrects_yaw:
                self._filter.widen(YAW, float(residuals[YAW]) ** 2)
            self._filter.update_together(*measured)
        return innovations

    def _let_slip_change(self, ground_m: float, state: list[float]) -> None:
        """Set the slip's part of transition, noise and `state` for a travel of `ground_m`.

        All slips go on changing; one of them acts. Slip belongs to a place: while the wheels turn and the
        rover stays where it is, it is the same.
        """
        keep = math.exp(-ground_m / self._settings.slip_distance_m)
        self._slip_slopes[:] = 0.0
        self._slip_keeps[:] = keep
        self._slip_noises[:] = 1.0 - keep * keep
        for index in range(self._layout.first_slip, self._layout.first_slip + 2 * self._layout.slip_pairs):
            state[index] *= keep

    def _let_measured_slip_change(self, rolled_m: float, state: list[float]) -> None:
        """Let the slip that a camera measures walk at random over the travel of the wheels.

        It does not return to zero by itself: then it would lag behind a slip that stays.
        """
        first = 2 * self._layout.estimated_pairs
        index = self._layout.measured_slip
        state[index : index + 2] = self._filter.state[index : index + 2]
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
        position_m2 = noise_m_sqrt_m**2 * distance_m
        yaw_rad2 = 0.0
        by_wheels_rad: float | None = turn.angle_rad
        if turn.source is YawSource.GYRO:
            yaw_rad2 = settings.gyro_noise_rad_sqrt_s**2 * turn.covered_s + turn.unseen_rad2
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
