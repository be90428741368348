"""What odometry, slip estimator and covariance are worth, by marks measured by hand.

Squares in both senses: J. Borenstein, L. Feng: Measurement and Correction of Systematic Odometry Errors in
Mobile Robots. IEEE Transactions on Robotics and Automation 12 (1996) 869-880, section III (UMBmark).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rover_hil.drives.arrays import Array, rms
from rover_hil.drives.marks import Marks
from rover_hil.drives.quality.consistency import LEAST_ERRORS, Consistency, consistency
from rover_hil.ready.commission.drive import Poses

LEAST_SLIP_SHARE = 0.5
"""Of the driven time with a valid slip."""
GREATEST_SLIP_ERROR = 0.05
LEAST_LEG_M = 0.2


@dataclass(frozen=True, slots=True, kw_only=True)
class MarkError:
    """Errors at one mark.

    Attributes:
        drive: Name of the drive.
        t_s: Time of the mark.
        odometry_m: Error of the wheels' position in x and y, (2,).
        estimate_m: Error of the estimate's, (2,).
        odometry_deg, estimate_deg: Of the yaw; NaN where it was not measured.
        sigma_m: Standard deviation that the estimate gives for its position, with those of mark and start.
        nees: Squared error over its covariance, those of mark and start added; expected are `dimensions`.
        dimensions: 3 with yaw, 2 without.
    """

    drive: str
    t_s: float
    odometry_m: Array
    estimate_m: Array
    odometry_deg: float
    estimate_deg: float
    sigma_m: float
    nees: float
    dimensions: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Worth:
    """What came out.

    Attributes:
        marks: Errors at each mark.
        systematic_m: UMBmark's greatest systematic error of the odometry, the distance of the centre of the
            ends of the squares in one sense from the true ends, the larger of both; NaN without squares.
        estimate_systematic_m: The same of the estimate.
        scatter_m: Scatter of the odometry's ends about their centres.
        distance_m: Measured length of all legs between marks.
        odometry_slip: Share of the wheels' distance that was slip.
        estimate_slip: The slip that the estimate removed.
        covariance: Errors at the marks over the covariance of the estimate.
        slip_share: Share of the driven time with a valid slip; NaN without a slip estimator.
    """

    marks: tuple[MarkError, ...]
    systematic_m: float
    estimate_systematic_m: float
    scatter_m: float
    distance_m: float
    odometry_slip: float
    estimate_slip: float
    covariance: Consistency
    slip_share: float

    @property
    def has_slip(self) -> bool:
        """Whether the configuration has a slip estimator."""
        return not math.isnan(self.slip_share)

    @property
    def slip_error(self) -> float:
        """Error of the estimated slip."""
        return self.estimate_slip - self.odometry_slip

    @property
    def odometry_rms_m(self) -> float:
        """Root mean square error of the odometry at the marks."""
        return rms(np.array([np.hypot(*each.odometry_m) for each in self.marks]))

    @property
    def estimate_rms_m(self) -> float:
        """Root mean square error of the estimate at the marks."""
        return rms(np.array([np.hypot(*each.estimate_m) for each in self.marks]))

    @property
    def doubts(self) -> tuple[str, ...]:
        """Why the estimate did not pass on this ground; empty where it did.

        A rover without a slip estimator is not expected to know its slip.
        """
        sentences = []
        if len(self.marks) < LEAST_ERRORS:
            sentences.append(f"{len(self.marks)} marks were measured, {LEAST_ERRORS} are needed")
        if self.has_slip and self.slip_share < LEAST_SLIP_SHARE:
            sentences.append(f"the slip was valid for {100 * self.slip_share:.0f} % of the driven time only")
        if self.has_slip and math.isnan(self.slip_error):
            sentences.append(f"no slip was measured: two marks in succession must be {LEAST_LEG_M:g} m apart")
        elif self.has_slip and abs(self.slip_error) > GREATEST_SLIP_ERROR:
            sentences.append(f"the estimated slip is wrong by {100 * self.slip_error:+.1f} % of the distance")
        if self.estimate_rms_m > self.odometry_rms_m:
            sentences.append("the estimate is farther off than the wheels alone")
        if self.covariance.is_too_small:
            sentences.append("the covariance is too small")
        return tuple(sentences)

    @property
    def problem(self) -> str:
        """All of them in one text."""
        return "; ".join(self.doubts)


def find_worth(drives: Sequence[tuple[str, Poses, Marks]]) -> Worth:
    """Return what odometry and estimate are worth.

    Args:
        drives: Name, poses and marks of each. The ends of drives whose names begin with `square-left` and
            `square-right` are those of UMBmark.
    """
    errors = [error for name, poses, marks in drives for error in _mark_errors(name, poses, marks)]
    lengths = np.array([_lengths(poses, marks) for _, poses, marks in drives]).reshape(-1, 3).sum(axis=0)
    true_m, wheels_m, estimate_m = lengths.tolist()
    shares = [poses.slip_share for _, poses, _ in drives]
    ends = {
        sense: [
            _end_error(poses, marks) for name, poses, marks in drives if name.startswith(f"square-{sense}")
        ]
        for sense in ("left", "right")
    }
    centres = [np.mean([pair[0] for pair in pairs], axis=0) for pairs in ends.values() if pairs]
    centres_estimate = [np.mean([pair[1] for pair in pairs], axis=0) for pairs in ends.values() if pairs]
    scatter = [
        np.hypot(*(pair[0] - centre))
        for pairs, centre in zip([each for each in ends.values() if each], centres, strict=True)
        for pair in pairs
    ]
    return Worth(
        marks=tuple(errors),
        systematic_m=max((float(np.hypot(*centre)) for centre in centres), default=math.nan),
        estimate_systematic_m=max(
            (float(np.hypot(*centre)) for centre in centres_estimate), default=math.nan
        ),
        scatter_m=rms(np.array(scatter)) if scatter else math.nan,
        distance_m=true_m,
        odometry_slip=1.0 - true_m / wheels_m if wheels_m > 0.0 else math.nan,
        estimate_slip=1.0 - estimate_m / wheels_m if wheels_m > 0.0 else math.nan,
        covariance=consistency(
            [each.nees for each in errors],
            [each.dimensions for each in errors],
            len({each.drive for each in errors}),
        ),
        slip_share=float(np.mean(shares)) if shares and np.isfinite(shares).all() else math.nan,
    )


def _mark_errors(name: str, poses: Poses, marks: Marks) -> list[MarkError]:
    errors = []
    for number in range(len(marks.t_s)):
        place = poses.at(float(marks.t_s[number]))
        true = np.array([marks.x_m[number], marks.y_m[number]])
        yaw_rad = math.radians(float(marks.yaw_deg[number]))
        has_yaw = math.isfinite(yaw_rad)
        yaw_errors = [
            math.remainder(float(track[place, 2]) - yaw_rad, math.tau) if has_yaw else math.nan
            for track in (poses.odometry, poses.estimate)
        ]
        size = 3 if has_yaw else 2
        covariance = (poses.covariance[place] + _start_covariance(marks, true))[:size, :size]
        covariance[0, 0] += marks.sigma_m[number] ** 2
        covariance[1, 1] += marks.sigma_m[number] ** 2
        error = np.append(poses.estimate[place, :2] - true, yaw_errors[1:] if has_yaw else [])
        if has_yaw:
            covariance[2, 2] += marks.yaw_sd_rad[number] ** 2
        errors.append(
            MarkError(
                drive=name,
                t_s=float(marks.t_s[number]),
                odometry_m=poses.odometry[place, :2] - true,
                estimate_m=poses.estimate[place, :2] - true,
                odometry_deg=math.degrees(yaw_errors[0]),
                estimate_deg=math.degrees(yaw_errors[1]),
                sigma_m=math.sqrt(0.5 * float(covariance[0, 0] + covariance[1, 1])),
                nees=float(error @ np.linalg.solve(covariance, error)),
                dimensions=size,
            )
        )
    return errors


def _start_covariance(marks: Marks, place_m: Array) -> Array:
    """Return the covariance of a pose at a place from putting the rover on its start mark by hand, (3, 3)."""
    turn = np.array([-place_m[1], place_m[0], 1.0])
    shifted = marks.start_sd_m**2 * np.diag([1.0, 1.0, 0.0])
    covariance: Array = shifted + marks.start_yaw_sd_rad**2 * np.outer(turn, turn)
    return covariance


def _end_error(poses: Poses, marks: Marks) -> tuple[Array, Array]:
    """Return the error of wheels and estimate in x and y at the last mark."""
    place = poses.at(float(marks.t_s[-1]))
    true = np.array([marks.x_m[-1], marks.y_m[-1]])
    return poses.odometry[place, :2] - true, poses.estimate[place, :2] - true


def _lengths(poses: Poses, marks: Marks) -> tuple[float, float, float]:
    """Return the lengths of the lines from mark to mark: measured, by the wheels, by the estimate."""
    places = [0, *(poses.at(t_s) for t_s in marks.t_s.tolist())]
    true = np.vstack(([[0.0, 0.0]], np.column_stack((marks.x_m, marks.y_m))))
    steps_m = np.hypot(*np.diff(true, axis=0).T)
    use = steps_m >= LEAST_LEG_M
    wheels_m, estimate_m = (
        float(np.hypot(*np.diff(track[places, :2], axis=0).T)[use].sum())
        for track in (poses.odometry, poses.estimate)
    )
    return float(steps_m[use].sum()), wheels_m, estimate_m
