"""Motion of the rover between two frames, from the optical flow of the rectified ground.

Points of the ground are followed from patch to patch (pyramidal Lucas-Kanade), in pictures of the fine
structure of the ground, from several starts: a point follows what is nearest to its start. The densest group
of similar motions starts a robust fit with the gyro's angles as prior, which gives the motion of the
reference point, the turn, and the change of roll and pitch. Points on passing shadows are not in this group.
What is fixed in the picture (specks, shadows of the rover) forms a group of its own, without motion.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from controllers.ground_motion.ground_patch import Floats, GroundPatch, Mask
from controllers.ground_motion.parameters import FlowParameters
from drivers.samples import Image

Angles = tuple[float, float, float]

MOST_CELLS = 1_000_000
"""Of the plane of motions; more are of points that went astray."""


class Tracks(NamedTuple):
    """Points of the rectified ground, and where they went.

    Attributes:
        before: Columns and rows in the earlier frame (points x 2).
        after: In the later one.
        tracked: Which of them could be followed.
        follows: Which of these move with the ground.
    """

    before: Floats
    after: Floats
    tracked: Mask
    follows: Mask


@dataclass(frozen=True, slots=True, kw_only=True)
class PatchMotion:
    """Motion of the reference point in the axes of the patch, at the later frame.

    Attributes:
        forward_m: Along the axis of the patch.
        left_m: Across it.
        turn_rad: Counter-clockwise.
        tilt_rad: Change of roll and pitch.
        forward_sd_m: Standard deviation of `forward_m`, by the fit.
        left_sd_m: Standard deviation of `left_m`.
        turn_sd_rad: Standard deviation of `turn_rad`.
        points: Points that move with the ground.
        share: Their share of the points in both views.
        moved_pixels: Mean motion of these points in the picture.
        moved_sd_pixels: Standard deviation of this mean, by the scatter of the points.
        ambiguity: Points that another motion explains, over those of this one.
        tracks: The points; None where no pictures were compared.
    """

    forward_m: float
    left_m: float
    turn_rad: float
    tilt_rad: tuple[float, float]
    forward_sd_m: float
    left_sd_m: float
    turn_sd_rad: float
    points: int
    share: float
    moved_pixels: float
    moved_sd_pixels: float
    ambiguity: float = 0.0
    tracks: Tracks | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Followed:
    """Motions that the points of two patches share; None where too few points do.

    Attributes:
        moving: Of the densest group that moves in the picture.
        fixed: Of the points that do not; not fitted where the other group is the larger.
    """

    moving: PatchMotion | None
    fixed: PatchMotion | None


class _Samples(NamedTuple):
    """Where the points went, from each start, and what their motions mean.

    Attributes:
        moved: Motion ahead and left (points x starts x 2), m.
        usable: Which of these could be followed and are not left out (points x starts).
        tracked: Which of these could be followed.
        counts: Which points are not left out.
        base: Motion of the points by the given turn (points x 2).
        design: Motion of the points by unit motions on top of it (points x 2 x 5).
        shifts: Motion of the reference point that each sample means.
        angles: Expected further turn, roll and pitch.
        information: Inverse covariance of these.
        yaw_rad: The given turn.
    """

    moved: Floats
    usable: Mask
    tracked: Mask
    counts: Mask
    base: Floats
    design: Floats
    shifts: Floats
    angles: Floats
    information: Floats
    yaw_rad: float


class GroundFlow:
    """Measures motion between patches of one rig.

    Args:
        ground: The rectified ground.
        parameters: Tuned numbers.
    """

    def __init__(self, ground: GroundPatch, parameters: FlowParameters) -> None:
        self._parameters = parameters
        window = parameters.window_pixels
        self._window = (window, window)
        margin = cv2.erode(ground.visible.astype(np.uint8), np.ones(self._window, np.uint8), borderValue=0)
        step = _spacing_pixels(int(margin.sum()), parameters, is_coarse=ground.is_coarse)
        self._covariance_factor = parameters.covariance_factor * max(1.0, (window / step) ** 2)
        rows, columns = np.mgrid[step // 2 : ground.shape[0] : step, step // 2 : ground.shape[1] : step]
        keep = margin[rows, columns] > 0
        self._pixels = np.stack([columns[keep], rows[keep]], axis=1).astype(np.float64)
        self._seen = ground.visible
        self._ground = ground
        self._pixel_m = ground.pixel_m
        rig = ground.rig
        # Ahead and left of the patch's origin, in metres.
        places = ground.to_patch(np.stack([[*rig.point_m, 0.0], rig.position_m, np.zeros(3)]))
        self._reference, self._camera, self._origin = places * (-1.0, 1.0)
        self._height_m = float(rig.position_m[2])
        rows_left = [-(self._pixels[:, 1] + 0.5), self._pixels[:, 0] - ground.centre]
        self._points = np.stack(rows_left, axis=1) * self._pixel_m - self._reference

    def follow(
        self,
        before: Image,
        after: Image,
        starts_m: Floats,
        turn_rad: Angles,
        turn_sd_rad: Angles,
        most_m: float,
        left_out: Mask | None = None,
    ) -> Followed:
        """Return the motions between two patches.

        Args:
            before: Fine structure of the earlier ground, in grey levels.
            after: That of the later ground.
            starts_m: Motions to start from, rows of forward and left.
            turn_rad: Angles turned about x, y, z.
            turn_sd_rad: Standard deviation of each.
            most_m: Greatest length of the motion.
            left_out: Points that are not of the ground; None for none.
        """
        base, design = self._linearised(turn_rad[2])
        angles = np.array([0.0, *turn_rad[:2]])
        turned = base + design[:, :, 2:] @ angles
        moved, tracked = self._moved(before, after, turned, starts_m)
        counts = np.ones(len(tracked), np.bool_) if left_out is None else ~left_out
        usable = np.asarray(tracked & counts[:, None], np.bool_)
        information = np.diag(1 / np.array([turn_sd_rad[2], *turn_sd_rad[:2]]) ** 2)
        samples = _Samples(
            moved,
            usable,
            tracked,
            counts,
            base,
            design,
            turned[:, None] - moved,
            angles,
            information,
            turn_rad[2],
        )
        alike_m, slack_m = (
            pixels * self._pixel_m
            for pixels in (self._parameters.group_pixels, self._parameters.start_pixels)
        )
        fixed = usable & (np.hypot(moved[..., 0], moved[..., 1]) < alike_m)
        within = np.hypot(samples.shifts[..., 0], samples.shifts[..., 1]) < most_m + slack_m
        moving = self._fit(samples, usable & within & ~fixed)
        if moving is not None and moving.points > fixed.any(axis=1).sum():
            return Followed(moving=moving, fixed=None)
        return Followed(moving=moving, fixed=self._fit(samples, fixed))

    def points_m(self) -> Floats:
        """Return the points of the ground that are followed, behind and left of the patch's origin."""
        return np.asarray((self._points + self._reference) * (-1.0, 1.0), np.float64)

    def fitted(self, moved_m: Floats, turn_sd_rad: Angles) -> Floats:
        """Return the motions that fit displacements of the points (ahead, left), as `follow` fits them.

        Forward, left, turn, roll and pitch: a part of a displacement may pass for any of them.
        """
        sd_m = self._parameters.point_sd_pixels * self._pixel_m
        design = self._linearised(0.0)[1].reshape(-1, 5)
        normal = design.T @ design / sd_m**2
        normal[2:, 2:] += np.diag(1 / np.array([turn_sd_rad[2], *turn_sd_rad[:2]]) ** 2)
        return np.asarray(np.linalg.solve(normal, design.T @ moved_m.reshape(-1) / sd_m**2), np.float64)

    def _moved(self, before: Image, after: Image, turned: Floats, starts_m: Floats) -> tuple[Floats, Mask]:
        """Return how the points moved ahead and left (points x starts x 2), and which could be followed."""
        guess = turned[:, None] - starts_m[None]
        first = self._pixels[:, None] + np.stack([guess[..., 1], -guess[..., 0]], axis=-1) / self._pixel_m
        shape = first.shape
        pixels = np.repeat(self._pixels[:, None], shape[1], axis=1).reshape(-1, 2).astype(np.float32)
        found, status, _ = cv2.calcOpticalFlowPyrLK(
            before, after, pixels, first.reshape(-1, 2).astype(np.float32), winSize=self._window, maxLevel=1,
            criteria=(cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 12, 0.02),
            flags=cv2.OPTFLOW_USE_INITIAL_FLOW, minEigThreshold=2e-4,
        )  # fmt: skip
        places = np.asarray(found, np.float64).reshape(-1, 2)
        usable = (np.asarray(status).ravel() > 0) & self._is_visible(places)
        apart = (places.reshape(shape) - self._pixels[:, None]) * self._pixel_m
        return np.stack([-apart[..., 1], apart[..., 0]], axis=-1), usable.reshape(shape[:2])

    def _fit(self, samples: _Samples, group: Mask) -> PatchMotion | None:
        """Return the motion that most points of a group share, fitted to all points."""
        start, ambiguity = self._densest(samples, group)
        return None if start is None else self._solve(samples, start, ambiguity)

    def _densest(self, samples: _Samples, group: Mask) -> tuple[Floats | None, float]:
        """Return the motion that most points share, in the order of the design; None if too few do.

        And the points of the next densest group that moves otherwise, over those of this one.

        A point counts once. Where the pitch is not known, far points move otherwise than near ones: several
        changes of pitch are tried, in steps that part the points less than the group is wide.
        """
        numbers = self._parameters
        if group.any(axis=1).sum() < numbers.least_points:
            return None, 0.0
        point = np.nonzero(group)[0]
        chosen = samples.shifts[group]
        pitched, pitch_sd_rad = samples.design[:, :, 4], float(samples.information[2, 2] ** -0.5)
        spread = float(np.ptp(pitched[:, 0])) * pitch_sd_rad / self._pixel_m
        steps = min(int(1.5 * spread / numbers.pitch_pixels), numbers.most_pitch_steps)
        best, most, other = None, 0.0, 0.0
        for pitch_rad in np.linspace(-1.5, 1.5, 2 * steps + 1) * pitch_sd_rad if steps else (0.0,):
            level = chosen + pitched[point] * pitch_rad
            votes, middle = self._vote(level, point)
            if votes > most:
                best, most = np.r_[middle, 0.0, 0.0, pitch_rad], votes
                apart = np.hypot(*(level - middle).T) > numbers.other_pixels * self._pixel_m
                other = self._vote(level[apart], point[apart])[0] if apart.any() else 0.0
        if best is None:
            return None, 0.0
        return np.asarray(best + np.r_[0.0, 0.0, samples.angles], np.float64), other / most

    def _vote(self, shifts: Floats, point: NDArray[np.intp]) -> tuple[float, Floats]:
        """Return how many points the densest group of motions has, and its middle."""
        cell = np.floor(shifts / (self._parameters.group_pixels * self._pixel_m * 2 / 3)).astype(np.intp)
        cell -= cell.min(axis=0) - 1
        rows, columns = cell.max(axis=0) + 2
        if rows * columns > MOST_CELLS:
            return 0.0, np.zeros(2)
        single = np.unique((point * rows + cell[:, 0]) * columns + cell[:, 1])
        count = np.bincount(single % (rows * columns), minlength=rows * columns).astype(np.float32)
        votes = np.asarray(cv2.boxFilter(count.reshape(rows, columns), -1, (3, 3), normalize=False))
        row, column = np.unravel_index(int(votes.argmax()), votes.shape)
        near = (np.abs(cell - (row, column)) <= 1).all(axis=1)
        return float(votes[row, column]), np.asarray(shifts[near].mean(axis=0), np.float64)

    def _solve(self, samples: _Samples, start: Floats, ambiguity: float) -> PatchMotion | None:
        """Fit the motion to the points with Tukey weights, from a start near it."""
        numbers = self._parameters
        moved, usable, base, design = samples.moved, samples.usable, samples.base, samples.design
        x, scale = start, numbers.group_pixels * self._pixel_m
        least, most = numbers.point_sd_pixels * self._pixel_m, numbers.most_scale_pixels * self._pixel_m
        flat, place = design.reshape(-1, 5), np.arange(len(base))
        far: Floats = np.where(usable, 0.0, np.inf)
        normal: Floats = np.zeros((5, 5))
        weight: Floats = np.zeros(len(base))
        for _ in range(numbers.rounds):
            model = base + (flat @ x).reshape(-1, 2)
            apart = moved - model[:, None]
            squares = np.einsum("ijk,ijk->ij", apart, apart) + far
            nearest = squares.argmin(axis=1)
            error = np.sqrt(squares[place, nearest])
            group = np.sort(error[error < numbers.cut * scale])
            if len(group) < numbers.least_points:
                return None
            scale = max(least, 0.6 * float(group[len(group) // 2] + group[(len(group) - 1) // 2]))
            weight = np.clip(1 - (error / (numbers.cut * scale)) ** 2, 0.0, 1.0) ** 2
            both = np.repeat(weight / scale**2, 2)
            target = (moved[place, nearest] - base).reshape(-1)
            target = np.where(both > 0, target, 0.0)
            normal = flat.T @ (both[:, None] * flat)
            normal[2:, 2:] += samples.information
            pulled = flat.T @ (both * target)
            pulled[2:] += samples.information @ samples.angles
            x = np.asarray(np.linalg.solve(normal, pulled), np.float64)
        inlier = weight > numbers.inlier_weight
        if inlier.sum() < numbers.least_points or scale > most:
            return None
        model = base + design @ x
        landed = self._pixels + np.stack([model[:, 1], -model[:, 0]], axis=1) / self._pixel_m
        sd = np.sqrt(self._covariance_factor * np.diag(np.linalg.inv(normal)))
        return PatchMotion(
            forward_m=float(x[0]),
            left_m=float(x[1]),
            turn_rad=samples.yaw_rad + float(x[2]),
            tilt_rad=(float(x[3]), float(x[4])),
            forward_sd_m=float(sd[0]),
            left_sd_m=float(sd[1]),
            turn_sd_rad=float(sd[2]),
            points=int(inlier.sum()),
            share=min(
                float(inlier.sum()) / max(int((self._is_visible(landed) & samples.counts).sum()), 1), 1.0
            ),
            moved_pixels=float(np.hypot(*model[inlier].T).mean()) / self._pixel_m,
            moved_sd_pixels=scale / self._pixel_m * float(np.sqrt(self._covariance_factor / inlier.sum())),
            ambiguity=ambiguity,
            tracks=self._tracks(samples, model, numbers.cut * scale),
        )

    def _tracks(self, samples: _Samples, model: Floats, most_m: float) -> Tracks:
        """Return where the points went; those of the ground are nearer to the model than this."""
        apart = samples.moved - model[:, None]
        squares = np.where(samples.tracked, np.einsum("ijk,ijk->ij", apart, apart), np.inf)
        nearest = squares.argmin(axis=1)
        place = np.arange(len(nearest))
        moved_m = samples.moved[place, nearest]
        after = self._pixels + np.stack([moved_m[:, 1], -moved_m[:, 0]], axis=1) / self._pixel_m
        follows = squares[place, nearest] < most_m**2
        tracked = np.asarray(samples.tracked.any(axis=1), np.bool_)
        return Tracks(self._pixels, after, tracked, np.asarray(follows, np.bool_))

    def _linearised(self, yaw_rad: float) -> tuple[Floats, Floats]:
        """Return displacements of the points (ahead, left) by a turn, and by unit motions on top of it.

        The unit motions: forward, left, further turn, roll, pitch.
        """
        cosine, sine = np.cos(yaw_rad), np.sin(yaw_rad)
        later = self._points @ np.array([[cosine, -sine], [sine, cosine]])
        seen = later + self._reference
        # After small turns about the vehicle's origin a ground point (x, y) is pitch x - roll y above the
        # plane, and appears further away from the camera's foot by that share of the camera's height.
        rise = np.stack([-(seen - self._origin)[:, 1], (seen - self._origin)[:, 0]], axis=1) / self._height_m
        design = np.zeros((len(later), 2, 5))
        design[:, 0, 0] = design[:, 1, 1] = -1.0
        design[:, 0, 2], design[:, 1, 2] = later[:, 1], -later[:, 0]
        design[:, :, 3:] = (seen - self._camera)[:, :, None] * rise[:, None, :]
        return later - self._points, design

    def _is_visible(self, pixels: Floats) -> Mask:
        place = np.round(pixels).astype(np.intp)
        rows, columns = self._seen.shape
        inside = (place >= 0).all(axis=1) & (place < (columns, rows)).all(axis=1)
        place = np.clip(place, 0, (columns - 1, rows - 1))
        return np.asarray(inside & self._seen[place[:, 1], place[:, 0]], np.bool_)


def _spacing_pixels(pixels: int, numbers: FlowParameters, *, is_coarse: bool) -> int:
    """Return the distance of points in a view with this many pixels."""
    if is_coarse:
        return numbers.coarse_spacing_pixels
    spacing = math.isqrt(pixels // numbers.view_points)
    return min(max(spacing, numbers.coarse_spacing_pixels), numbers.spacing_pixels)
